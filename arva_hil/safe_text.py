"""Text that came from outside, made safe to show: on a terminal, in one line of a log, in a cell of a spreadsheet.

Names of files, devices and programs, and what vehicles say, may hold anything: escape codes that set a terminal's
title, clear its screen or write over a line, marks that turn the reading direction, line breaks that fake a message.
"""

from __future__ import annotations

from typing import Final

_FORMULA: Final = ("=", "+", "-", "@")  # a spreadsheet computes a cell that begins so


def one_line(value: object) -> str:
    """`str(value)` with everything that is not printable escaped as in Python: `\\x1b`, `\\n`, `\\u202e`, `\\udcff`.

    That is all control characters (C0, DEL, C1), line and paragraph separators, format characters such as bidi
    overrides and zero-width ones, lone surrogates, private and unassigned characters, and spaces that are no space.
    """
    text = str(value)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def cell(value: object) -> str:
    """A text for a cell of a CSV file: one line, and no formula. Not for numbers, which may begin with a minus."""
    text = one_line(value)
    return f"'{text}" if text.lstrip().startswith(_FORMULA) else text
