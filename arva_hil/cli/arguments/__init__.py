"""The options of each command: one function a command; its docstring is the description. Importing them is quick."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from importlib.util import find_spec

from arva_hil import registry
from arva_hil.cli.options import CommandParser, module_name


def arguments_of(command: str) -> Callable[[CommandParser], None]:
    """Return the function that adds a command's options to its parser. Raises KindError for a broken plug-in."""
    from arva_hil.cli.arguments import files, runs, searches  # which `cli` needs not before

    name = module_name(command)
    own = next((vars(module)[name] for module in (runs, searches, files) if name in vars(module)), None)
    if own is None and find_spec(f"arva_hil.cli.{name}"):  # a command that has its options in its own module
        own = getattr(importlib.import_module(f"arva_hil.cli.{name}"), "options", None)
    found: Callable[[CommandParser], None] = own or registry.COMMANDS[command].options
    return found
