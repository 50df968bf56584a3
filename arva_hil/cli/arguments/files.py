"""Options of the commands that work on files: each function adds those of one command."""

from __future__ import annotations

import re

from arva_hil.cli.arguments.shared import add_duration, add_map
from arva_hil.cli.options import CommandParser, number, whole
from arva_hil.config.ranges import LARGEST_SEED
from arva_hil.observers.web.address import HostPort, parse_address


def check(parser: CommandParser) -> None:
    """Validate scenario files, plans of campaigns and profiles.

    Prints every mistake with line and column, or a summary.
    """
    parser.add_argument("files", nargs="*", metavar="FILE", help="scenario, plan of a campaign or profile (YAML)")
    schema = "print the JSON Schema of these files for editors instead; default: scenario"
    kinds = ("scenario", "campaign", "receiver", "transmitter")
    parser.option("--schema", schema, environment=False, const="scenario", choices=kinds)


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


def plot(parser: CommandParser) -> None:
    """Draw a record or a campaign.

    RUN is a folder that --record has written: track over flux lines, d against the true range, timeline, lateness,
    rates of the streams. Or it is the folder of a campaign's results: success, time, error. Needs matplotlib: pip
    install 'arva-hil[plots]'.
    """
    parser.add_argument("run", metavar="RUN", help="folder of a record or of a campaign's results")
    parser.option(
        "--out DIR|FILE",
        "folder for one file per picture, or a file name that ends with .png, .svg or .pdf for one sheet; "
        "default: the folder RUN/plots",
    )
    what, kinds = "format of the pictures in a folder; default png", ("png", "svg", "pdf")
    parser.option("--format", what, environment=False, dest="picture_format", choices=kinds)
    paper = "pictures for a paper: PDF, 3.5 inches wide, 8 points, embedded TrueType fonts, no titles"
    parser.option("--paper", paper, environment=False)
    size = "width of a picture, e.g. 7.16 for both columns"
    parser.option("--size INCHES", size, number(1, 20, " of inches"), environment=False)
    parser.option("--dpi N", "resolution of PNG", whole(50, 1200), environment=False)
    parser.option("--latex", "of a campaign also the table, table.tex, for LaTeX with booktabs", environment=False)


def compare(parser: CommandParser) -> None:
    """Compare the readings of a record with those of the emulator on the same flight, or of another record.

    With --scenario the emulator computes what its receiver reads at the recorded poses. Two records of one flight are
    paired by the autopilot's clock, those of two flights by common places. Prints bias and scatter of d and δ by range,
    zone, angle and time.
    """
    parser.add_argument("run", metavar="RECORD", help="folder of a record")
    parser.add_argument("other", nargs="?", metavar="RECORD2", help="another record")
    parser.option("--scenario FILE", "scenario (YAML) of the emulator, or builtin:NAME")
    parser.option("--seed N", "seed of the emulator's noise", whole(0, LARGEST_SEED))
    parser.option("--out FILE", "picture to write, .png, .svg or .pdf; needs matplotlib")
    parser.option("--json", "print a JSON object for each transmitter")


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


def view(parser: CommandParser) -> None:
    """Open a record as a page in a browser: the same page as --web, with a slider for the time.

    RUN is a folder that --record has written. A LOG.tlog is replayed first, through the scenario.
    """
    parser.add_argument("record_or_log", metavar="RUN|LOG", help="folder of a record, or MAVLink telemetry log")
    where = "address of the page: HOST, PORT or HOST:PORT; the next free port if this one is taken"
    parser.option("--web HOST:PORT", f"{where}; default {HostPort()}", parse_address, HostPort())
    parser.option("--scenario FILE", "scenario for a log (YAML), or builtin:NAME")
    add_map(parser)
    out = "instead write one HTML file that plays the record without arva-hil and without a network, and end"
    parser.option("--out FILE", f"{out}; at most 40,000 readings and 400 states of the search")
    add_duration(parser)


def range_test(parser: CommandParser) -> None:
    """Carry the scenario's receiver towards its first transmitter, several times, and print its range.

    In three couplings: coaxial, turned by 90°, and with the dipole upright. Only stable signals count, as in the tests
    of receivers: a single signal from farther away does not. With --out it also writes range-test.txt, .csv and .png
    to a folder.
    """
    what = "scenario (YAML), or builtin:NAME, for its receivers and the strength of its first transmitter"
    parser.option("--scenario FILE", what)
    parser.option("--seed N", "seed of the first walk", whole(0, LARGEST_SEED))
    parser.option("--walks N", "walks in each coupling", whole(1, 1000), 10, environment=False)
    height, height_m = "height of the receiver above the transmitter", number(0, 100, " of m")
    parser.option("--height M", height, height_m, 3.0, environment=False, dest="range_height")
    speed = number(0.1, 30, " of m/s")
    parser.option("--speed M/S", "walking speed", speed, 1.0, environment=False, dest="walking_speed")
    stable = "a signal without a gap for this time is stable"
    parser.option("--stable S", stable, number(0, 1000, " of s"), 10.0, environment=False)
    parser.option("--out DIR", "folder for the data sheet and its picture")
    parser.option("--json", "print the data sheet as a JSON object for each receiver")


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
