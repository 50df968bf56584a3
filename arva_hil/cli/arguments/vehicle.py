"""Run the built-in vehicle alone: a simulated multirotor that answers as ArduCopter does, on one or more links.

A ground station and a search can use it together:
`arva-hil vehicle --link udpout:127.0.0.1:14550 --link tcpin:127.0.0.1:5760`.
"""

from __future__ import annotations

import argparse
import math

from arva_hil.cli import options as opt

FAILSAFES = ("geofence", "battery", "ekf", "radio")
HOME = (46.0123, 7.7456, 1650.0)


def add_options(parser: opt.CommandParser) -> None:
    parser.option("--link", type=opt.address, action="append", metavar="URL", help="MAVLink link; may be repeated")
    parser.option(
        "--home", type=home, default=HOME, metavar="LAT,LON,ALT", help="home in degrees, m AMSL; default: in the Alps"
    )
    parser.option("--wind", type=wind, default=(0.0, 0.0, 0.0), metavar="N,E,D", help="velocity of the air, m/s")
    parser.option(
        "--gps-noise", type=opt.number(0, 1000), default=0.0, metavar="M", help="sigma of the GPS drift on each axis"
    )
    parser.option(
        "--fix-after", type=opt.number(0, 3600), default=0.0, metavar="S", help="time until the first GPS fix"
    )
    parser.option(
        "--count",
        type=opt.whole(1, 64),
        default=1,
        metavar="N",
        help="number of vehicles, 5 m apart, with consecutive ids",
    )
    parser.option(
        "--system", type=opt.whole(1, 250), default=1, metavar="N", help="system id of the first vehicle; default 1"
    )
    parser.option("--seed", type=opt.whole(0, 2**31), default=0, metavar="N", help="seed of the GPS drift")
    parser.option(
        "--failsafe",
        type=failsafe,
        action="append",
        metavar="NAME@S",
        help=f"trigger a failsafe S seconds after the first take-off: {', '.join(FAILSAFES)}; may be repeated",
    )
    opt.add_duration(parser)


def home(text: str) -> tuple[float, ...]:
    """A converter for latitude, longitude, altitude."""
    place = _three(text)
    if not (abs(place[0]) <= 90 and abs(place[1]) <= 180 and -500 <= place[2] <= 9000):
        raise argparse.ArgumentTypeError(f"{text!r}: expected LAT,LON,ALT in degrees and m, e.g. --home=46.0,7.7,1650")
    return place


def wind(text: str) -> tuple[float, ...]:
    """A converter for north, east, down."""
    air = _three(text)
    if not all(abs(v) <= 50 for v in air):
        raise argparse.ArgumentTypeError(f"{text!r}: expected N,E,D in m/s, at most 50 each, e.g. --wind=3,-1,0")
    return air


def failsafe(text: str) -> tuple[str, float]:
    """A converter for NAME@SECONDS."""
    name, _, seconds = text.partition("@")
    try:
        return FAILSAFES[FAILSAFES.index(name)], opt.number(0, 86_400)(seconds or "0")
    except (ValueError, argparse.ArgumentTypeError):
        expected = f"expected NAME@SECONDS, where NAME is one of {', '.join(FAILSAFES)}"
        raise argparse.ArgumentTypeError(f"{text!r}: {expected}, e.g. battery@30") from None


def _three(text: str) -> tuple[float, ...]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    return values if len(values) == 3 and all(map(math.isfinite, values)) else (math.inf,) * 3
