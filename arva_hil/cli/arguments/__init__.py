"""The options of commands whose modules import slowly: one function a command; its docstring is the description."""

from __future__ import annotations

import importlib
from collections.abc import Callable

from arva_hil.cli.options import CommandParser, module_name


def arguments_of(command: str) -> Callable[[CommandParser], None]:
    """Return the function that adds the options of one of our own commands to its parser."""
    from arva_hil.cli.arguments import runs, searches  # slow to import, and not needed before

    name = module_name(command)
    own = next((vars(module)[name] for module in (runs, searches) if name in vars(module)), None)
    found: Callable[[CommandParser], None] = own or importlib.import_module(f"arva_hil.cli.{name}").options
    return found
