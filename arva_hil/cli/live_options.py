"""Options that send what happens to other people's tools while the program runs."""

from __future__ import annotations

import argparse
from typing import Final

from arva_hil.cli import options as opt
from arva_hil.observers.web.address import Address, parse_address

FOXGLOVE: Final = Address(port=8765)  # what Foxglove and PlotJuggler offer


def add_live(parser: opt.CommandParser) -> None:
    """Options of every command that runs or replays."""
    parser.option(
        "--foxglove",
        nargs="?",
        const=FOXGLOVE,
        type=foxglove,
        metavar="HOST:PORT",
        help="serve ROS 2 messages to Foxglove, Lichtblick and PlotJuggler: HOST, PORT or HOST:PORT; if the port is "
        f"taken, the next free one; without a value {FOXGLOVE}. Needs the extra foxglove. Every program and every web "
        "page on this computer can read them",
    )
    parser.option(
        "--ros2",
        action="store_true",
        help="publish the same messages in ROS 2, on this computer unless ROS_AUTOMATIC_DISCOVERY_RANGE says "
        "otherwise; needs rclpy, which a sourced ROS 2 environment has",
    )


def foxglove(text: str) -> Address:
    """A converter for where the messages are served."""
    try:
        return parse_address(text, FOXGLOVE)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
