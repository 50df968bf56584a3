"""What is plugged in: serial ports, and which of them look like an autopilot."""

from __future__ import annotations

from arva_hil.cli.options import CommandParser


def add_options(parser: CommandParser) -> None:
    parser.option("--json", action="store_true", help="one JSON object a port")
