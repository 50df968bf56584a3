"""`arva-hil`: finds the command, runs it, turns what went wrong into one message and an exit code."""

from __future__ import annotations

import difflib
import gc
import importlib
import io
import os
import sys
from collections.abc import Sequence
from types import ModuleType
from typing import Final

from arva_hil import __version__
from arva_hil.cli.endings import interrupting, story, unforeseen
from arva_hil.cli.environment import strangers
from arva_hil.cli.options import CommandParser
from arva_hil.cli.outcome import FAILED, INTERRUPTED, NO_READER, OK, USAGE, Failure, UsageError
from arva_hil.cli.standard_streams import abandon, refuse_closed, reserve
from arva_hil.cli.terminal import ReaderGone, StdoutError, flush, show, tell
from arva_hil.errors import KindError

COMMANDS: Final = {
    "run": "emulate the receiver: autopilot in, frames out (the default command)",
    "replay": "the same from a recorded flight (.tlog), as fast as wanted",
    "demo": "a simulated vehicle searches for a transmitter and finds it; no hardware",
    "search": "find the victim: reads the receiver's port, flies the autopilot",
    "campaign": "fly a plan of many trials and compare the strategies",
    "listen": "decode and print frames, like a consumer",
    "check": "validate scenario files",
    "vehicle": "the built-in vehicle alone, on as many links as wanted",
    "scenarios": "which scenarios are built in",
    "ports": "what is plugged in",
    "doctor": "what is wrong, and the cure",
    "config": "what holds for `run`, and where each value comes from",
    "completion": "a script that completes command lines in bash, zsh or fish",
}
HELP: Final = """\
usage: arva-hil [COMMAND] [OPTIONS]

Emulates an avalanche transceiver (ARVA) receiver on a drone: reads the autopilot's
MAVLink position and attitude, sends the frames a real receiver would send there.

commands:
{commands}

examples:
  arva-hil --port /dev/ttyUSB0                      frames to a serial port, the USB autopilot found
  arva-hil --port pty:/tmp/arva0 --autopilot udpin:127.0.0.1:14550
  arva-hil replay flight.tlog --out frames.bin
  arva-hil demo

`arva-hil COMMAND --help` shows a command's options. Nearly each is also read from the environment
as ARVA_HIL_<OPTION>; a variable of such a name that is no option of any command is named.
Exit codes: 0 ok, 1 failed while running, 2 usage or configuration, 3 no link or no heartbeat in
time, 130 interrupted."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; gives back the exit code."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    reserve()
    code = _guarded(arguments)
    try:
        sys.stderr.flush()
    except OSError:
        abandon(sys.stderr)
    return code


def _guarded(arguments: list[str]) -> int:
    """The exit code, whatever goes wrong."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a terminal without ° is no reason to fail
    try:
        with interrupting():
            code = _command(arguments)
            flush()
        return code
    except Failure as failure:
        first, *rest = failure.lines
        for line in (f"arva-hil: {first}", *rest):
            tell(line)
        return failure.code
    except KindError as error:
        tell(f"arva-hil: {error}")
        return USAGE
    except ReaderGone:
        abandon(sys.stdout)
        return NO_READER
    except StdoutError as error:
        tell(f"arva-hil: {error}")
        abandon(sys.stdout)
        return FAILED
    except KeyboardInterrupt:
        return INTERRUPTED
    except Exception as error:
        if {"-v", "-vv", "--verbose"} & set(arguments):
            for line in story(error):
                tell(line)
        tell(f"arva-hil: {unforeseen(error)}")
        return FAILED


def _command(arguments: list[str]) -> int:
    arguments = ["--help" if argument in ("-help", "-?", "/?") else argument for argument in arguments]
    if arguments[:1] in (["-h"], ["--help"], ["help"]):
        for line in HELP.format(
            commands="\n".join(f"  {name:<10} {what}" for name, what in COMMANDS.items())
        ).splitlines():
            show(line)
        return OK
    if arguments[:1] == ["--version"]:
        show(f"arva-hil {__version__}")
        return OK
    name = "run"
    if arguments and not arguments[0].startswith("-"):
        name = arguments.pop(0)
        if name not in COMMANDS:
            near = difflib.get_close_matches(name, COMMANDS, 1)
            hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(COMMANDS)}"
            if name.startswith(("\N{EN DASH}", "\N{EM DASH}", "\N{MINUS SIGN}")):
                hint = f"did you mean --{name.lstrip(name[0])}, with two hyphens?"
            elif name.endswith(".tlog"):
                hint = f"did you mean replay {name}?"
            elif name == "pty" or name.startswith(("/dev/", "pty:", "tcp", "udp")):
                hint = f"did you mean --port {name}?"
            raise UsageError(f"no command {name!r}; {hint}")
    arguments_of = importlib.import_module(f"arva_hil.cli.arguments.{name}")
    parser = CommandParser(prog=f"arva-hil {name}", description=arguments_of.__doc__)
    arguments_of.add_options(parser)
    try:
        options = parser.parse(arguments)
    except SystemExit:  # argparse has printed the help
        return OK
    for line in strangers(os.environ, parser, COMMANDS):
        tell(f"warning: {line}")
    refuse_closed(options)
    return int(_imported(f"arva_hil.cli.{name}").main(options))


def _imported(name: str) -> ModuleType:
    """A module and all that it needs, at less cost than by itself.

    The collector would walk again and again what is being made, and numpy's library would start a thread for each
    core, of which matrices of 3 × 3 make no use.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.disable()
    try:
        return importlib.import_module(name)
    finally:
        gc.freeze()  # what is made by now stays
        gc.enable()
