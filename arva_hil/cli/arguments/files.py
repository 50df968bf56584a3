"""What the commands take that work on files: each function adds a command's options."""

from __future__ import annotations

import argparse
import re

from arva_hil.cli import options as opt
from arva_hil.cli.web_option import page_address
from arva_hil.config import LARGEST_SEED
from arva_hil.observers.web.address import Address
from arva_hil.registry import EXPORTS

SHELLS = ("bash", "zsh", "fish")


def check(parser: opt.CommandParser) -> None:
    """Validate scenario files, plans of campaigns and profiles. Prints every mistake with line and column, or a
    summary.
    """
    parser.add_argument("files", nargs="*", metavar="FILE", help="scenario, plan of a campaign or profile (YAML)")
    parser.add_argument(
        "--schema",
        nargs="?",
        const="scenario",
        choices=("scenario", "campaign", "receiver", "transmitter"),
        help="print the JSON Schema of these files, for editors, and check nothing; default: scenario",
    )


def scenarios(parser: opt.CommandParser) -> None:
    """List the built-in scenarios and campaign plans. Use one with --scenario builtin:NAME."""
    parser.option("--json", action="store_true", help="print a JSON object for each file")


def completion(parser: opt.CommandParser) -> None:
    """Print a script that completes commands, options and file names in a shell.

    bash:  eval "$(arva-hil completion bash)"                      in ~/.bashrc
    zsh:   arva-hil completion zsh > ~/.zfunc/_arva-hil            with ~/.zfunc in $fpath, before compinit
    fish:  arva-hil completion fish > ~/.config/fish/completions/arva-hil.fish
    """
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help="bash, zsh or fish")


def campaign(parser: opt.CommandParser) -> None:
    """Fly a plan of many trials, on all cores or a cluster, and compare the strategies.

    Each result is saved in DIR/results.sqlite at once. At the end results.csv and report.html are written too.
    The same command continues a campaign that was stopped.
    """
    parser.add_argument(
        "plan",
        metavar="PLAN.yaml",
        help="plan of the campaign, or a built-in one such as builtin:campaigns/paper: see arva-hil scenarios",
    )
    parser.option("--out", metavar="DIR", help="folder of the results and the report; default: PLAN-results")
    parser.option(
        "--jobs", type=opt.whole(1, 1024), metavar="N", help="number of processes; default: one for each core"
    )
    parser.option("--scheduler", type=address, metavar="tcp://HOST:PORT", help="run on a Dask cluster instead")
    parser.option("--dry-run", action="store_true", help="list the trials, without flying or writing")
    parser.option("--json", action="store_true", help="print a JSON object for each trial on stdout")


def report(parser: opt.CommandParser) -> None:
    """Write a report of a record: one page of HTML that needs nothing else, and opens from a mail.

    RUN is a folder that --record has written. Two of them are shown side by side; of a folder with records in it all
    are.
    Its pictures need matplotlib: pip install 'arva-hil[plots]'.
    """
    parser.add_argument("run", metavar="RUN", help="folder of a record, or a folder with records in it")
    parser.add_argument("other", nargs="?", metavar="RUN2", help="another record, to compare")
    parser.option("--out", metavar="FILE", help="the page; default: report.html in RUN; - is stdout")


def plot(parser: opt.CommandParser) -> None:
    """Draw a record: the track over flux lines, d against the true range, a timeline, lateness, rates of the streams.

    RUN is a folder that --record has written. It needs matplotlib: pip install 'arva-hil[plots]'.
    """
    parser.add_argument("run", metavar="RUN", help="folder of a record")
    parser.option(
        "--out",
        metavar="DIR|FILE",
        help="a folder for one file a picture, or a file that ends with .png, .svg or .pdf for all on one sheet; "
        "default: the folder RUN/plots",
    )
    parser.add_argument(
        "--format",
        dest="picture_format",
        choices=("png", "svg", "pdf"),
        help="of the pictures in a folder; default png",
    )


def export(parser: opt.CommandParser) -> None:
    """Write a record for maps, spreadsheets and other programs.

    RUN is a folder that --record has written. The place found is a point with the ellipse in which it is with 95 %.
    """
    parser.add_argument("run", metavar="RUN", help="folder of a record")
    names = ", ".join(EXPORTS)
    parser.add_argument(  # not from the environment: ARVA_HIL_FORMAT is that of frames
        "--format",
        dest="export_format",
        type=opt.kind(EXPORTS),
        metavar="NAME",
        help=f"{names}; default: what the name of FILE ends with",
    )
    parser.option("--out", metavar="FILE", help="file to write, which is replaced if it is there; - is stdout")


def view(parser: opt.CommandParser) -> None:
    """Look at a record on a page in a browser: the same page as --web, with a slider for the time.

    RUN is a folder that --record has written. A LOG.tlog is replayed first, through the scenario.
    """
    parser.add_argument("record_or_log", metavar="RUN|LOG", help="folder of a record, or MAVLink telemetry log")
    parser.option(
        "--web",
        type=page_address,
        default=Address(),
        metavar="HOST:PORT",
        help="where the page is: HOST, PORT or HOST:PORT; if the port is taken, the next free one; "
        f"default {Address()}",
    )
    parser.option("--scenario", metavar="FILE", help="of a log: scenario (YAML), or builtin:NAME")
    opt.add_duration(parser)


def range_test(parser: opt.CommandParser) -> None:
    """Carry the scenario's receiver towards its first transmitter, again and again, and print how far it hears.

    In three couplings: coaxial, turned by 90°, and with the dipole upright. A signal counts once it is stable: single
    ones from farther away do not, as testers have it. With --out it also writes range-test.txt, .csv and .png to a
    folder.
    """
    parser.option(
        "--scenario",
        metavar="FILE",
        help="scenario (YAML), or builtin:NAME, for its receivers and the strength of its first transmitter",
    )
    parser.option("--seed", type=opt.whole(0, LARGEST_SEED), metavar="N", help="seed of the first walk")
    parser.add_argument(
        "--walks", type=opt.whole(1, 1000), default=10, metavar="N", help="walks in each coupling; default 10"
    )
    parser.add_argument(
        "--height",
        dest="range_height",
        type=opt.number(0, 100, " of m"),
        default=3.0,
        metavar="M",
        help="height of the receiver above the transmitter; default 3",
    )
    parser.add_argument(
        "--speed",
        dest="walking_speed",
        type=opt.number(0.1, 30, " of m/s"),
        default=1.0,
        metavar="M/S",
        help="how fast it is carried; default 1",
    )
    parser.add_argument(
        "--stable",
        type=opt.number(0, 1000, " of s"),
        default=10.0,
        metavar="S",
        help="a signal is stable if there is no gap in it for so long; default 10",
    )
    parser.option("--out", metavar="DIR", help="folder for the data sheet and its picture")
    parser.option("--json", action="store_true", help="print the data sheet as a JSON object for each receiver")


def address(text: str) -> str:
    """A converter that accepts only addresses of a Dask scheduler."""
    if not re.fullmatch(r"(tcp|tls)://\S+:\d{1,5}", text):
        raise argparse.ArgumentTypeError(f"{text!r}: expected an address such as tcp://192.168.1.5:8786")
    return text
