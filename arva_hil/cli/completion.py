"""`arva-hil completion`: prints a script that completes command lines in a shell."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable
from typing import Final

import shtab

from arva_hil import registry
from arva_hil.cli.arguments import arguments_of
from arva_hil.cli.main import COMMANDS
from arva_hil.cli.options import CommandParser
from arva_hil.cli.terminal import show
from arva_hil.errors import KindError

_FILES: Final = (
    "FILE",
    "LOG.tlog",
    "PLAN.yaml",
    "PROFILE.yaml",
    "URL",
    "PORT",
    "DIR|FILE",
    "RUN|LOG",
)  # a URL or a port may be a device or a file of frames
_FOLDERS: Final = ("DIR", "RUN", "RUN2", "RECORD", "RECORD2")
_KINDS: Final = {"format": registry.FORMATS, "strategy": registry.STRATEGIES, "export_format": registry.EXPORTS}


def main(options: argparse.Namespace) -> None:
    root = CommandParser(prog="arva-hil")
    _add_options(root, arguments_of("run"))  # the default command
    root.add_argument("--version", action="store_true", help="print the version")
    commands = root.add_subparsers()
    for name, what in COMMANDS.items():
        _add_options(commands.add_parser(name, help=what), arguments_of(name))
    for name, package in registry.COMMANDS.packages().items():
        parser = commands.add_parser(name, help=f"of the package {package}")
        with contextlib.suppress(KindError):  # a broken package is reported when its command is used
            _add_options(parser, registry.COMMANDS[name].options)
    show(*shtab.complete(root, options.shell).expandtabs().splitlines())


def _add_options(parser: CommandParser, add: Callable[[CommandParser], None]) -> None:
    """Add the options of a command, and mark those that take file names."""
    add(parser)
    for action in parser.arguments:
        if action.metavar in _FILES:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
        elif action.metavar in _FOLDERS:
            action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
        elif action.dest in _KINDS:
            action.choices = list(_KINDS[action.dest])
