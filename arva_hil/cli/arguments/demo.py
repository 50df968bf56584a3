"""Run the whole loop without hardware: a simulated vehicle, its receiver, and a search that finds the transmitter.

Unless --speed is max, the vehicle's link and the receiver's port are pseudo-terminals.
"""

from __future__ import annotations

from arva_hil.cli import options as opt
from arva_hil.cli.arguments.search import add_plan
from arva_hil.cli.live_options import add_live
from arva_hil.cli.web_option import add_web


def add_options(parser: opt.CommandParser) -> None:
    parser.option("--speed", type=opt.speed, default=1.0, metavar="N|max", help="multiple of real time; default 1")
    parser.option("--headless", action="store_true", help="print plain lines only, without a live status")
    parser.option(
        "--count",
        type=opt.whole(1, 64),
        metavar="N",
        help="number of drones that divide the area, 5 m apart at the start; default 1, or the scenario's vehicles",
    )
    add_plan(parser)
    opt.add_scenario(parser)
    add_live(parser)
    opt.add_common(parser)
    add_web(parser, default="on, with --headless off")
