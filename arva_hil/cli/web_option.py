"""The option --web."""

from __future__ import annotations

import argparse
from typing import Final

from arva_hil.cli.options import CommandParser
from arva_hil.observers.web.address import Address, parse_address

OFF: Final = "off"


def add_web(parser: CommandParser, *, default: str = OFF) -> None:
    """The page in a browser."""
    parser.option(
        "--web",
        nargs="?",
        const=Address(),
        type=web,
        metavar="HOST:PORT",
        help="show the run on a page in a browser: on, off, HOST, PORT or HOST:PORT; if the port is taken, the next "
        f"free one; without a value {Address()}; default {default}",
    )


def web(text: str) -> Address | str:
    """A converter for where the page is; "off" is none."""
    if text in ("on", OFF):
        return OFF if text == OFF else Address()
    try:
        return parse_address(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{error}, on or off") from None


def page_address(text: str) -> Address:
    """A converter for where a page is."""
    try:
        return parse_address(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
