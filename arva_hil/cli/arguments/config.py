"""Print the settings that `run` would use with these options, and where each value comes from.

The command line is stronger than the environment, which is stronger than the file, which is stronger than the default.
The output is a scenario file with the same settings.
"""

from __future__ import annotations

from arva_hil.cli import options as opt
from arva_hil.cli.arguments import run


def add_options(parser: opt.CommandParser) -> None:
    run.add_options(parser)
    parser.tells_sources = True
