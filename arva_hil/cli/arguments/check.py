"""Validate scenario files, plans of campaigns and profiles. Prints every mistake with line and column, or a summary."""

from __future__ import annotations

from arva_hil.cli.options import CommandParser


def add_options(parser: CommandParser) -> None:
    parser.add_argument("files", nargs="*", metavar="FILE", help="scenario, plan of a campaign or profile (YAML)")
    parser.add_argument(
        "--schema",
        nargs="?",
        const="scenario",
        choices=("scenario", "campaign", "receiver", "transmitter"),
        help="print the JSON Schema of these files, for editors, and check nothing; default: scenario",
    )
