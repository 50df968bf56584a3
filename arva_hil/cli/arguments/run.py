"""Emulate the receiver: read the autopilot's MAVLink packets, send the receiver's frames."""

from __future__ import annotations

import math

from arva_hil.cli import options as opt
from arva_hil.cli.live_options import add_live
from arva_hil.cli.web_option import add_web


def add_options(parser: opt.CommandParser) -> None:
    parser.option(
        "--port",
        type=opt.address,
        metavar="URL",
        help="where frames go: /dev/ttyUSB0[,BAUD], pty[:LINK], udpout:…, tcp:…, -",
    )
    opt.add_autopilot(parser)
    opt.add_scenario(parser)
    opt.add_target(parser)
    opt.add_signing(parser)
    opt.add_max_age(parser)
    opt.add_duration(parser)
    parser.option(
        "--timeout",
        type=opt.number(0.1, math.inf, " of s"),
        default=10.0,
        metavar="S",
        help="give up if no heartbeat comes in this time; default 10",
    )
    add_live(parser)
    opt.add_common(parser)
    add_web(parser)
