"""Send one command to a receiver and print its answer."""

from __future__ import annotations

from arva_hil.cli import options as opt
from arva_hil.registry import MAVLINK_FORMATS


def add_options(parser: opt.CommandParser) -> None:
    parser.add_argument("port", metavar="PORT", help="the receiver's port, e.g. /dev/ttyUSB0 or /tmp/arva0")
    names = "identify, mark, unmark, select, restart, channels or scan"
    parser.add_argument("name", metavar="NAME", help=names)
    value = opt.whole(-(2**31), 2**31 - 1)
    parser.add_argument("values", metavar="VALUE", nargs="*", type=value, help="e.g. the transmitter's id")
    opt.add_format(parser, default="binary", without=MAVLINK_FORMATS)
    parser.option(
        "--timeout", type=opt.number(0.1, 3600, " of seconds"), default=3.0, metavar="S", help="for an answer (3)"
    )
    parser.option("--json", action="store_true", help="print the answer as a JSON object")
