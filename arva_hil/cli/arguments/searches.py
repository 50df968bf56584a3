"""What the commands take that search: each function adds a command's options."""

from __future__ import annotations

import argparse
import math

from arva_hil.cli import options as opt
from arva_hil.cli.live_options import add_live
from arva_hil.cli.web_option import add_web
from arva_hil.registry import MAVLINK_FORMATS, STRATEGIES


def search(parser: opt.CommandParser) -> None:
    """Search for the victim: reads the receiver's port, flies the autopilot, stops above the transmitter.

    The vehicle arms, takes off, searches and lands by itself. The pilot takes it back with the mode switch, or by
    moving a stick, at any time: the search then says nothing more to it. Ctrl-C leaves it hovering; a landing goes on.
    A receiver that is unplugged is looked for while it hovers. The autopilot's link is looked for before anything is
    armed; lost later, it leaves the vehicle to its own failsafe.
    A simulator says what it is when asked. Any other vehicle is armed only when somebody at the terminal types yes, or
    on --yes; without either the search ends with 2.
    On the bench: take the propellers off. Serial ports of flight controllers have 3.3 V levels, not 5 V, not RS-232.
    Say who has the sticks: one person, thumb on the mode switch, who does nothing else. --dry-run first: it orders
    nothing.
    Exit codes: 0 found, or a dry run that would have flown, 1 not sure, not found or failed, 2 usage or not allowed to
    arm, 3 no autopilot or no frames, 130 interrupted.
    """
    parser.option("--autopilot", "--master", type=opt.address, metavar="URL", help="where the autopilot is")
    parser.option("--receiver", type=opt.address, metavar="URL", help="the receiver's port")
    opt.add_format(parser, default="binary", without=MAVLINK_FORMATS)
    add_plan(parser)
    parser.option("--end", choices=("land", "hover"), default="land", help="what to do at the end; default land")
    seconds = opt.number(0.1, math.inf, " of s")
    parser.option(
        "--timeout",
        type=seconds,
        default=60.0,
        metavar="S",
        help="from the start until there are both links, a heartbeat, frames and a pose; default 60",
    )
    parser.option("--arm-timeout", type=seconds, default=60.0, metavar="S", help="for the autopilot to arm; default 60")
    parser.typed(
        "--yes",
        action="store_true",
        help="arm a vehicle that is not known to be a simulator, without asking; has no ARVA_HIL_ variable",
    )
    parser.option(
        "--dry-run",
        action="store_true",
        help="do everything but arm and move: wait for all, check all, say what would be asked and ordered, with the "
        "set-points for the readings of 5 s, and end; heartbeats and questions are sent (streams, parameters, "
        "whether it is a simulator), nothing that moves the vehicle",
    )
    parser.option(
        "--countdown",
        type=opt.number(0, 60, " of s"),
        default=3.0,
        metavar="S",
        help="said before it arms, when all is ready; default 3",
    )
    parser.typed(
        "--take-over",
        action="store_true",
        help="begin in the air: take a vehicle that hovers, armed, in AUTO, GUIDED, LOITER or BRAKE (PX4: mission or "
        "hold), for a second and 1 m above home at least; has no ARVA_HIL_ variable",
    )
    opt.add_target(parser)
    opt.add_signing(parser)
    parser.option(
        "--stream-rate", type=opt.number(4, 50, " of Hz"), default=10.0, metavar="HZ", help="of the pose; default 10"
    )
    add_live(parser)
    parser.option(
        "--gcs",
        type=opt.address,
        metavar="URL",
        help="show the place found, as ADSB_VEHICLE, and readings on a ground station: a link of its own, which nobody "
        "forwards to an autopilot, e.g. udpout:127.0.0.1:14555",
    )
    parser.option("--record", metavar="DIR", help="record the flight, how it ended and a picture into DIR")
    add_web(parser)
    parser.option("--json", action="store_true", help="how it ended, as a JSON object on stdout")


def demo(parser: opt.CommandParser) -> None:
    """Run the whole loop without hardware: a simulated vehicle, its receiver, and a search that finds the transmitter.

    Unless --speed is max, the vehicle's link and the receiver's port are pseudo-terminals.
    """
    parser.option("--speed", type=opt.speed, default=1.0, metavar="N|max", help="multiple of real time; default 1")
    parser.option("--headless", action="store_true", help="print plain lines only, without a live status")
    parser.option(
        "--count",
        type=opt.whole(1, 64),
        metavar="N",
        help="number of drones that divide the area, 5 m apart at the start; default 1, or the scenario's vehicles",
    )
    add_plan(parser)
    opt.add_scenario(parser)
    add_live(parser)
    opt.add_common(parser)
    add_web(parser, default="on, with --headless off")


def add_plan(parser: opt.CommandParser) -> None:
    """Options that say how is searched."""
    parser.option(
        "--strategy",
        type=opt.kind(STRATEGIES),
        default="estimate",
        metavar="NAME",
        help=f"{', '.join(STRATEGIES)}, or MODULE:CLASS of your own; default estimate",
    )
    parser.option(
        "--max-speed", type=opt.number(0.2, 10, " of m/s"), default=1.0, metavar="M/S", help="horizontal; default 1"
    )
    metres = opt.number(0.3, 100, " of m")
    parser.option("--height", type=metres, default=3.0, metavar="M", help="held above the ground; default 3")
    parser.option(
        "--trust-height",
        action="store_true",
        help="hold --height as it is where neither rangefinder nor barometer tells it: not 3 sigma of GPS higher",
    )
    parser.option("--take-off", type=metres, default=3.0, metavar="M", help="height of the take-off; default 3")
    parser.option(
        "--mount",
        type=mount,
        default=(0.0,) * 6,
        metavar="X,Y,Z[,R,P,Y]",
        help="where the receiver sits on the vehicle, m forward, right and down of its centre, and its roll, pitch and "
        "yaw there, degrees; default 0,0,0,0,0,0",
    )
    parser.option(
        "--area",
        type=area,
        default=(-50.0, -50.0, 50.0, 50.0),
        metavar="S,W,N,E",
        help="searched in strips before the first signal, m from the take-off point; 100 m outside it the search ends; "
        "default=-50,-50,50,50",
    )
    parser.option(
        "--strip-width", type=opt.number(1, 1000, " of m"), default=40.0, metavar="M", help="of the strips; default 40"
    )
    seconds = opt.number(1, 86400, " of s")
    parser.option(
        "--patience", type=seconds, default=10.0, metavar="S", help="hover without frames, then end; default 10"
    )
    parser.option(
        "--limit", type=seconds, default=900.0, metavar="S", help="end the search after this long; default 900"
    )


def area(text: str) -> tuple[float, float, float, float]:
    """A converter for south,west,north,east."""
    try:
        south, west, north, east = (float(part) for part in text.split(","))
    except ValueError:
        south = west = north = east = math.nan
    if not (-10_000 <= south < north <= 10_000 and -10_000 <= west < east <= 10_000):
        raise argparse.ArgumentTypeError(f"{text!r}: expected south,west,north,east in m, e.g. --area=-50,-50,50,50")
    return south, west, north, east


def mount(text: str) -> tuple[float, ...]:
    """A converter for x,y,z[,roll,pitch,yaw]: all six."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    place, angles = values[:3], values[3:] or [0.0, 0.0, 0.0]
    valid = len(place) == len(angles) == 3
    valid = valid and all(abs(m) <= 10 for m in place) and all(abs(angle) <= 360 for angle in angles)
    if not valid:
        what = "expected x,y,z in m and, where it is turned, roll,pitch,yaw in degrees"
        raise argparse.ArgumentTypeError(f"{text!r}: {what}, e.g. --mount=0.3,0,0.1,0,0,90")
    return *place, *angles
