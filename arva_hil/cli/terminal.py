"""Prints a command's lines: data on stdout, everything else on stderr. No other module of `cli` prints.

Control characters in a line are replaced, so that it stays one line and cannot change the terminal.
"""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Callable, Iterator
from typing import Any, BinaryIO

from arva_hil.cli.standard_streams import abandon
from arva_hil.errors import ArvaError
from arva_hil.line_wrapping import columns_of, wrapped
from arva_hil.safe_text import one_line


class StdoutError(ArvaError):
    """Standard output cannot be written, e.g. its disk is full."""


class ReaderGone(StdoutError):
    """Stdout is a pipe, and its reader has ended, as with `| head`."""


def tell(line: object) -> None:
    """Print a line for a person on stderr; a terminal that is too narrow gets it in rows."""
    try:
        print(wrapped(one_line(line), columns_of(sys.stderr)), file=sys.stderr)
    except OSError:  # the reader is gone, or the disk is full
        abandon(sys.stderr)


def show(line: object) -> None:
    """Print a line of data on stdout, without buffering. Raises StdoutError."""
    _print(one_line(line))


def show_marked(mark: str, line: object, *, paint: Callable[[str], str], further: int) -> None:
    """Print a line for a person on stdout, behind a mark that `paint` may colour; a terminal that is too narrow gets it
    in rows, indented by `further`. Raises StdoutError.
    """
    rows = wrapped(mark + one_line(line), columns_of(sys.stdout), further)
    _print(paint(mark) + rows[len(mark) :])


def show_json(value: Any) -> None:
    """Print a JSON object in one line on stdout: ASCII without control characters. Raises StdoutError."""
    _print(json.dumps(value).replace("\x7f", "\\u007f"))


@contextlib.contextmanager
def binary_stdout() -> Iterator[BinaryIO]:
    """Stdout, for data that are no lines. Raises StdoutError."""
    try:
        yield sys.stdout.buffer
        sys.stdout.buffer.flush()
    except BrokenPipeError as error:
        raise ReaderGone(f"stdout: {error}") from None
    except OSError as error:
        raise StdoutError(f"stdout: {error}") from None


def flush() -> None:
    """Write the buffer of stdout. Raises StdoutError."""
    _print("", end="")


def _print(text: str, end: str = "\n") -> None:
    try:
        print(text, end=end, flush=True)
    except BrokenPipeError as error:
        raise ReaderGone(f"stdout: {error}") from None
    except OSError as error:
        raise StdoutError(f"stdout: {error}") from None
