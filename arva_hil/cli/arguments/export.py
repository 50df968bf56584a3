"""Write a record for maps, spreadsheets and other programs.

RUN is a folder that --record has written. The place found is a point with the ellipse in which it is with 95 %.
"""

from __future__ import annotations

from arva_hil.cli import options as opt
from arva_hil.registry import EXPORTS


def add_options(parser: opt.CommandParser) -> None:
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
