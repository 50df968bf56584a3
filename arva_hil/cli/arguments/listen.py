"""Decode and print frames from a port or a file, like a consumer."""

from __future__ import annotations

import math

from arva_hil.cli import options as opt


def add_options(parser: opt.CommandParser) -> None:
    parser.add_argument("url", metavar="URL", help="a port, a file such as frames.bin of a record, or - for stdin")
    opt.add_format(parser, default="binary")
    parser.option("--count", type=opt.whole(1, 2**31), default=math.inf, metavar="N", help="end after N frames")
    opt.add_duration(parser)
    parser.option("--json", action="store_true", help="print a JSON object for each frame on stdout")
