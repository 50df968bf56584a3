"""Text for people: safe forms of text from outside, and lines broken between words.

Names of files, devices and programs, and texts from vehicles, may contain anything: escape codes that change a
terminal, marks that change the reading direction, line breaks that fake a message.
"""

from __future__ import annotations

import os
import textwrap
from collections.abc import Iterable, Sequence
from typing import Final, TextIO

_LONGEST: Final = 200  # characters of a repr
_FORMULA: Final = ("=", "+", "-", "@")  # the first character of a formula in a spreadsheet


def one_line(value: object) -> str:
    r"""Return `str(value)` with all unprintable characters escaped as in Python: `\x1b`, `\n`, `\u202e`, `\udcff`.

    These are control characters (C0, DEL, C1), line and paragraph separators, format characters such as bidi
    overrides and zero-width ones, lone surrogates, private and unassigned characters, and all spaces but U+0020.
    """
    text = str(value)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def shown(thing: object) -> str:
    """Return the shortened repr of a plug-in's object; its class if its own `__repr__` raises."""
    try:
        text = repr(thing)
    except Exception:
        text = f"a {type(thing).__name__}"
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def cell(value: object) -> str:
    """Return a text for a cell of a CSV file: one line, and not a formula.

    Not for numbers, because they may begin with "-".
    """
    text = one_line(value)
    return f"'{text}" if text.lstrip().startswith(_FORMULA) else text


def table_lines(rows: Iterable[Sequence[str]]) -> list[str]:
    """Return a table for a terminal, a line for each row: the first column to the left, all others to the right."""
    table = [*rows]
    first, *others = [max(map(len, column)) for column in zip(*table, strict=True)]
    return ["  ".join([row[0].ljust(first), *map(str.rjust, row[1:], others)]).rstrip() for row in table]


_FURTHER: Final = 2
_MOST: Final = 2  # an indent takes at most half of the columns


def wrapped(line: str, columns: int | None, further: int = _FURTHER) -> str:
    """Break a line between words for a terminal. `columns`: None without a terminal, the line stays as it is.

    Rows behind the first are indented by `further`, or by less on a narrow terminal. A part that is longer than a row,
    such as a path, stays whole, so that it can be copied.
    """
    if columns is None or len(line) <= columns:
        return line
    begin = line[: len(line) - len(line.lstrip())] if further == _FURTHER else ""
    indent = begin + " " * (further if further <= columns // _MOST else _FURTHER)
    return "\n".join(
        textwrap.wrap(line, columns, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    )


def columns_of(stream: TextIO | None) -> int | None:
    """Return the columns of a terminal; None for anything else, or if they are unknown."""
    if stream is None:
        return None
    try:
        return os.get_terminal_size(stream.fileno()).columns or None if is_screen(stream) else None
    except (OSError, ValueError):
        return None


def is_screen(stream: TextIO) -> bool:
    """Return True for a terminal whose lines can be overwritten."""
    return stream.isatty() and os.environ.get("TERM") != "dumb"
