"""Options that send what happens to other people's tools while the program runs."""

from __future__ import annotations

import argparse
import re
from typing import Final, NamedTuple

from arva_hil.cli import options as opt


class HostPort(NamedTuple):
    """Where to serve."""

    host: str
    port: int


FOXGLOVE: Final = HostPort("127.0.0.1", 8765)  # what Foxglove and PlotJuggler offer


def add_live(parser: opt.CommandParser) -> None:
    """Options of every command that runs or replays."""
    parser.option(
        "--foxglove",
        nargs="?",
        const=FOXGLOVE,
        type=host_port,
        metavar="HOST:PORT",
        help=f"serve ROS 2 messages to Foxglove, Lichtblick and PlotJuggler; default {FOXGLOVE.host}:{FOXGLOVE.port}; "
        "needs the extra foxglove. Every program and web page on this computer can read them",
    )
    parser.option(
        "--ros2",
        action="store_true",
        help="publish the same messages in ROS 2; needs rclpy, a sourced ROS 2 environment",
    )


def host_port(text: str) -> HostPort:
    """A converter for HOST:PORT, HOST or PORT; an IPv6 address is in brackets."""
    match = re.fullmatch(r"(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9.-]*[A-Za-z.-][A-Za-z0-9.-]*)?(?:(?:^|:)([0-9]{1,5}))?", text)
    if not text or not match or int(match[2] or 0) > 65535:
        example = f"{FOXGLOVE.host}:{FOXGLOVE.port}"
        raise argparse.ArgumentTypeError(f"{text!r}: expected HOST:PORT, e.g. {example}, or HOST or PORT")
    return HostPort((match[1] or FOXGLOVE.host).strip("[]"), int(match[2]) if match[2] else FOXGLOVE.port)
