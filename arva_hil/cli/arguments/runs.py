"""Options of the commands that run something or examine links: each function adds those of one command."""

from __future__ import annotations

import math
from typing import Final

from arva_hil.cli.arguments import shared
from arva_hil.cli.options import CommandParser, folder, link, number, numbers, option, speed, whole
from arva_hil.config.ranges import LARGEST_SEED
from arva_hil.registry import MAVLINK_FORMATS
from arva_hil.simulated import HOME

FAILSAFES: Final = ("geofence", "battery", "ekf", "radio")


def run(parser: CommandParser) -> None:
    """Emulate the receiver: read the autopilot's MAVLink packets, send the receiver's frames."""
    parser.usual("--port --autopilot --scenario --format --rate --fault --duration --record --web --json")
    parser.options(
        option(
            "--port URL",
            "link for the frames: /dev/ttyUSB0[,BAUD], pty[:LINK], udpout:HOST:PORT, tcp:HOST:PORT, or - for stdout",
            link,
        )
    )
    parser.group(
        "autopilot",
        *shared.AUTOPILOT,
        *shared.TARGET,
        shared.SIGNING,
        shared.MAX_AGE,
        option("--timeout S", "end if no heartbeat comes in this time", number(0.1, math.inf, " of s"), 10.0),
    )
    parser.group(
        "scenario",
        *shared.SCENARIO,
        option("--hide-truth", "for a lesson: leave the true places out of the page and the terminal until the end"),
        shared.DURATION,
    )
    parser.group("output", *shared.common_options())


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
    parser.options(
        option(
            "--port URL", "link for the frames, which are sent at the speed of the log unless --speed is given", link
        ),
        option("--out FILE", "write the frames to a file; - is stdout"),
        option("--speed N|max", "multiple of real time; default 1 with --port, else max", speed),
    )
    parser.group("scenario", *shared.SCENARIO)
    parser.group("autopilot", *shared.TARGET, shared.MAX_AGE)
    parser.group("output", *shared.common_options())


def doctor(parser: CommandParser) -> None:
    """Find faults of the links, and their cures. Opens both sides as `run` would, and prints each finding."""
    parser.options(
        *shared.AUTOPILOT,
        option("--port URL", "link for the frames; without it only the autopilot is examined", link),
        shared.format_option(default="binary"),
        *shared.TARGET,
        shared.SIGNING,
        option("--listen S", "listen this long", number(0.2, 3600, " of s"), 6.0),
        option("--json", "print a JSON object for each finding on stdout"),
    )


def listen(parser: CommandParser) -> None:
    """Decode and print frames from a port or a file, like a consumer."""
    parser.add_argument("url", metavar="URL", help="a port, a file such as frames.bin of a record, or - for stdin")
    parser.options(
        shared.format_option(default="binary"),
        option("--count N", "end after N frames; default: never", whole(1, 2**31), math.inf),
        shared.DURATION,
        option("--json", "print a JSON object for each frame on stdout"),
    )


def record(parser: CommandParser) -> None:
    """Record a real receiver beside a real autopilot: a folder that view, plot, report and export can read.

    True ranges come from the places of --transmitter. The receiver's bytes are kept: `arva-hil decode` can decode
    them later, in another format.
    """
    parser.add_argument("folder", metavar="DIR", type=folder, help="folder to make")
    parser.options(
        *shared.AUTOPILOT,
        option("--receiver URL", "link to the receiver: /dev/ttyUSB0[,BAUD], tcp:HOST:PORT", link),
        shared.format_option(default="binary"),
        shared.SURVEYED,
        option("--noise", "at the end write DIR/noise.yaml: the noise over the motors' load, of a vehicle at rest"),
        *shared.TARGET,
        shared.SIGNING,
        shared.MAX_AGE,
        option("--timeout S", "end if no heartbeat comes in this time", number(0.1, math.inf, " of s"), 10.0),
        shared.DURATION,
    )


def command(parser: CommandParser) -> None:
    """Send one command to a receiver and print its answer."""
    parser.add_argument("port", metavar="PORT", help="the receiver's port, e.g. /dev/ttyUSB0 or /tmp/arva0")
    parser.add_argument("name", metavar="NAME", help="identify, mark, unmark, select, restart, channels or scan")
    parser.add_argument(
        "values", metavar="VALUE", nargs="*", type=whole(-(2**31), 2**31 - 1), help="e.g. the transmitter's id"
    )
    parser.options(
        shared.format_option(default="binary", without=MAVLINK_FORMATS),
        option("--timeout S", "wait this long for an answer", number(0.1, 3600, " of seconds"), 3.0),
        option("--json", "print the answer as a JSON object"),
    )


def serve(parser: CommandParser) -> None:
    """Run an emulated receiver and its vehicle for your tests, controlled by JSON lines.

    Prints one line {"control": …, "port": …}: the addresses of the control port and of the frames.
    Each request is a line, e.g. {"do": "advance", "seconds": 30}; so is each answer.
    """
    parser.options(
        option(
            "--control ADDRESS",
            "tcp:127.0.0.1:PORT, with 0 for a free port, or unix:PATH",
            default="tcp:127.0.0.1:0",
        ),
        option("--scenario FILE", "scenario (YAML), or builtin:NAME; default: one transmitter 20 m N, 5 m E of home"),
        option("--port URL", "port for the frames: pty, tcp, udp or a connection string", default="pty"),
        option("--real-time", "frames come in real time; without it time passes in `advance` alone"),
    )


def ports(parser: CommandParser) -> None:
    """List the serial ports, and mark those that look like an autopilot."""
    parser.options(option("--json", "print a JSON object for each port"))


def vehicle(parser: CommandParser) -> None:
    """Run the built-in vehicle alone: a simulated multirotor that answers as ArduCopter does, on one or more links.

    A ground station and a search can use it together: `arva-hil vehicle --link udpout:127.0.0.1:14550 --link
    tcpin:127.0.0.1:5760`.
    """
    parser.options(
        option("--link URL", "MAVLink link; may be repeated", link, action="append"),
        option("--home LAT,LON,ALT", "home in degrees, m AMSL; default: in the Alps", home, HOME),
        option("--wind N,E,D", "velocity of the air, m/s; default 0,0,0", wind, (0.0, 0.0, 0.0)),
        shared.GPS_NOISE,
        option("--fix-after S", "time until the first GPS fix", number(0, 3600), 0.0),
        option("--count N", "number of vehicles, 5 m apart, with consecutive ids", whole(1, 64), 1),
        option("--system N", "system id of the first vehicle", whole(1, 250), 1),
        option("--seed N", "seed of the GPS drift", whole(0, 2**31), 0),
        option(
            "--failsafe NAME@S",
            f"trigger a failsafe S seconds after the first take-off: {', '.join(FAILSAFES)}; may be repeated",
            failsafe,
            action="append",
        ),
        shared.DURATION,
    )


home = numbers(
    "LAT,LON,ALT in degrees and m, e.g. --home=46.0,7.7,1650",
    (-90, 90),
    (-180, 180),
    (-500, 9000),
    names=("latitude", "longitude", "altitude"),
)


wind = numbers("N,E,D in m/s, at most 50 each, e.g. --wind=3,-1,0", *[(-50, 50)] * 3)


def failsafe(text: str) -> tuple[str, float]:
    """Convert NAME@SECONDS."""
    name, _, seconds = text.partition("@")
    try:
        return FAILSAFES[FAILSAFES.index(name)], number(0, 86_400)(seconds or "0")
    except ValueError:
        expected = f"expected NAME@SECONDS, where NAME is one of {', '.join(FAILSAFES)}"
        raise ValueError(f"{text!r}: {expected}, e.g. battery@30") from None


def range_test(parser: CommandParser) -> None:
    """Carry the scenario's receiver towards its first transmitter, several times, and print its range.

    In three couplings: coaxial, turned by 90°, and with the dipole upright. Only stable signals count, as in the tests
    of receivers: a single signal from farther away does not. With --out it also writes range-test.txt, .csv and .png
    to a folder.
    """
    parser.options(
        option(
            "--scenario FILE",
            "scenario (YAML), or builtin:NAME, for its receivers and the strength of its first transmitter",
        ),
        option("--seed N", "seed of the first walk", whole(0, LARGEST_SEED)),
        option("--walks N", "walks in each coupling", whole(1, 1000), 10, environment=False),
        option(
            "--height M",
            "height of the receiver above the transmitter",
            number(0, 100, " of m"),
            3.0,
            environment=False,
            dest="range_height",
        ),
        option(
            "--speed M/S", "walking speed", number(0.1, 30, " of m/s"), 1.0, environment=False, dest="walking_speed"
        ),
        option(
            "--stable S",
            "a signal without a gap for this time is stable",
            number(0, 1000, " of s"),
            10.0,
            environment=False,
        ),
        option("--out DIR", "folder for the data sheet and its picture"),
        option("--json", "print the data sheet as a JSON object for each receiver"),
    )


def conform(parser: CommandParser) -> None:
    """Judge your decoder of binary frames by each clause of PROTOCOL.md.

    The command reads bytes on stdin, prints one JSON line for each valid frame and channel, flushes it, and ends when
    its input ends:
    {"seq": 0, "slot": 1, "id": 1, "zone": 1, "d_cm": 1905, "delta_deg": 22}
    """
    parser.add_argument("command", metavar="COMMAND", nargs="*", help="the decoder and its arguments, after --")
    parser.options(
        option("--junit FILE", "write the results as JUnit XML, too; - is stdout"),
        option("--list", "list the clauses, and judge nothing"),
        option("--only CLAUSE", "judge this clause; may be given again", str, action="append"),
        option("--pty", "the command opens the port named in $ARVA_PORT, instead of reading stdin"),
        option("--timeout S", "patience with the command", number(0.5, 600, " of s"), 5.0),
    )
