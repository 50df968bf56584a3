"""The options of the commands: one function a command; its docstring is the description."""

from __future__ import annotations

from collections.abc import Callable

from arva_hil.cli.options import CommandParser, module_name


def arguments_of(command: str) -> Callable[[CommandParser], None]:
    """Return the function that adds the options of one of our own commands to its parser."""
    from arva_hil.cli.arguments import others, records, runs, searches  # slow to import, and not needed before

    found: Callable[[CommandParser], None] = (vars(runs) | vars(searches) | vars(records) | vars(others))[
        module_name(command)
    ]
    return found
