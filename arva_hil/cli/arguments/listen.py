"""Decode and print frames, like a consumer: from a port, or from a file of them."""

from __future__ import annotations

import math

from arva_hil.cli import options as opt


def add_options(parser: opt.CommandParser) -> None:
    parser.add_argument("url", metavar="URL", help="a port, a file such as a record's frames.bin, or - for stdin")
    opt.add_format(parser, default="binary")
    parser.option("--count", type=opt.whole(1, 2**31), default=math.inf, metavar="N", help="end after N frames")
    opt.add_duration(parser)
    parser.option("--json", action="store_true", help="one JSON object a frame on stdout")
