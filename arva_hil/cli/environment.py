"""Variables in the environment that look like an option and are none: each is named, with the nearest that is one."""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Iterable, Mapping
from typing import Final

from arva_hil.cli.options import PREFIX, CommandParser

OF_THE_TESTS: Final = ("ARVA_HIL_ARDUCOPTER", "ARVA_HIL_PX4")  # name the simulators that tests/sitl fly on


def strangers(environment: Mapping[str, str], parser: CommandParser, commands: Iterable[str]) -> list[str]:
    """What to say of variables that no command reads. Those of other `commands` than `parser`'s are all right.

    The other commands are only looked at when there is a variable that this one does not read.
    """
    unread = {name for name, value in environment.items() if name.startswith(PREFIX) and value}
    unread -= {*parser.variables, *OF_THE_TESTS}
    if not unread:
        return []
    known, typed = set(parser.variables), set(parser.typed_only)
    for command in commands:
        other = CommandParser(prog=command)
        importlib.import_module(f"arva_hil.cli.arguments.{command}").add_options(other)
        known |= set(other.variables)
        typed |= set(other.typed_only)
    return [_say(name, known, typed) for name in sorted(unread - known)]


def _say(name: str, known: Iterable[str], typed: Iterable[str]) -> str:
    flag = "--" + name.removeprefix(PREFIX).lower().replace("_", "-")
    if flag in typed:
        return f"{name} is not read: {flag} has to be typed each time"
    near = difflib.get_close_matches(name.removeprefix(PREFIX), [one.removeprefix(PREFIX) for one in known], 1)
    return f"{name} is no option of any command" + (f"; did you mean {PREFIX}{near[0]}?" if near else "")
