"""The whole loop without hardware: a simulated vehicle, a receiver on it, and a search that finds the transmitter.

At real time the vehicle and the receiver's port are pseudo-terminals, as real ones are cables.
"""

from __future__ import annotations

from arva_hil.cli import options as opt
from arva_hil.cli.arguments.search import add_plan


def add_options(parser: opt.CommandParser) -> None:
    parser.option("--speed", type=opt.speed, default=1.0, metavar="N|max", help="times real time; default 1")
    parser.option("--headless", action="store_true", help="plain lines only")
    add_plan(parser)
    opt.add_scenario(parser)
    opt.add_common(parser)
