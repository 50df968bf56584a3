"""Makes text from outside safe to show: on a terminal, in a line of a log, in a cell of a spreadsheet.

Names of files, devices and programs, and texts from vehicles, may contain anything: escape codes that change a
terminal, marks that change the reading direction, line breaks that fake a message.
"""

from __future__ import annotations

from typing import Final

_FORMULA: Final = ("=", "+", "-", "@")  # the first character of a formula in a spreadsheet


def one_line(value: object) -> str:
    """`str(value)` with all unprintable characters escaped as in Python: `\\x1b`, `\\n`, `\\u202e`, `\\udcff`.

    These are control characters (C0, DEL, C1), line and paragraph separators, format characters such as bidi
    overrides and zero-width ones, lone surrogates, private and unassigned characters, and all spaces but U+0020.
    """
    text = str(value)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def cell(value: object) -> str:
    """Text for a cell of a CSV file: one line, and not a formula. Not for numbers, because they may begin with "-"."""
    text = one_line(value)
    return f"'{text}" if text.lstrip().startswith(_FORMULA) else text
