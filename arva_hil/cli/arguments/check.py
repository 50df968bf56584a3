"""Validate scenario files and plans of campaigns. Prints every mistake with line and column, or a summary."""

from __future__ import annotations

from arva_hil.cli.options import CommandParser


def add_options(parser: CommandParser) -> None:
    parser.add_argument("files", nargs="*", metavar="FILE", help="scenario or plan of a campaign (YAML)")
    parser.add_argument(
        "--schema",
        nargs="?",
        const="scenario",
        choices=("scenario", "campaign"),
        help="print the JSON Schema of these files, for editors, and check nothing; default: scenario",
    )
