"""Validate scenario files and plans of campaigns: every mistake at its line and column; of what is right, a summary."""

from __future__ import annotations

from arva_hil.cli.options import CommandParser


def add_options(parser: CommandParser) -> None:
    parser.add_argument("files", nargs="*", metavar="FILE", help="scenario or plan of a campaign (YAML)")
    parser.add_argument(
        "--schema",
        nargs="?",
        const="scenario",
        choices=("scenario", "campaign"),
        help="print the JSON Schema of such files, for editors, instead; default: scenario",
    )
