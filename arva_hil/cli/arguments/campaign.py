"""Fly a plan of many trials, on all cores or a cluster, and compare the strategies.

Each result is saved in DIR/results.sqlite at once. At the end results.csv and report.html are written too.
The same command continues a campaign that was stopped.
"""

from __future__ import annotations

import argparse
import re

from arva_hil.cli import options as opt


def add_options(parser: opt.CommandParser) -> None:
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


def address(text: str) -> str:
    """A converter that accepts only addresses of a Dask scheduler."""
    if not re.fullmatch(r"(tcp|tls)://\S+:\d{1,5}", text):
        raise argparse.ArgumentTypeError(f"{text!r}: expected an address such as tcp://192.168.1.5:8786")
    return text
