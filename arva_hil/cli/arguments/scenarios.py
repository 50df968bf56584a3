"""List the scenarios and campaign plans that are built in: use one as --scenario builtin:NAME."""

from __future__ import annotations

from arva_hil.cli.options import CommandParser


def add_options(parser: CommandParser) -> None:
    parser.option("--json", action="store_true", help="one JSON object a file")
