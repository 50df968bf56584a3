"""Carry the scenario's receiver towards its first transmitter, again and again, and print how far it hears.

In three couplings: coaxial, turned by 90°, and with the dipole upright. A signal counts once it is stable: single ones
from farther away do not, as testers have it. With --out it also writes range-test.txt, .csv and .png to a folder.
"""

from __future__ import annotations

from arva_hil.cli import options as opt
from arva_hil.config import LARGEST_SEED


def add_options(parser: opt.CommandParser) -> None:
    parser.option(
        "--scenario",
        metavar="FILE",
        help="scenario (YAML), or builtin:NAME, for its receivers and the strength of its first transmitter",
    )
    parser.option("--seed", type=opt.whole(0, LARGEST_SEED), metavar="N", help="seed of the first walk")
    parser.add_argument(
        "--walks", type=opt.whole(1, 1000), default=10, metavar="N", help="walks in each coupling; default 10"
    )
    parser.add_argument(
        "--height",
        dest="range_height",
        type=opt.number(0, 100, " of m"),
        default=3.0,
        metavar="M",
        help="height of the receiver above the transmitter; default 3",
    )
    parser.add_argument(
        "--speed",
        dest="walking_speed",
        type=opt.number(0.1, 30, " of m/s"),
        default=1.0,
        metavar="M/S",
        help="how fast it is carried; default 1",
    )
    parser.add_argument(
        "--stable",
        type=opt.number(0, 1000, " of s"),
        default=10.0,
        metavar="S",
        help="a signal is stable if there is no gap in it for so long; default 10",
    )
    parser.option("--out", metavar="DIR", help="folder for the data sheet and its picture")
    parser.option("--json", action="store_true", help="print the data sheet as a JSON object for each receiver")
