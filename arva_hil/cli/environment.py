"""Finds environment variables that look like an option but are not one, and suggests the nearest option."""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Iterable, Mapping
from typing import Final

from arva_hil.cli.options import PREFIX, CommandParser, module_name

OF_THE_TESTS: Final = ("ARVA_HIL_ARDUCOPTER", "ARVA_HIL_PX4")  # the simulators of tests/sitl


def unknown_variables(environment: Mapping[str, str], parser: CommandParser, commands: Iterable[str]) -> list[str]:
    """A message for each variable that none of `commands` reads.

    The other commands are imported only if there is a variable that `parser` does not read.
    """
    unread = {name for name, value in environment.items() if name.startswith(PREFIX) and value}
    unread -= {*parser.variables, *OF_THE_TESTS}
    if not unread:
        return []
    known, typed = set(parser.variables), set(parser.typed_only)
    for command in commands:
        other = CommandParser(prog=command)
        importlib.import_module(f"arva_hil.cli.arguments.{module_name(command)}").add_options(other)
        known |= set(other.variables)
        typed |= set(other.typed_only)
    return [_say(name, known, typed) for name in sorted(unread - known)]


def _say(name: str, known: Iterable[str], typed: Iterable[str]) -> str:
    flag = "--" + name.removeprefix(PREFIX).lower().replace("_", "-")
    if flag in typed:
        return f"{name} is not read: type {flag} each time"
    near = difflib.get_close_matches(name.removeprefix(PREFIX), [one.removeprefix(PREFIX) for one in known], 1)
    return f"{name} is not an option of any command" + (f"; did you mean {PREFIX}{near[0]}?" if near else "")
