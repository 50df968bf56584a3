"""List the serial ports, and mark those that look like an autopilot."""

from __future__ import annotations

from arva_hil.cli.options import CommandParser


def add_options(parser: CommandParser) -> None:
    parser.option("--json", action="store_true", help="print a JSON object for each port")
