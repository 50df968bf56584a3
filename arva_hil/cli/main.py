"""`arva-hil`: finds the command, runs it, and turns each error into one message and an exit code."""

from __future__ import annotations

import functools
import gc
import importlib
import inspect
import io
import itertools
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import ModuleType
from typing import Final

from arva_hil import __version__, registry
from arva_hil.cli.arguments import arguments_of, parser_of
from arva_hil.cli.options import PREFIX, CommandParser, module_name
from arva_hil.cli.outcome import (
    FAILED,
    INTERRUPTED,
    NO_READER,
    OK,
    Failure,
    UsageError,
    code_of,
    interrupting,
    traceback_lines,
    unexpected_error,
)
from arva_hil.cli.terminal import StdoutError, StdoutReaderGone, abandon, flush, refuse_closed, reserve, show, tell
from arva_hil.errors import ArvaError, nearest

OF_THE_TESTS: Final = ("ARVA_HIL_ARDUCOPTER", "ARVA_HIL_PX4", "ARVA_HIL_FLIGHTS", "ARVA_HIL_LUA_STREAMS")


def unknown_variables(environment: Mapping[str, str], parser: CommandParser, commands: Iterable[str]) -> list[str]:
    """Return a message for each variable that none of `commands` reads.

    The other commands are imported only if there is a variable that `parser` does not read.
    """
    unread = {name for name, value in environment.items() if name.startswith(PREFIX) and value}
    unread -= {*parser.variables, *OF_THE_TESTS}
    if not unread:
        return []
    known, typed = set(parser.variables), set(parser.typed_only)
    for other in map(parser_of, commands):
        known |= set(other.variables)
        typed |= set(other.typed_only)
    return [_say(name, known, typed) for name in sorted(unread - known)]


def commands_with(flag: str) -> list[str]:
    """Return the commands that have an option, at most three."""
    found = (one for one in COMMANDS if any(flag in action.option_strings for action in parser_of(one).arguments))
    return list(itertools.islice(found, 3))


def _say(name: str, known: Iterable[str], typed: Iterable[str]) -> str:
    flag = "--" + name.removeprefix(PREFIX).lower().replace("_", "-")
    if flag in typed:
        return f"{name} is not read: type {flag} each time"
    near = nearest(name.removeprefix(PREFIX), [one.removeprefix(PREFIX) for one in known])
    return f"{name} is not an option of any command" + (f"; did you mean {PREFIX}{near}?" if near else "")


COMMANDS: Final = {
    "run": "emulate the receiver (the default command)",
    "replay": "emulate the receiver from a recorded flight (.tlog)",
    "demo": "search and find a transmitter, all simulated; no hardware",
    "search": "find the victim: read the receiver's port, fly the autopilot",
    "record": "record a real receiver beside a real autopilot",
    "decode": "decode the bytes of such a record once more",
    "compare": "compare a record with the emulator, or two records",
    "fit": "estimate a receiver's profile from records",
    "report": "write a page about a record, or about two side by side",
    "plot": "draw a record or a campaign",
    "export": "write a record for maps, spreadsheets and other programs",
    "range-test": "measure at which distance the scenario's receiver detects",
    "campaign": "fly a plan of many trials and compare the strategies",
    "listen": "decode and print frames, like a consumer",
    "command": "send a command to a receiver, e.g. mark 3, print its answer",
    "serve": "serve a receiver and a vehicle for your tests, by JSON lines",
    "conform": "judge your decoder by the clauses of PROTOCOL.md",
    "view": "open a record as a page in a browser, with a time slider",
    "check": "validate scenario files",
    "vehicle": "run the built-in simulated vehicle alone",
    "scenarios": "list the built-in scenarios",
    "ports": "list the serial ports",
    "doctor": "find what is wrong with the links, and the cure",
    "config": "print the settings of `run`, and the source of each value",
    "completion": "print a script that completes command lines in a shell",
}
HELP: Final = """\
usage: arva-hil [COMMAND] [OPTIONS]

Emulates an avalanche transceiver (ARVA) receiver on a drone: reads the
autopilot's MAVLink position and attitude, and sends the frames that a real
receiver would send there.

commands:
{commands}

examples:
  arva-hil --port /dev/ttyUSB0      frames to a serial port; autopilot on USB
  arva-hil --port pty:/tmp/arva0 --autopilot udpin:127.0.0.1:14550
  arva-hil replay flight.tlog --out frames.bin
  arva-hil demo

`arva-hil COMMAND --help` lists the options of a command. Most options can also
be set in the environment as ARVA_HIL_<OPTION>. A variable of that form that is
no option of any command causes a warning.
Exit codes: 0 ok, 1 failed while running, 2 usage or configuration, 3 no link or
no heartbeat in time, 130 interrupted."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    reserve()
    code = _guarded(arguments)
    try:
        sys.stderr.flush()
    except OSError:
        abandon(sys.stderr)
    return code


def _guarded(arguments: list[str]) -> int:
    """Run one command; returns an exit code for every error."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # do not fail on a terminal without °
    try:
        run = _command(arguments)  # a signal ends the process at once: see __main__.py
        with interrupting():
            code = run() or OK
            flush()
        return code
    except KeyboardInterrupt:
        return INTERRUPTED
    except StdoutReaderGone:
        abandon(sys.stdout)
        return NO_READER
    except ArvaError as error:
        first, *rest = error.lines if isinstance(error, Failure) else getattr(error, "problems", ()) or [error]
        tell(f"arva-hil: {first}", *rest)
        if isinstance(error, StdoutError):
            abandon(sys.stdout)
        return code_of(error)
    except Exception as error:
        if {"-v", "-vv", "--verbose"} & set(arguments):
            tell(*traceback_lines(error))
        tell(f"arva-hil: {unexpected_error(error)}")
        return FAILED


def _command(arguments: list[str]) -> Callable[[], int | None]:
    """Return the command that the arguments name, imported, with its options."""
    arguments = ["--help" if argument in ("-help", "-?", "/?") else argument for argument in arguments]
    if arguments[:1] == ["help"] and len(arguments) > 1:
        arguments = [arguments[1], "--help"]
    if arguments[:1] in (["-h"], ["--help"], ["help"]):
        return _show_help
    if arguments[:1] == ["--version"]:
        return functools.partial(show, f"arva-hil {__version__}")
    name = "run"
    if arguments and not arguments[0].startswith("-"):
        name = arguments.pop(0)
        if name not in COMMANDS and name not in registry.COMMANDS:
            every = [*COMMANDS, *registry.COMMANDS.names()]
            near = nearest(name, every)
            hint = f"did you mean {near}?" if near else f"the commands are {', '.join(every)}"
            if name.startswith(("\N{EN DASH}", "\N{EM DASH}", "\N{MINUS SIGN}")):
                hint = f"did you mean --{name.lstrip(name[0])}, with two hyphens?"
            elif name.endswith(".tlog"):
                hint = f"did you mean replay {name}?"
            elif name == "pty" or name.startswith(("/dev/", "pty:", "tcp", "udp")):
                hint = f"did you mean --port {name}?"
            raise UsageError(f"no command {name!r}; {hint}")
    add_options = arguments_of(name) if name in COMMANDS else registry.COMMANDS[name].options
    parser = CommandParser(prog=f"arva-hil {name}", description=inspect.getdoc(add_options))
    add_options(parser)
    parser.commands_with = commands_with
    try:
        options = parser.parse(arguments)
    except SystemExit:  # argparse has printed the help
        return lambda: None
    tell(*(f"warning: {line}" for line in unknown_variables(os.environ, parser, COMMANDS)))
    refuse_closed(options)
    if name not in COMMANDS:
        return functools.partial(registry.COMMANDS[name].main, options)
    return functools.partial(_imported(f"arva_hil.cli.{module_name(name)}").main, options)


def _show_help() -> None:
    others = {name: f"of the package {package}" for name, package in registry.COMMANDS.packages().items()}
    lines = "\n".join(f"  {name:<10} {what}" for name, what in (COMMANDS | others).items())
    show(*HELP.format(commands=lines).splitlines())


def _imported(name: str) -> ModuleType:
    """Import a module and all that it needs, faster than `import`.

    The garbage collector is off meanwhile, because it would visit the new objects again and again. numpy's library
    may start only one thread, because 3 × 3 matrices need no more.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.disable()
    try:
        return importlib.import_module(name)
    finally:
        gc.freeze()  # the objects made so far are never freed
        gc.enable()
