"""Options of the commands that fly a search: each function adds those of one command."""

from __future__ import annotations

import math
import re
from typing import Final

from arva_hil.cli.arguments import shared
from arva_hil.cli.options import CommandParser, kind, link, number, numbers, option, speed, whole
from arva_hil.registry import MAVLINK_FORMATS, STRATEGIES

_AREA = "south,west,north,east in m, e.g. --area=-50,-50,50,50"
_FAR_M = 10_000  # a corner of the area


def strip_width(text: str) -> float | str:
    """Convert a width in metres, or the name of a receiver that gives it."""
    is_number = not text or text[0] in "+-.0123456789"
    return number(1, 1000, " of m")(text) if is_number else text


def victims(text: str) -> int | str:
    """Convert the number of transmitters to find, or `all`."""
    try:
        return text if text == "all" else whole(1, 16)(text)
    except ValueError as error:
        raise ValueError(f"{error}, or all") from None


def area(text: str) -> tuple[float, ...]:
    """Convert south,west,north,east."""
    south, west, north, east = numbers(_AREA, *[(-_FAR_M, _FAR_M)] * 4)(text)
    if not (south < north and west < east):
        raise ValueError(f"{text!r}: expected {_AREA}")
    return south, west, north, east


def scheduler(text: str) -> str:
    """Convert the address of a Dask scheduler."""
    if not re.fullmatch(r"(tcp|tls)://\S+:\d{1,5}", text):
        raise ValueError(f"{text!r}: expected an address such as tcp://192.168.1.5:8786")
    return text


def shard(text: str) -> tuple[int, int]:
    """Convert K/N, with K from 1 to N."""
    match = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text)
    k, n = map(int, match.groups()) if match else (0, 0)
    if not 1 <= k <= n:
        raise ValueError(f"{text!r}: expected K/N with K from 1 to N, e.g. 3/100")
    return k, n


mount = numbers(
    "x,y,z in m and, where it is turned, roll,pitch,yaw in degrees, e.g. --mount=0.3,0,0.1,0,0,90",
    *[(-10, 10)] * 3,
    *[(-360, 360)] * 3,
    optional=3,
)

_METRES: Final = number(0.3, 100, " of m")
_SECONDS: Final = number(1, 86400, " of s")
PLAN: Final = (
    option("--strategy NAME", f"{', '.join(STRATEGIES)}, or MODULE:CLASS of your own", kind(STRATEGIES), "estimate"),
    option(
        "--victims N|all",
        "number of transmitters to find, one after the other; all: every one that the receiver detects from the strips "
        "of the whole area",
        victims,
        1,
    ),
    option("--max-speed M/S", "largest horizontal speed", number(0.2, 10, " of m/s"), 1.0),
    option("--height M", "height above the ground to hold", _METRES, 3.0),
    option(
        "--trust-height",
        "hold --height also if only GPS measures the height; otherwise the vehicle then flies 3 sigma higher",
    ),
    option("--take-off M", "height of the take-off", _METRES, 3.0),
    option(
        "--mount X,Y,Z[,R,P,Y]",
        "place of the receiver on the vehicle: m forward, right and down of its centre; then roll, pitch and yaw in "
        "degrees; default: that of each receiver in the scenario, without one 0,0,0,0,0,0",
        mount,
    ),
    option(
        "--area S,W,N,E",
        "area to search in strips before the first signal: south, west, north, east of the take-off point, m; the "
        "search ends if the vehicle is 100 m outside; default=-50,-50,50,50",
        area,
        (-50.0, -50.0, 50.0, 50.0),
    ),
    option(
        "--strip-width M|auto|PROFILE",
        "width of the strips; auto: the largest at which the scenario's receiver detects the weakest transmitter; a "
        "receiver profile (a file or builtin:NAME): the largest for that receiver",
        strip_width,
        40.0,
    ),
    option(
        "--patience S",
        "hover this long, then end, if no frames come or the strategy does not answer",
        _SECONDS,
        10.0,
    ),
    option("--limit S", "end the search after this long", _SECONDS, 900.0),
)
"""The options of the search itself."""
TEAM: Final = (
    option(
        "--scenario FILE",
        "scenario of spec 2: its vehicles divide the area around its datum; of its receivers the ports, formats and "
        "mounts are used, its transmitters are not; has no ARVA_HIL_ variable",
        environment=False,
    ),
    option(
        "--vehicle NAME",
        "fly only this vehicle of the scenario; other programs fly the others and exchange data by MAVLink TUNNEL",
        environment=False,
    ),
)
"""The options of several vehicles."""
FLIGHT: Final = (
    option(
        "--timeout S",
        "end if both links, a heartbeat, frames and a pose are not there this long after the start",
        number(0.1, math.inf, " of s"),
        60.0,
    ),
    option("--arm-timeout S", "end if the autopilot does not arm in this time", number(0.1, math.inf, " of s"), 60.0),
    option("--countdown S", "count down this long before arming, when all is ready", number(0, 60, " of s"), 3.0),
    option(
        "--yes",
        "arm a vehicle that is not known to be a simulator, without asking; has no ARVA_HIL_ variable",
        environment=False,
    ),
    option(
        "--dry-run",
        "check everything, print the question and the commands of the flight, with set-points for 5 s of readings, "
        "and end; search arms and moves nothing: it sends only heartbeats and requests (streams, parameters, "
        "the simulator's identity)",
    ),
    option(
        "--take-over",
        "start in the air: take over an armed vehicle that hovers for 1 s, at least 1 m above home, in AUTO, GUIDED, "
        "LOITER or BRAKE (PX4: mission or hold); has no ARVA_HIL_ variable",
        environment=False,
    ),
    option("--end", "action at the end", None, "land", choices=("land", "hover")),
)
"""The options of the start and the end of a flight."""


def search(parser: CommandParser) -> None:
    """Search for the victim: read the receiver's port, fly the vehicle to the transmitter, and land there.

    Before a flight: take the propellers off on the bench. The serial ports of flight controllers have 3.3 V levels,
    not 5 V and not RS-232. One person holds the sticks, with a thumb on the mode switch, and does nothing else. Try
    --dry-run first: it sends no command.

    The vehicle arms, takes off, searches and lands by itself. A simulator identifies itself as one. For any other
    vehicle, search asks at the terminal before it arms, or needs --yes; without either it ends with 2.

    The pilot can take over at any time. Mode switch: the search sends no more commands. Stick: the vehicle stops, the
    search requests LOITER (PX4: Hold) once, and sends nothing after that. Ctrl-C: the vehicle hovers; a landing that
    has begun continues.

    If the receiver is unplugged, the vehicle hovers and the search reopens the port. If the autopilot's link is lost
    before arming, the search reopens it. If it is lost after arming, the vehicle's own failsafe takes over.

    Exit codes: 0 found (all that --victims asks for), or a dry run that would have flown; 1 not sure, not found or
    failed; 2 usage or not allowed to arm; 3 no autopilot or no frames; 130 interrupted.
    """
    parser.usual("--autopilot --receiver --strategy --victims --height --take-off --area --limit --dry-run --record")
    parser.options(
        option("--autopilot --master URL", "link to the autopilot", link),
        option("--receiver URL", "link to the receiver's port", link),
    )
    parser.group("search", shared.format_option(default="binary", without=MAVLINK_FORMATS), *PLAN)
    parser.set_defaults(format=None)  # binary, or that of the scenario's receivers
    parser.group("several vehicles", *TEAM)
    parser.group("start and end of the flight", *FLIGHT)
    parser.group(
        "autopilot",
        *shared.TARGET,
        shared.SIGNING,
        option("--stream-rate HZ", "rate of position and attitude to request", number(4, 50, " of Hz"), 10.0),
    )
    parser.group(
        "output",
        *shared.LIVE,
        option(
            "--gcs URL",
            "send the place found, as ADSB_VEHICLE, and readings to a ground station: a separate link that is not "
            "forwarded to an autopilot, e.g. udpout:127.0.0.1:14555",
            link,
        ),
        option("--record DIR", "record the flight, its outcome and a picture in the folder DIR"),
        *shared.web_options(),
        option("--json", "print the outcome of the search as a JSON object on stdout"),
    )


def demo(parser: CommandParser) -> None:
    """Run the whole loop without hardware: a simulated vehicle, its receiver, and a search that finds the transmitter.

    Unless --speed is max, the vehicle's link and the receiver's port are pseudo-terminals.
    """
    parser.usual("--speed --headless --count --gps-noise --strategy --victims --area --scenario --record --web")
    parser.options(
        option("--speed N|max", "multiple of real time", speed, 1.0),
        option("--headless", "print plain lines only, without a live status"),
        option(
            "--count N",
            "number of drones that divide the area, 5 m apart at the start; default 1, or the scenario's vehicles",
            whole(1, 64),
        ),
        shared.GPS_NOISE,
    )
    parser.group("search", *PLAN)
    parser.group("scenario", *shared.SCENARIO)
    parser.group("output", *shared.common_options(web="on, with --headless off"))


def campaign(parser: CommandParser) -> None:
    """Fly a plan of many trials, on all cores or a cluster, and compare the strategies.

    Each result is saved in DIR/results.sqlite at once. At the end results.csv and report.html are written too.
    The same command continues a campaign that was stopped.
    """
    parser.add_argument(
        "plan",
        metavar="PLAN.yaml",
        help="plan of the campaign, or a built-in one such as builtin:campaigns/paper: see arva-hil scenarios",
    )
    parser.options(
        option("--out DIR", "folder of the results and the report; default: PLAN-results"),
        option("--jobs N", "number of processes; default: one for each core", whole(1, 1024)),
        option("--scheduler tcp://HOST:PORT", "run on a Dask cluster instead", scheduler),
        option(
            "--shard K/N",
            "fly only part K of N of the plan, every N-th seed; default folder: PLAN-results-K-of-N",
            shard,
        ),
        option(
            "--merge DIR",
            "fly nothing: copy the results of these folders and write the report",
            nargs="+",
            action="extend",
        ),
        option("--dry-run", "list the trials, without flying or writing"),
        option("--json", "print a JSON object for each trial on stdout"),
    )
