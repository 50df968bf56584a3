"""Draw a record: the track over flux lines, d against the true range, a timeline, lateness, rates of the streams.

RUN is a folder that --record has written. It needs matplotlib: pip install 'arva-hil[plots]'.
"""

from __future__ import annotations

from arva_hil.cli import options as opt


def add_options(parser: opt.CommandParser) -> None:
    parser.add_argument("run", metavar="RUN", help="folder of a record")
    parser.option(
        "--out",
        metavar="DIR|FILE",
        help="a folder for one file a picture, or a file that ends with .png, .svg or .pdf for all on one sheet; "
        "default: the folder RUN/plots",
    )
    parser.add_argument(
        "--format",
        dest="picture_format",
        choices=("png", "svg", "pdf"),
        help="of the pictures in a folder; default png",
    )
