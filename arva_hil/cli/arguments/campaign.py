"""Fly a plan of many trials, on all cores or a cluster, and compare the strategies.

Every result is in DIR/results.sqlite as soon as there is one, and at the end in results.csv and report.html too.
A campaign that was stopped goes on with the same command.
"""

from __future__ import annotations

import argparse
import re

from arva_hil.cli import options as opt


def add_options(parser: opt.CommandParser) -> None:
    parser.add_argument(
        "plan", metavar="PLAN.yaml", help="what to try; or builtin:campaigns/paper and others, see arva-hil scenarios"
    )
    parser.option("--out", metavar="DIR", help="for the results and the report; default: PLAN-results")
    parser.option("--jobs", type=opt.whole(1, 1024), metavar="N", help="processes; default: one for each core")
    parser.option(
        "--scheduler", type=address, metavar="tcp://HOST:PORT", help="run on all of this Dask cluster instead"
    )
    parser.option("--dry-run", action="store_true", help="list the trials; fly nothing and write nothing")
    parser.option("--json", action="store_true", help="one JSON object a trial on stdout")


def address(text: str) -> str:
    """A converter that refuses what is no address of a Dask scheduler."""
    if not re.fullmatch(r"(tcp|tls)://\S+:\d{1,5}", text):
        raise argparse.ArgumentTypeError(f"{text!r}: expected an address such as tcp://192.168.1.5:8786")
    return text
