"""Options: groups that commands share, their environment variables, and the values that they accept."""

from __future__ import annotations

import argparse
import difflib
import math
import os
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, NoReturn

from arva_hil.cli.outcome import UsageError
from arva_hil.cli.terminal import show
from arva_hil.config import FRAMES_HZ, LARGEST_SEED
from arva_hil.errors import KindError
from arva_hil.links import AddressError, parse
from arva_hil.registry import FORMATS, OBSERVERS, Registry

if TYPE_CHECKING:
    from arva_hil.config import Fault

DEFAULT_AUTOPILOT: Final = "udpin:127.0.0.1:14550"
PREFIX: Final = "ARVA_HIL_"
_NUMBER: Final = r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?|inf"


class CommandParser(argparse.ArgumentParser):
    """An argument parser that reads the environment too: `--rate` is also ARVA_HIL_RATE, weaker than the option."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False, **kwargs)
        self._environment: dict[str, argparse.Action] = {}
        self.typed_only: list[str] = []  # flags without an environment variable
        self._given: Sequence[str] = ()
        self.tells_sources = False  # whether the result has `sources`: where each option was given

    def option(self, *flags: str, **kwargs: Any) -> None:
        """`add_argument` for an option that has an environment variable too."""
        action = self.add_argument(*flags, **kwargs)
        self._environment[PREFIX + action.dest.upper()] = action

    def typed(self, flag: str, **kwargs: Any) -> None:
        """`add_argument` for a flag without an environment variable, so that a forgotten one cannot set it."""
        self.add_argument(flag, **kwargs)
        self.typed_only.append(flag)

    @property
    def arguments(self) -> Sequence[argparse.Action]:
        """All arguments, positional ones too."""
        return self._actions

    @property
    def variables(self) -> list[str]:
        """The names of the environment variables."""
        return list(self._environment)

    def parse(self, arguments: Sequence[str], environment: Mapping[str, str] | None = None) -> argparse.Namespace:
        """Parse the command line and the environment. Raises UsageError."""
        environment = os.environ if environment is None else environment
        self._given = arguments
        weaker: list[str] = []
        for name, action in self._environment.items():
            if value := environment.get(name):
                weaker += self._from_environment(name, value, action)
        options = self.parse_args([*weaker, *arguments])
        if self.tells_sources:
            options.sources = self._sources(arguments, environment)
        return options

    def _sources(self, arguments: Sequence[str], environment: Mapping[str, str]) -> dict[str, str]:
        """Where each option that was given comes from, by its name in the namespace."""
        nothing = argparse.Namespace(**{action.dest: None for action in self._actions})
        typed = vars(self.parse_args(arguments, nothing))
        twins = {action.dest: name for name, action in self._environment.items() if environment.get(name)}
        return {
            dest: "command line" if value is not None else f"environment, {twins[dest]}"
            for dest, value in typed.items()
            if value is not None or dest in twins
        }

    def _from_environment(self, name: str, value: str, action: argparse.Action) -> list[str]:
        flag = action.option_strings[0]
        if action.nargs == 0:
            if value.lower() not in ("0", "1", "no", "yes", "false", "true"):
                raise UsageError(f"{name}={value}: expected 1 or 0")
            return [flag] if value.lower() in ("1", "yes", "true") else []
        values = value.split() if isinstance(action, argparse._AppendAction) else [value]
        try:
            for one in values:
                self._get_values(action, [one])
        except argparse.ArgumentError as error:
            raise UsageError(f"{name}={value}: {error.message}") from None
        return [f"{flag}={one}" for one in values]

    def _print_message(self, message: str, file: object = None) -> None:
        """Print the help on stdout. argparse itself hides an error of stdout."""
        for line in message.splitlines():
            show(line)

    def error(self, message: str) -> NoReturn:
        hint = ""
        if unknown := re.match(r"unrecognized arguments: (\S+)", message):
            word = re.sub(r"^[-\N{EN DASH}\N{EM DASH}\N{MINUS SIGN}]+", "--", unknown[1]).lower()
            near = difflib.get_close_matches(word.partition("=")[0], self._option_string_actions, 1)
            hint = f"; did you mean {near[0]}?" if near else ""
        elif missing := re.match(r"argument (\S+): expected one argument", message):
            flags = missing[1].split("/")
            follows = next((after for flag, after in pairwise(self._given) if flag in flags), "")
            if follows[:1] == "-" and follows not in self._option_string_actions:
                hint = f"; write a value that begins with a dash after =: {flags[0]}={follows}"
        raise UsageError(f"{message}{hint}", f"see {self.prog} --help")


def module_name(command: str) -> str:
    """The name of a command's module in `cli`, and of its function in `cli.arguments`."""
    return command.replace("-", "_")


def number(low: float, high: float, unit: str = "") -> Callable[[str], float]:
    """A converter for a finite number from `low` to `high`, both included."""

    def convert(text: str) -> float:
        value = float(text) if re.fullmatch(_NUMBER, text) else math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r}: expected a number{unit} {_range(low, high)}")
        return value

    return convert


def whole(low: int, high: int) -> Callable[[str], int]:
    """A converter for a whole number from `low` to `high`, both included."""

    def convert(text: str) -> int:
        value = int(text) if re.fullmatch("[-+]?[0-9]{1,19}", text) else low - 1
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r}: expected a whole number {low}…{high}")
        return value

    return convert


def _range(low: float, high: float) -> str:
    return f"of at least {low:g}" if high == math.inf else f"{low:g}…{high:g}"


def speed(text: str) -> float:
    """A converter for how much faster than real time; `max` is infinity."""
    return math.inf if text == "max" else number(0.01, 1000)(text)


def address(text: str) -> str:
    """A converter that accepts only connection strings."""
    try:
        parse(text)
    except (AddressError, KindError) as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


def fault(text: str) -> Fault | None:
    """A converter for a fault; `none` is None."""
    from arva_hil.config import parse_fault  # slow to import

    try:
        return None if text == "none" else parse_fault(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def kind(registry: Registry, without: Collection[str] = ()) -> Callable[[str], str]:
    """A converter for a name in a registry that is not in `without`. It imports only kinds that are not built in."""

    def convert(text: str) -> str:
        usual = [name for name in registry if name not in without]
        if text in without:
            raise argparse.ArgumentTypeError(f"{text!r}: expected {', '.join(usual)} or one of another package")
        try:
            if text not in usual:
                registry[text]
        except KindError as error:
            raise argparse.ArgumentTypeError(str(error)) from None
        return text

    return convert


def add_format(parser: CommandParser, *, default: str | None = None, without: Collection[str] = ()) -> None:
    """The format of frames; without a default the scenario's."""
    names = ", ".join(name for name in FORMATS if name not in without)
    usual = default or "the scenario's"
    parser.option(
        "--format",
        type=kind(FORMATS, without),
        default=default,
        metavar="NAME",
        help=f"format of the frames: {names}; default {usual}",
    )


def add_scenario(parser: CommandParser) -> None:
    """Options of what is emulated."""
    parser.option(
        "--scenario",
        metavar="FILE",
        help="scenario (YAML), or builtin:NAME; default: one transmitter 20 m N, 5 m E of home",
    )
    add_format(parser)
    parser.option("--rate", type=number(*FRAMES_HZ, " of Hz"), metavar="HZ", help="frames per second, 0.1…50")
    parser.option("--seed", type=whole(0, LARGEST_SEED), metavar="N", help="seed of the noise and the faults")
    parser.option(
        "--fault",
        type=fault,
        action="append",
        metavar="NAME=VALUE@FROM-UNTIL",
        help="add a fault, e.g. drop=0.02@10-60, in seconds from the start; `none` removes all faults before it",
    )


def add_autopilot(parser: CommandParser) -> None:
    """Options of the autopilot's side."""
    parser.option(
        "--autopilot",
        "--master",
        type=address,
        metavar="URL",
        help=f"link to the autopilot; default: the one on USB, else {DEFAULT_AUTOPILOT}",
    )
    parser.option(
        "--stream-rate",
        type=number(1, 200, " of Hz"),
        default=50.0,
        metavar="HZ",
        help="rate of position and attitude to request; default 50",
    )


def add_target(parser: CommandParser) -> None:
    """Options that choose the vehicle to follow."""
    parser.option("--target-system", type=whole(1, 255), metavar="N", help="follow only this MAVLink system id")
    parser.option("--target-component", type=whole(1, 255), metavar="N", help="… and component id; default 1")


def add_signing(parser: CommandParser) -> None:
    """MAVLink 2 signing."""
    parser.option(
        "--signing-key",
        metavar="FILE",
        help="sign packets, and accept only packets signed with the same key; the file contains 64 hexadecimal digits "
        "or a passphrase as in MAVProxy and QGroundControl, and only its owner may read it",
    )


def add_max_age(parser: CommandParser) -> None:
    """How old a pose may be."""
    parser.option(
        "--max-age", type=number(0.05, 60, " of s"), default=2.0, metavar="S", help="do not use older poses; default 2"
    )


def add_duration(parser: CommandParser) -> None:
    """The time to run."""
    seconds = number(0.001, math.inf, " of s")
    parser.option("--duration", type=seconds, default=math.inf, metavar="S", help="end after this long")


def add_common(parser: CommandParser) -> None:
    """Options of nearly every command."""
    parser.option("--record", metavar="DIR", help="record packets, frames and readings in the folder DIR")
    parser.option("--json", action="store_true", help="print a JSON object for each frame and event on stdout")
    parser.option(
        "--observer",
        type=kind(OBSERVERS),
        action="append",
        metavar="NAME",
        help="add an observer of an installed package, which gets every event",
    )
    parser.option("-v", "--verbose", action="count", default=0, help="print a line for every frame")
