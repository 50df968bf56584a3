"""Print what would hold for `run` with these options, and where each value comes from: default, file, environment or
command line, each of which is stronger than those before. The output is a scenario file that says the same.
"""

from __future__ import annotations

from arva_hil.cli import options as opt
from arva_hil.cli.arguments import run


def add_options(parser: opt.CommandParser) -> None:
    run.add_options(parser)
    parser.tells_sources = True
