"""List the built-in scenarios and campaign plans. Use one with --scenario builtin:NAME."""

from __future__ import annotations

from arva_hil.cli.options import CommandParser


def add_options(parser: CommandParser) -> None:
    parser.option("--json", action="store_true", help="print a JSON object for each file")
