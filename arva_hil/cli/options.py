"""Options: their environment variables, and converters for the values that they accept."""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any, Final, NoReturn

from arva_hil.cli.outcome import UsageError
from arva_hil.cli.terminal import show
from arva_hil.errors import ArvaError, nearest
from arva_hil.links import parse
from arva_hil.registry import Registry

DEFAULT_AUTOPILOT: Final = "udpin:127.0.0.1:14550"
_LINKS: Final = ("--autopilot", "--port", "--receiver", "--link")  # options whose value may have a baud rate
_BAUD: Final = ("--baud", "--baudrate", "--baud-rate")
PREFIX: Final = "ARVA_HIL_"
_WIDTH: Final = 80  # columns of the help
_ALL: Final = "--help-all"


class HelpFormatter(argparse.HelpFormatter):
    """A formatter that wraps between words only, and keeps paragraphs and indented lines of a description.

    argparse makes one for each option. Without a width it would ask for the terminal's, with slow imports.
    """

    def _split_lines(self, text: str, width: int) -> list[str]:
        import textwrap  # slow to import

        return textwrap.wrap(" ".join(text.split()), width, break_long_words=False, break_on_hyphens=False)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        paragraphs = []
        for paragraph in text.split("\n\n"):
            kept = any(line.startswith(" ") or "  " in line for line in paragraph.splitlines())
            paragraphs += [*(paragraph.splitlines() if kept else self._split_lines(paragraph, width)), ""]
        return "\n".join(indent + line for line in paragraphs[:-1])


_formatter: Final = partial(HelpFormatter, width=_WIDTH)
_NUMBER: Final = r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?|inf"


class CommandParser(argparse.ArgumentParser):
    """An argument parser that reads the environment too: `--rate` is also ARVA_HIL_RATE, weaker than the option."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(formatter_class=_formatter, allow_abbrev=False, **kwargs)
        self._usual: Sequence[str] = ()  # the flags that --help lists; all without groups
        self._group: argparse._ActionsContainer = self
        self.variables: dict[str, argparse.Action] = {}  # environment variables
        self.typed_only: list[str] = []  # flags without an environment variable
        self._given: Sequence[str] = ()
        self.tells_sources = False  # True: the result has `sources`, the place where each option was given
        self.commands_with: Callable[[str], Sequence[str]] = lambda flag: ()  # the other commands that have an option

    def option(
        self,
        names: str,
        help: str,
        convert: Callable[[str], Any] | None = None,
        default: Any = None,
        *,
        environment: bool = True,
        **more: Any,
    ) -> None:
        """Add an option.

        Args:
            names: its flags and the name of its value, e.g. "--rate HZ"; without a name it is a flag.
            help: its meaning. A default that is a number or a name is added, if the help does not have one.
            convert: makes the value of a text; None: any text but "". ValueError or ArvaError report a wrong text.
            default: its value if it is not given.
            environment: False if no variable may set the option.
            more: see `add_argument`; `const` is the value of the flag alone.
        """
        words = names.split()
        flags = [word for word in words if word.startswith("-")]
        if "const" in more:
            more["nargs"] = "?"
        if len(flags) < len(words):
            usual = folder if words[-1].startswith("DIR") else name
            more["metavar"], more["type"] = words[-1], convert or usual
        elif not more.keys() & {"choices", "action"}:
            more["action"], default = "store_true", False
        if "default" not in help and isinstance(default, int | float | str) and "action" not in more:
            help += f"; default {default if isinstance(default, str) else f'{default:g}'}"
        into = self if flags[0] in self._usual else self._group
        action = into.add_argument(*flags, default=default, help=help, **more)
        if environment:
            self.variables[PREFIX + action.dest.upper()] = action
        else:
            self.typed_only += flags

    def usual(self, flags: str) -> None:
        """Name the flags that `--help` lists. `--help-all` lists the others too, in groups."""
        self._usual = flags.split()
        self.add_argument(_ALL, action="help", help="list all options and exit")

    def options(self, *each: Adder) -> None:
        """Add options."""
        for add in each:
            add(self)

    def group(self, title: str, *each: Adder) -> None:
        """Add options, in a group of `--help-all` if they are not usual; options that follow are in it as well."""
        self._group = self.add_argument_group(title)
        self.options(*each)

    @property
    def arguments(self) -> Sequence[argparse.Action]:
        """All arguments, positional ones too."""
        return self._actions

    def parse(self, arguments: Sequence[str], environment: Mapping[str, str] | None = None) -> argparse.Namespace:
        """Parse the command line and the environment. Raises UsageError.

        `typed` of the result: the names of the options on the command line.
        """
        environment = os.environ if environment is None else environment
        if not self._usual:
            arguments = ["--help" if argument == _ALL else argument for argument in arguments]
        self._given = arguments
        weaker: list[str] = []
        for name, action in self.variables.items():
            if value := environment.get(name):
                weaker += self._from_environment(name, value, action)
        options = self.parse_args([*weaker, *arguments])
        flags = {word.partition("=")[0] for word in arguments}
        options.typed = {one.dest for one in self._actions if flags & set(one.option_strings)}
        if self.tells_sources:
            options.sources = self._sources(arguments, environment)
        return options

    def _sources(self, arguments: Sequence[str], environment: Mapping[str, str]) -> dict[str, str]:
        """Return the source of each option that was given, by its name in the namespace."""
        typed = vars(self.parse_args(arguments, argparse.Namespace(**{action.dest: None for action in self._actions})))
        twins = {action.dest: name for name, action in self.variables.items() if environment.get(name)}
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

    def _get_value(self, action: argparse.Action, text: str) -> Any:
        try:
            return action.type(text) if callable(action.type) else text
        except (ValueError, ArvaError) as error:
            raise argparse.ArgumentError(action, str(error)) from None

    def format_help(self) -> str:
        """Return the help: of the usual options alone, unless --help-all was given."""
        if not self._usual or _ALL in self._given:
            return super().format_help()
        shown = {"-h", "--help", _ALL, *self._usual}
        hidden = [one for one in self._actions if one.option_strings and not shown & set(one.option_strings)]
        for one in hidden:
            one.help = argparse.SUPPRESS  # for good: after its help a parser parses nothing
        return super().format_help() + f"\n{len(hidden)} more options: {self.prog} {_ALL}\n"

    def _print_message(self, message: str, file: object = None) -> None:
        """Print the help on stdout. argparse itself hides an error of stdout."""
        show(*message.splitlines())

    def error(self, message: str) -> NoReturn:
        hint = ""
        if unknown := re.match(r"unrecognized arguments: (\S+)", message):
            hint = self._cure(re.sub(r"^[-\N{EN DASH}\N{EM DASH}\N{MINUS SIGN}]+", "--", unknown[1]).lower())
        elif missing := re.match(r"argument (\S+): expected one argument", message):
            flags = missing[1].split("/")
            follows = next((after for flag, after in pairwise(self._given) if flag in flags), "")
            if follows[:1] == "-" and follows not in self._option_string_actions:
                hint = f"; write a value that begins with a dash after =: {flags[0]}={follows}"
        raise UsageError(f"{message}{hint}", f"see {self.prog} --help")

    def _cure(self, word: str) -> str:
        """Return the advice for an unknown option, "" if there is none."""
        flag = word.partition("=")[0]
        link = next((one for one in _LINKS if one in self._option_string_actions), None)
        if flag in _BAUD and link:
            return f"; write the baud rate after the port: {link} PORT,57600"
        known = flag in self._option_string_actions
        if flag.startswith("--") and not known and (commands := self.commands_with(flag)):
            return f"; {flag} is an option of {' and '.join(commands)}"
        near = nearest(flag, self._option_string_actions)
        return f"; did you mean {near}?" if near else ""


Adder = Callable[[CommandParser], None]
"""Adds an option to a parser."""


def option(names: str, help: str, *declared: Any, **more: Any) -> Adder:
    """Return an option for `CommandParser.options`; the arguments are those of `CommandParser.option`."""
    return lambda parser: parser.option(names, help, *declared, **more)


def module_name(command: str) -> str:
    """Return the name of a command's module in `cli`, and of its function in `cli.arguments`."""
    return command.replace("-", "_")


def name(text: str) -> str:
    """Convert the name of a file or another thing; an empty one is often that of a shell variable without a value."""
    if not text:
        raise ValueError("'' is empty: write a value, or leave the option out")
    return text


def folder(text: str) -> str:
    """Convert the name of a folder to write; `-` is that of stdout in other commands."""
    if text == "-":
        raise ValueError("'-': stdout is no folder: name one")
    return name(text)


def number(low: float, high: float, unit: str = "") -> Callable[[str], float]:
    """Return a converter for a finite number from `low` to `high`, both included."""

    def convert(text: str) -> float:
        value = float(text) if re.fullmatch(_NUMBER, text) else math.nan
        if not low <= value <= high:
            span = f"of at least {low:g}" if high == math.inf else f"{low:g}…{high:g}"
            raise ValueError(f"{text!r}: expected a number{unit} {span}")
        return value

    return convert


def whole(low: int, high: int) -> Callable[[str], int]:
    """Return a converter for a whole number from `low` to `high`, both included."""

    def convert(text: str) -> int:
        value = int(text) if re.fullmatch("[-+]?[0-9]{1,19}", text) else low - 1
        if not low <= value <= high:
            raise ValueError(f"{text!r}: expected a whole number {low}…{high}")
        return value

    return convert


def numbers(
    expected: str, *ranges: tuple[float, float], optional: int = 0, names: Sequence[str] = ()
) -> Callable[[str], tuple[float, ...]]:
    """Return a converter for numbers with commas between them, each in its range.

    `optional`: the count of numbers at the end that may be left out; they are 0. `names`: one for each number.
    """

    def convert(text: str) -> tuple[float, ...]:
        try:
            values = tuple(map(float, text.split(",")))
        except ValueError:
            values = ()
        if optional and len(values) == len(ranges) - optional:
            values += (0.0,) * optional
        if len(values) != len(ranges):
            raise ValueError(f"{text!r}: expected {expected}")
        for number, (value, (low, high)) in enumerate(zip(values, ranges, strict=True)):
            if not low <= value <= high:
                wrong = f"{names[number]} {value:g} is out of range ({low:g}…{high:g})" if names else ""
                raise ValueError(f"{text!r}: {wrong or f'expected {expected}'}")
        return values

    return convert


def speed(text: str) -> float:
    """Convert a multiple of real time; `max` is infinity."""
    return math.inf if text == "max" else number(0.01, 1000)(text)


def link(text: str) -> str:
    """Convert a connection string."""
    parse(text)
    return text


def kind(registry: Registry, without: Collection[str] = ()) -> Callable[[str], str]:
    """Return a converter for a name in a registry that is not in `without`.

    It imports only kinds that are not built in.
    """

    def convert(text: str) -> str:
        usual = [name for name in registry if name not in without]
        if text in without:
            raise ValueError(f"{text!r}: expected {', '.join(usual)} or one of another package")
        if text not in usual:
            registry[text]
        return text

    return convert
