"""Options of the commands that run something or examine links: each function adds those of one command."""

from __future__ import annotations

import math
import re

from arva_hil.cli.arguments import shared
from arva_hil.cli.options import CommandParser, link, number, speed, whole
from arva_hil.registry import MAVLINK_FORMATS


def run(parser: CommandParser) -> None:
    """Emulate the receiver: read the autopilot's MAVLink packets, send the receiver's frames."""
    parser.usual("--port --autopilot --scenario --format --rate --fault --duration --record --web --json")
    where = "link for the frames: /dev/ttyUSB0[,BAUD], pty[:LINK], udpout:HOST:PORT, tcp:HOST:PORT, or - for stdout"
    parser.option("--port URL", where, link)
    parser.group("autopilot")
    shared.add_autopilot(parser)
    shared.add_target(parser)
    shared.add_signing(parser)
    shared.add_max_age(parser)
    parser.option("--timeout S", "end if no heartbeat comes in this time", number(0.1, math.inf, " of s"), 10.0)
    parser.group("scenario")
    shared.add_scenario(parser)
    parser.option("--hide-truth", "for a lesson: leave the true places out of the page and the terminal until the end")
    shared.add_duration(parser)
    parser.group("output")
    shared.add_common(parser)


def config(parser: CommandParser) -> None:
    """Print the settings that `run` would use with these options, and where each value comes from.

    The command line is stronger than the environment, which is stronger than the file, which is stronger than the
    default.
    The output is a scenario file with the same settings.
    """
    run(parser)
    parser.tells_sources = True


def replay(parser: CommandParser) -> None:
    """Replay a recorded flight through the emulator. The same log, scenario and seed give the same bytes."""
    parser.usual("--port --out --speed --scenario --format --rate --fault --record --web --json")
    parser.add_argument("log", metavar="LOG.tlog", help="MAVLink telemetry log")
    parser.option(
        "--port URL", "link for the frames, which are sent at the speed of the log unless --speed is given", link
    )
    parser.option("--out FILE", "write the frames to a file; - is stdout")
    parser.option("--speed N|max", "multiple of real time; default 1 with --port, else max", speed)
    parser.group("scenario")
    shared.add_scenario(parser)
    parser.group("autopilot")
    shared.add_target(parser)
    shared.add_max_age(parser)
    parser.group("output")
    shared.add_common(parser)


def doctor(parser: CommandParser) -> None:
    """Find faults of the links, and their cures. Opens both sides as `run` would, and prints each finding."""
    shared.add_autopilot(parser)
    parser.option("--port URL", "link for the frames; without it only the autopilot is examined", link)
    shared.add_format(parser, default="binary")
    shared.add_target(parser)
    shared.add_signing(parser)
    parser.option("--listen S", "listen this long", number(0.2, 3600, " of s"), 6.0)
    parser.option("--json", "print a JSON object for each finding on stdout")


def listen(parser: CommandParser) -> None:
    """Decode and print frames from a port or a file, like a consumer."""
    parser.add_argument("url", metavar="URL", help="a port, a file such as frames.bin of a record, or - for stdin")
    shared.add_format(parser, default="binary")
    parser.option("--count N", "end after N frames; default: never", whole(1, 2**31), math.inf)
    shared.add_duration(parser)
    parser.option("--json", "print a JSON object for each frame on stdout")


def record(parser: CommandParser) -> None:
    """Record a real receiver beside a real autopilot: a folder that view, plot, report and export can read.

    True ranges come from the places of --transmitter. The receiver's bytes are kept: `arva-hil decode` can decode
    them later, in another format.
    """
    parser.add_argument("folder", metavar="DIR", help="folder to make")
    shared.add_autopilot(parser)
    parser.option("--receiver URL", "link to the receiver: /dev/ttyUSB0[,BAUD], tcp:HOST:PORT", link)
    shared.add_format(parser, default="binary")
    shared.add_surveyed(parser)
    parser.option("--noise", "at the end write DIR/noise.yaml: the noise over the motors' load, of a vehicle at rest")
    shared.add_target(parser)
    shared.add_signing(parser)
    shared.add_max_age(parser)
    parser.option("--timeout S", "end if no heartbeat comes in this time", number(0.1, math.inf, " of s"), 10.0)
    shared.add_duration(parser)


def command(parser: CommandParser) -> None:
    """Send one command to a receiver and print its answer."""
    parser.add_argument("port", metavar="PORT", help="the receiver's port, e.g. /dev/ttyUSB0 or /tmp/arva0")
    names = "identify, mark, unmark, select, restart, channels or scan"
    parser.add_argument("name", metavar="NAME", help=names)
    value = whole(-(2**31), 2**31 - 1)
    parser.add_argument("values", metavar="VALUE", nargs="*", type=value, help="e.g. the transmitter's id")
    shared.add_format(parser, default="binary", without=MAVLINK_FORMATS)
    parser.option("--timeout S", "wait this long for an answer", number(0.1, 3600, " of seconds"), 3.0)
    parser.option("--json", "print the answer as a JSON object")


def campaign(parser: CommandParser) -> None:
    """Fly a plan of many trials, on all cores or a cluster, and compare the strategies.

    Each result is saved in DIR/results.sqlite at once. At the end results.csv and report.html are written too.
    The same command continues a campaign that was stopped.
    """
    plan = "plan of the campaign, or a built-in one such as builtin:campaigns/paper: see arva-hil scenarios"
    parser.add_argument("plan", metavar="PLAN.yaml", help=plan)
    parser.option("--out DIR", "folder of the results and the report; default: PLAN-results")
    parser.option("--jobs N", "number of processes; default: one for each core", whole(1, 1024))
    parser.option("--scheduler tcp://HOST:PORT", "run on a Dask cluster instead", scheduler)
    part = "fly only part K of N of the plan, every N-th seed; default folder: PLAN-results-K-of-N"
    parser.option("--shard K/N", part, shard)
    parser.option("--merge DIR", "fly nothing: copy the results of these folders and write the report", nargs="+")
    parser.option("--dry-run", "list the trials, without flying or writing")
    parser.option("--json", "print a JSON object for each trial on stdout")


def fit(parser: CommandParser) -> None:
    """Estimate a receiver's profile from records of flights around a transmitter, each value with its 95 % interval.

    The profile has display law, noise and mount. Transmitters and latency are printed, and go into --scenario-out.
    Outliers count little. It names values that the flights do not determine, and the next pass to fly. If the model
    does not fit, the command says why, and exits with 1. Needs scipy: pip install 'arva-hil[fit]'.
    """
    parser.add_argument("records", nargs="+", metavar="RECORD", help="folder of a record")
    models = ("paper", "pulsed", "rssi")
    parser.option(
        "--model NAME",
        f"receiver model: {', '.join(models)}; default paper",
        environment=False,
        default="paper",
        choices=models,
    )
    parser.option("--out PROFILE.yaml", "profile to write", environment=False)
    parser.option("--scenario-out FILE", "also write a scenario with the transmitters", environment=False)
    parser.option("--gps-sigma M", "standard deviation of the reported position on each axis", number(0, 20), 1.5)
    parser.option("--gps-tau S", "correlation time of its error", number(1, 10_000, " of s"), 60.0)
    parser.option("--json", "print a JSON object")


def scheduler(text: str) -> str:
    """Convert the address of a Dask scheduler."""
    if not re.fullmatch(r"(tcp|tls)://\S+:\d{1,5}", text):
        raise ValueError(f"{text!r}: expected an address such as tcp://192.168.1.5:8786")
    return text


def shard(text: str) -> tuple[int, int]:
    """Convert K/N, with K from 1 to N."""
    match = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text)
    k, n = map(int, match.groups()) if match else (0, 0)
    if not 1 <= k <= n:
        raise ValueError(f"{text!r}: expected K/N with K from 1 to N, e.g. 3/100")
    return k, n
