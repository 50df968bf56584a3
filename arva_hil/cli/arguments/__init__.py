"""The options of each command: one function a command; its docstring is the description. Importing them is quick."""

from __future__ import annotations

from collections.abc import Callable

from arva_hil.cli.options import CommandParser, module_name


def arguments_of(command: str) -> Callable[[CommandParser], None]:
    """The function that adds a command's options to its parser."""
    from arva_hil.cli.arguments import files, runs, searches  # which `cli` needs not before

    found: Callable[[CommandParser], None] = next(
        vars(module)[name] for module in (runs, searches, files) if (name := module_name(command)) in vars(module)
    )
    return found
