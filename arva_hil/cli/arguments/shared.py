"""Options that several commands have, in groups."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import TYPE_CHECKING, Final

from arva_hil.cli.options import DEFAULT_AUTOPILOT, Adder, kind, link, number, numbers, option, whole
from arva_hil.config.ranges import FRAMES_HZ, LARGEST_SEED
from arva_hil.observers.web.address import HostPort, parse_address
from arva_hil.registry import FORMATS, OBSERVERS

if TYPE_CHECKING:
    from arva_hil.config import Fault

FOXGLOVE: Final = HostPort(port=8765)  # the default of Foxglove and PlotJuggler
OFF: Final = "off"


_place: Final = numbers(
    "LAT,LON,ALT in degrees and m AMSL",
    (-90, 90),
    (-180, 180),
    (-500, 9000),
    names=("latitude", "longitude", "altitude"),
)


def surveyed(text: str) -> tuple[int, float, float, float]:
    """Convert ID=LAT,LON,ALT."""
    id_, equals, place = text.partition("=")
    if not equals:
        raise ValueError(f"{text!r}: expected ID=LAT,LON,ALT, e.g. 1=46.0123,7.7456,1650")
    lat, lon, alt = _place(place)
    return whole(0, 254)(id_), lat, lon, alt


def fault(text: str) -> Fault | None:
    """Convert a fault; `none` becomes None."""
    from arva_hil.config import parse_fault  # slow to import

    return None if text == "none" else parse_fault(text)


def observer(text: str) -> tuple[str, dict[str, str]]:
    """Convert NAME,KEY=VALUE,… to the name of an observer and its options."""
    name, *pairs = text.split(",")
    kind(OBSERVERS)(name)
    options = {key: value for key, equals, value in (pair.partition("=") for pair in pairs) if equals}
    if len(options) < len(pairs):
        raise ValueError(f"{text!r}: expected NAME,KEY=VALUE, each key once")
    return name, options


def foxglove(text: str) -> HostPort:
    """Convert the address of the server of messages."""
    return parse_address(text, FOXGLOVE)


def web(text: str) -> HostPort | str:
    """Convert the address of the page; "off" means none."""
    if text in ("on", OFF):
        return OFF if text == OFF else HostPort()
    try:
        return parse_address(text)
    except ValueError as error:
        raise ValueError(f"{error}, on or off") from None


def format_option(*, default: str | None = None, without: Collection[str] = ()) -> Adder:
    """Return the option for the format of frames; without a default it is the scenario's."""
    names = ", ".join(name for name in FORMATS if name not in without)
    usual = default or "the scenario's"
    return option("--format NAME", f"format of the frames: {names}; default {usual}", kind(FORMATS, without), default)


SCENARIO: Final = (
    option("--scenario FILE", "scenario (YAML), or builtin:NAME; default: one transmitter 20 m N, 5 m E of home"),
    format_option(),
    option("--rate HZ", "frames per second, 0.1…50", number(*FRAMES_HZ, " of Hz")),
    option("--seed N", "seed of the noise and the faults", whole(0, LARGEST_SEED)),
    option(
        "--fault NAME=VALUE@FROM-UNTIL",
        "add a fault, e.g. drop=0.02@10-60, in seconds from the start; none removes all faults before it",
        fault,
        action="append",
    ),
)
SURVEYED: Final = option(
    "--transmitter ID=LAT,LON,ALT",
    "surveyed place of a transmitter, degrees and m AMSL; may be repeated",
    surveyed,
    action="append",
    environment=False,
)
AUTOPILOT: Final = (
    option(
        "--autopilot --master URL", f"link to the autopilot; default: the one on USB, else {DEFAULT_AUTOPILOT}", link
    ),
    option("--stream-rate HZ", "rate of position and attitude to request", number(1, 200, " of Hz"), 50.0),
)
TARGET: Final = (
    option("--target-system N", "follow only this MAVLink system id", whole(1, 255)),
    option("--target-component N", "follow only this MAVLink component id; default 1", whole(1, 255)),
)
SIGNING: Final = option(
    "--signing-key FILE",
    "sign packets, and accept only packets signed with the same key; the file has 64 hexadecimal digits or a "
    "passphrase as in MAVProxy and QGroundControl; only its owner may read it",
)
GPS_NOISE: Final = option("--gps-noise M", "sigma of the GPS drift on each axis", number(0, 1000), 0.0)
MAX_AGE: Final = option("--max-age S", "ignore poses older than this", number(0.05, 60, " of s"), 2.0)
DURATION: Final = option(
    "--duration S", "end after this long; default: never", number(0.001, math.inf, " of s"), math.inf
)
LIVE: Final = (
    option(
        "--foxglove HOST:PORT",
        "serve ROS 2 messages to Foxglove, Lichtblick and PlotJuggler: HOST, PORT or HOST:PORT; the next free port if "
        f"this one is taken; without a value {FOXGLOVE}; needs the extra foxglove; all programs and web pages on this "
        "computer can read the messages",
        foxglove,
        const=FOXGLOVE,
    ),
    option(
        "--ros2",
        "publish the same messages in ROS 2, on this computer only, unless ROS_AUTOMATIC_DISCOVERY_RANGE is set; "
        "needs rclpy of a sourced ROS 2 environment",
    ),
)
"""The options that send events to other programs during a run."""


def web_options(*, default: str = OFF) -> tuple[Adder, ...]:
    """Return the options for the page in a browser. `default`: in words."""
    return (
        option(
            "--web HOST:PORT",
            "open a page about the run in a browser: on, off, HOST, PORT or HOST:PORT; the next free port if this one "
            f"is taken; without a value {HostPort()}; default {default}",
            web,
            const=HostPort(),
        ),
        option(
            "--map FILE",
            "picture under the page's map: a GeoTIFF or MBTiles file on this computer; needs the extra maps; default: "
            "hillshade and contour lines of the scenario's terrain file",
        ),
    )


def common_options(*, web: str = OFF) -> tuple[Adder, ...]:
    """Return the options of every command that runs or replays a scenario. `web`: default of --web, in words."""
    return (
        *LIVE,
        option("--record DIR", "record packets, frames and readings in the folder DIR"),
        option("--json", "print a JSON object for each frame and event on stdout"),
        option(
            "--observer NAME[,KEY=VALUE]",
            "add an observer of an installed package, or MODULE:CLASS, with its options",
            observer,
            action="append",
        ),
        option("-v --verbose", "print a line for every frame", None, 0, action="count"),
        *web_options(default=web),
    )
