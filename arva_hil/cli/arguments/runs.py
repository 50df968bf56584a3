"""What the commands take that run something or look at links: each function adds a command's options."""

from __future__ import annotations

import argparse
import math

from arva_hil.cli import options as opt
from arva_hil.cli.live_options import add_live
from arva_hil.cli.web_option import add_web
from arva_hil.registry import MAVLINK_FORMATS

FAILSAFES = ("geofence", "battery", "ekf", "radio")
HOME = (46.0123, 7.7456, 1650.0)


def run(parser: opt.CommandParser) -> None:
    """Emulate the receiver: read the autopilot's MAVLink packets, send the receiver's frames."""
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


def config(parser: opt.CommandParser) -> None:
    """Print the settings that `run` would use with these options, and where each value comes from.

    The command line is stronger than the environment, which is stronger than the file, which is stronger than the
    default.
    The output is a scenario file with the same settings.
    """
    run(parser)
    parser.tells_sources = True


def replay(parser: opt.CommandParser) -> None:
    """Replay a recorded flight through the emulator. The same log, scenario and seed give the same bytes."""
    parser.add_argument("log", metavar="LOG.tlog", help="MAVLink telemetry log")
    parser.option(
        "--port",
        type=opt.address,
        metavar="URL",
        help="send the frames there, at the speed of the log unless --speed is given",
    )
    parser.option("--out", metavar="FILE", help="write the frames to a file; - is stdout")
    parser.option(
        "--speed", type=opt.speed, metavar="N|max", help="multiple of real time; default 1 with --port, else max"
    )
    opt.add_scenario(parser)
    opt.add_target(parser)
    opt.add_max_age(parser)
    add_live(parser)
    opt.add_common(parser)
    add_web(parser)


def vehicle(parser: opt.CommandParser) -> None:
    """Run the built-in vehicle alone: a simulated multirotor that answers as ArduCopter does, on one or more links.

    A ground station and a search can use it together: `arva-hil vehicle --link udpout:127.0.0.1:14550 --link
    tcpin:127.0.0.1:5760`.
    """
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


def doctor(parser: opt.CommandParser) -> None:
    """Find what is wrong with the links, and the cure. Opens both sides as `run` would, and prints each finding."""
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


def listen(parser: opt.CommandParser) -> None:
    """Decode and print frames from a port or a file, like a consumer."""
    parser.add_argument("url", metavar="URL", help="a port, a file such as frames.bin of a record, or - for stdin")
    opt.add_format(parser, default="binary")
    parser.option("--count", type=opt.whole(1, 2**31), default=math.inf, metavar="N", help="end after N frames")
    opt.add_duration(parser)
    parser.option("--json", action="store_true", help="print a JSON object for each frame on stdout")


def command(parser: opt.CommandParser) -> None:
    """Send one command to a receiver and print its answer."""
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


def ports(parser: opt.CommandParser) -> None:
    """List the serial ports, and mark those that look like an autopilot."""
    parser.option("--json", action="store_true", help="print a JSON object for each port")


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
