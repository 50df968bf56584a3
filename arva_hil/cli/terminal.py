"""Where a command's lines go: data on stdout, everything else on stderr. The only place of `cli` that prints.

Whatever is in a line, it stays one line and changes nothing else on a terminal.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from arva_hil.cli.standard_streams import abandon
from arva_hil.errors import ArvaError
from arva_hil.safe_text import one_line


class StdoutError(ArvaError):
    """Standard output takes nothing: its disk is full."""


class ReaderGone(StdoutError):
    """Nobody reads the pipe that stdout is any more, as after `| head`."""


def tell(line: object) -> None:
    """A line for a person, on stderr."""
    try:
        print(one_line(line), file=sys.stderr)
    except OSError:  # whoever was told is gone, or the disk is full
        abandon(sys.stderr)


def show(line: object, *, mark: str = "") -> None:
    """A line of data on stdout, at once. `mark` goes before it as it is, colours and all. Raises StdoutError."""
    _print(mark + one_line(line))


def show_json(value: Any) -> None:
    """A JSON object on a line of its own on stdout, at once; ASCII without control characters. Raises StdoutError."""
    _print(json.dumps(value).replace("\x7f", "\\u007f"))


def flush() -> None:
    """Have on stdout what others have printed there, too. Raises StdoutError."""
    _print("", end="")


def _print(text: str, end: str = "\n") -> None:
    try:
        print(text, end=end, flush=True)
    except BrokenPipeError as error:
        raise ReaderGone(f"stdout: {error}") from None
    except OSError as error:
        raise StdoutError(f"stdout: {error}") from None
