"""Prints a command's lines: data on stdout, everything else on stderr. No other module of `cli` prints or asks.

Control characters in a line are replaced, so that it stays one line and cannot change the terminal.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import select
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, BinaryIO, Final

from arva_hil.cli.outcome import FAILED, Failure, UsageError
from arva_hil.safe_text import columns_of, one_line, wrapped

if TYPE_CHECKING:
    from tqdm import tqdm


def reserve() -> None:
    """Open /dev/null for each closed stream, before anything else is opened.

    Otherwise the next port or socket gets the stream's number, and messages for stderr are sent there.
    """
    for fd in range(3):
        try:
            os.fstat(fd)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest number that is free: this one
    for fd, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:  # open for as long as the program runs
            setattr(sys, name, open(fd, "w" if fd else "r", errors="backslashreplace", closefd=False))  # noqa: SIM115


def refuse_closed(options: argparse.Namespace) -> None:
    """Raise UsageError if the options send data to stdout and it is closed. Lines for a person are just lost."""
    if sys.__stdout__ is not None:
        return
    if getattr(options, "json", False):
        raise UsageError("--json: the data go to stdout, which is closed")
    for name in ("port", "out", "junit"):
        if getattr(options, name, None) == "-":
            raise UsageError(f"--{name} -: the data go to stdout, which is closed")


def abandon(stream: object) -> None:
    """Discard all further output of a standard stream whose reader is gone, also at exit."""
    with contextlib.suppress(OSError, AttributeError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())  # type: ignore[attr-defined]
        os.close(nowhere)


class StdoutError(Failure):
    """Standard output cannot be written, e.g. its disk is full."""

    def __init__(self, error: OSError) -> None:
        super().__init__(FAILED, f"stdout: cannot be written: {error.strerror or error}")


class StdoutReaderGone(StdoutError):
    """Stdout is a pipe, and its reader has ended, as with `| head`."""


def tell(*lines: object) -> None:
    """Print lines for a person on stderr; a terminal that is too narrow gets them in rows."""
    try:
        for line in lines:
            print(wrapped(one_line(line), columns_of(sys.stderr)), file=sys.stderr)
    except OSError:  # the reader is gone, or the disk is full
        abandon(sys.stderr)


def show(*lines: object) -> None:
    """Print lines of data on stdout, without buffering. Raises StdoutError."""
    for line in lines:
        _print(one_line(line))


def show_marked(mark: str, line: object, *, paint: Callable[[str], str], further: int) -> None:
    """Print a line on stdout after a mark, which `paint` may colour.

    A terminal that is too narrow gets the line in rows, indented by `further`. Raises StdoutError.
    """
    _print(paint(mark) + wrapped(mark + one_line(line), columns_of(sys.stdout), further)[len(mark) :])


def show_json(*values: Any) -> None:
    """Print JSON objects on stdout, one a line: ASCII without control characters. Raises StdoutError."""
    for value in values:
        _print(json.dumps(value).replace("\x7f", "\\u007f"))


def show_one(value: Any, *lines: object, as_json: bool) -> None:
    """Print a JSON object for a program, or lines for a person. Raises StdoutError."""
    if as_json:
        show_json(value)
    else:
        show(*lines)


@contextlib.contextmanager
def binary_stdout() -> Iterator[BinaryIO]:
    """Open stdout for data that are no lines. Raises StdoutError."""
    with _stdout_errors():
        yield sys.stdout.buffer
        sys.stdout.buffer.flush()


def flush() -> None:
    """Write the buffer of stdout. Raises StdoutError."""
    _print("", end="")


def _print(text: str, end: str = "\n") -> None:
    with _stdout_errors():
        print(text, end=end, flush=True)


@contextlib.contextmanager
def _stdout_errors() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError as error:
        raise StdoutReaderGone(error) from None
    except OSError as error:
        raise StdoutError(error) from None


_FORM: Final = "{percentage:3.0f} % |{bar}| {n_fmt} of {total_fmt}{unit}, {remaining} left"


def bar(total: int, unit: str, *, done: int = 0, scaled: bool = False, shown: bool = True) -> tqdm[Any]:
    """Return a bar on stderr. It is erased when it is closed. `scaled`: numbers as 12.3k, for bytes."""
    from tqdm import tqdm  # slow to import

    return tqdm(
        total=total,
        initial=done,
        unit=unit,
        unit_scale=scaled,
        leave=False,
        dynamic_ncols=True,
        bar_format=_FORM,
        disable=not shown,
    )


def time_left(done: int, more: int, after_s: float) -> str:
    """Return the time for `more` if `done` took `after_s`, e.g. "about 0:17:25 left"; "" if unknown."""
    if not done or not more:
        return ""
    minutes, seconds = divmod(round(more * after_s / done), 60)
    hours, minutes = divmod(minutes, 60)
    return f"about {hours}:{minutes:02}:{seconds:02} left"


_MOST: int = 256  # bytes of an answer


class TerminalQuestion:
    """Reads a line typed at a terminal, without waiting for it. `say` prints the question.

    A program in the background does not read, because the terminal would stop it.
    """

    def __init__(self, say: Callable[[str], None], fd: int = 0) -> None:
        self._say = say
        self._fd = fd
        self._typed = b""

    def ask(self, label: str) -> None:
        """Ask if a vehicle, which is not known to be a simulator, may fly. Text that was typed before is discarded."""
        import termios

        with contextlib.suppress(termios.error):
            termios.tcflush(self._fd, termios.TCIFLUSH)
        self._typed = b""
        self._say(f"{label} is not known to be a simulator: propellers will turn. Type yes to let it fly: ")

    def answer(self) -> str | None:
        """Return the line typed since the question; None if there is none yet, "" if the terminal is closed."""
        try:
            while self._in_foreground() and select.select([self._fd], [], [], 0)[0]:
                chunk = os.read(self._fd, _MOST)
                self._typed += chunk
                line, end, _ = self._typed.replace(b"\r", b"\n").partition(b"\n")
                if end or not chunk or len(line) > _MOST:
                    return line.decode(errors="replace")
        except OSError:
            return ""
        return None

    def _in_foreground(self) -> bool:
        try:
            return os.tcgetpgrp(self._fd) == os.getpgrp()
        except OSError:  # it is not the controlling terminal, and stops no program
            return True


def somebody_is_there() -> bool:
    """Return True if a person can answer a question: stdin and stderr are terminals."""
    try:
        return os.name == "posix" and sys.stdin.isatty() and sys.stderr.isatty() and sys.stdin.fileno() == 0
    except (AttributeError, OSError, ValueError):
        return False
