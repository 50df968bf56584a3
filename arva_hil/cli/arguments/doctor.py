"""Find what is wrong with the links, and the cure. Opens both sides as `run` would, and prints each finding."""

from __future__ import annotations

from arva_hil.cli import options as opt


def add_options(parser: opt.CommandParser) -> None:
    opt.add_autopilot(parser)
    parser.option(
        "--port", type=opt.address, metavar="URL", help="where frames go; without it only the autopilot is examined"
    )
    opt.add_format(parser, default="binary")
    opt.add_target(parser)
    opt.add_signing(parser)
    parser.option(
        "--listen", type=opt.number(0.2, 3600, " of s"), default=6.0, metavar="S", help="listen this long; default 6"
    )
    parser.option("--json", action="store_true", help="print a JSON object for each finding on stdout")
