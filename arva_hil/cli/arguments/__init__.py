"""The options of the commands: one function a command; its docstring is the description."""

from __future__ import annotations

from collections.abc import Callable

from arva_hil.cli.options import CommandParser, module_name


def arguments_of(command: str) -> Callable[[CommandParser], None]:
    """Return the function that adds the options of one of our own commands to its parser."""
    from arva_hil.cli.arguments import files, runs, searches  # slow to import, and not needed before

    found: Callable[[CommandParser], None] = (vars(runs) | vars(searches) | vars(files))[module_name(command)]
    return found


def parser_of(command: str) -> CommandParser:
    """Return the parser of one of our own commands."""
    parser = CommandParser(prog=f"arva-hil {command}")
    arguments_of(command)(parser)
    return parser
