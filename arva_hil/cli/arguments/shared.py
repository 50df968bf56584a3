"""Options that several commands have, in groups: each function adds one."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import TYPE_CHECKING, Final

from arva_hil.cli.options import DEFAULT_AUTOPILOT, CommandParser, kind, link, number, whole
from arva_hil.config.ranges import FRAMES_HZ, LARGEST_SEED
from arva_hil.observers.web.address import HostPort, parse_address
from arva_hil.registry import FORMATS, OBSERVERS

if TYPE_CHECKING:
    from arva_hil.config import Fault

FOXGLOVE: Final = HostPort(port=8765)  # what Foxglove and PlotJuggler offer
OFF: Final = "off"


def add_format(parser: CommandParser, *, default: str | None = None, without: Collection[str] = ()) -> None:
    """The format of frames; without a default the scenario's."""
    names = ", ".join(name for name in FORMATS if name not in without)
    usual = default or "the scenario's"
    parser.option("--format NAME", f"format of the frames: {names}; default {usual}", kind(FORMATS, without), default)


def add_scenario(parser: CommandParser) -> None:
    """Options of what is emulated."""
    default = "one transmitter 20 m N, 5 m E of home"
    parser.option("--scenario FILE", f"scenario (YAML), or builtin:NAME; default: {default}")
    add_format(parser)
    parser.option("--rate HZ", "frames per second, 0.1…50", number(*FRAMES_HZ, " of Hz"))
    parser.option("--seed N", "seed of the noise and the faults", whole(0, LARGEST_SEED))
    how = "add a fault, e.g. drop=0.02@10-60, in seconds from the start; `none` removes all faults before it"
    parser.option("--fault NAME=VALUE@FROM-UNTIL", how, fault, action="append")


def add_autopilot(parser: CommandParser) -> None:
    """Options of the autopilot's side."""
    usual = f"link to the autopilot; default: the one on USB, else {DEFAULT_AUTOPILOT}"
    parser.option("--autopilot --master URL", usual, link)
    rate = number(1, 200, " of Hz")
    parser.option("--stream-rate HZ", "rate of position and attitude to request", rate, 50.0)


def add_target(parser: CommandParser) -> None:
    """Options that choose the vehicle to follow."""
    parser.option("--target-system N", "follow only this MAVLink system id", whole(1, 255))
    parser.option("--target-component N", "… and component id; default 1", whole(1, 255))


def add_signing(parser: CommandParser) -> None:
    """MAVLink 2 signing."""
    parser.option(
        "--signing-key FILE",
        "sign packets, and accept only packets signed with the same key; the file contains 64 hexadecimal digits "
        "or a passphrase as in MAVProxy and QGroundControl, and only its owner may read it",
    )


def add_max_age(parser: CommandParser) -> None:
    """Add the option for the greatest age of a pose."""
    parser.option("--max-age S", "do not use older poses", number(0.05, 60, " of s"), 2.0)


def add_duration(parser: CommandParser) -> None:
    """The time to run."""
    parser.option("--duration S", "end after this long; default: never", number(0.001, math.inf, " of s"), math.inf)


def add_common(parser: CommandParser, *, web: str = OFF) -> None:
    """Options of every command that runs or replays a scenario. `web`: what is the default of --web, for a person."""
    add_live(parser)
    parser.option("--record DIR", "record packets, frames and readings in the folder DIR")
    parser.option("--json", "print a JSON object for each frame and event on stdout")
    own = "add an observer of an installed package, which gets every event"
    parser.option("--observer NAME", own, kind(OBSERVERS), action="append")
    parser.option("-v --verbose", "print a line for every frame", None, 0, action="count")
    add_web(parser, default=web)


def add_live(parser: CommandParser) -> None:
    """Options that send what happens to other people's tools while the program runs."""
    parser.option(
        "--foxglove HOST:PORT",
        "serve ROS 2 messages to Foxglove, Lichtblick and PlotJuggler: HOST, PORT or HOST:PORT; if the port is "
        f"taken, the next free one; without a value {FOXGLOVE}. Needs the extra foxglove. Every program and every web "
        "page on this computer can read them",
        foxglove,
        const=FOXGLOVE,
    )
    parser.option(
        "--ros2",
        "publish the same messages in ROS 2, on this computer unless ROS_AUTOMATIC_DISCOVERY_RANGE says "
        "otherwise; needs rclpy, which a sourced ROS 2 environment has",
    )


def add_web(parser: CommandParser, *, default: str = OFF) -> None:
    """The page in a browser."""
    parser.option(
        "--web HOST:PORT",
        "show the run on a page in a browser: on, off, HOST, PORT or HOST:PORT; if the port is taken, the next "
        f"free one; without a value {HostPort()}; default {default}",
        web,
        const=HostPort(),
    )


def fault(text: str) -> Fault | None:
    """A converter for a fault; `none` is None."""
    from arva_hil.config import parse_fault  # slow to import

    return None if text == "none" else parse_fault(text)


def foxglove(text: str) -> HostPort:
    """A converter for where the messages are served."""
    return parse_address(text, FOXGLOVE)


def web(text: str) -> HostPort | str:
    """A converter for where the page is; "off" is none."""
    if text in ("on", OFF):
        return OFF if text == OFF else HostPort()
    try:
        return parse_address(text)
    except ValueError as error:
        raise ValueError(f"{error}, on or off") from None
