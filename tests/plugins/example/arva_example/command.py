"""A command: `arva-hil count-frames FILE` prints the number of frames in a file."""

from __future__ import annotations

import argparse
from pathlib import Path

from arva_hil import CommandParser
from firmware_proto import Decoder


def options(parser: CommandParser) -> None:
    """Count the frames in a file."""
    parser.add_argument("file", metavar="FILE", help="bytes of a receiver's port")
    parser.option("--times N", "multiply the number", int, 1)


def main(options: argparse.Namespace) -> int:
    print(options.times * len(Decoder().feed(Path(options.file).read_bytes(), 0.0)))
    return 0
