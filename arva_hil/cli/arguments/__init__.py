"""The options of each command: one function a command; its docstring is the description. Importing them is quick."""

from __future__ import annotations

import importlib
from collections.abc import Callable

from arva_hil.cli.options import CommandParser, module_name


def arguments_of(command: str) -> Callable[[CommandParser], None]:
    """The function that adds a command's options to its parser."""
    from arva_hil.cli.arguments import files, runs, searches  # which `cli` needs not before

    name = module_name(command)
    found: Callable[[CommandParser], None] | None = next(
        (vars(module)[name] for module in (runs, searches, files) if name in vars(module)), None
    )
    if found is None:  # a command that has its options in its own module
        found = importlib.import_module(f"arva_hil.cli.{name}").options
    return found
