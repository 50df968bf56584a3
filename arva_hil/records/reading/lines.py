"""Reads a record's text files line by line, in little memory, and reports the place of a mistake.

A killed program or a full disk leaves a cut last line. It is reported, and not used.
"""

from __future__ import annotations

import csv
import json
import math
import os
import re
import stat
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.clock import from_utc
from arva_hil.errors import ArvaError
from arva_hil.events.words.text import Level, Notice
from arva_hil.safe_text import one_line

_LONGEST_LINE: Final = 1 << 16  # bytes
_LARGEST_OBJECT: Final = 1 << 24  # bytes
_LARGEST: Final = 1e15  # a larger number is no time, place or reading, and overflows in what uses it
_ESCAPE: Final = re.compile(r"\\(?:ud[89ab]..\\ud[c-f]..|(?P<half>ud[89a-f]..)|.)", re.IGNORECASE | re.DOTALL)


class RecordingError(ArvaError):
    """A record cannot be read. `str()`: file, line, mistake, and expectation."""

    def __init__(self, where: str | Path, found: str) -> None:
        super().__init__(one_line(f"{where}: {found}"))


class Lines:
    """Iterates over the whole lines of a file. `number` is that of the newest, from 1; `torn`: the last one was cut."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.number = 0
        self.torn = False

    def __iter__(self) -> Iterator[str]:
        refuse_no_file(self.path)
        try:
            with open(self.path, "rb") as file:
                while line := file.readline(_LONGEST_LINE):
                    if not line.endswith(b"\n"):
                        if len(line) >= _LONGEST_LINE:
                            self.number += 1
                            raise self.error(f"a line longer than {_LONGEST_LINE} bytes: this is no file of a record")
                        self.torn = True
                        return
                    self.number += 1
                    yield line.decode("utf-8", "replace")
        except OSError as error:
            raise RecordingError(self.path, f"cannot be read: {error.strerror}") from None

    def error(self, found: str) -> RecordingError:
        """Return an error at the newest line."""
        return RecordingError(f"{self.path}:{self.number}", found)

    def whole_number(self, cell: str) -> int:
        """Return the integer of 64 bits in a cell of the newest line. Raises RecordingError."""
        try:
            value = int(cell)
        except ValueError:
            raise self.error(f"{cell[:40]!r}, expected a number") from None
        if not -(1 << 63) <= value < 1 << 63:
            raise self.error(f"{cell[:40]} is out of range")
        return value

    def seconds(self, cell: str) -> float:
        """Return the time in a cell of the newest line, which may not be empty. Raises RecordingError."""
        try:
            value = number(float(cell))
        except ValueError:
            value = None
        if value is None:
            raise self.error(f"{cell[:40]!r}, expected a number of seconds")
        return value

    @property
    def note(self) -> list[str]:
        """The notes on a file whose last line is cut, to be written once."""
        return [f"{self.path}: the last line is cut, what is before it is used"] if self.torn else []


def table(lines: Lines, needed: Sequence[str]) -> tuple[dict[str, int], Iterator[list[str]]]:
    """Return the columns of a CSV file by name, and its rows. Raises RecordingError if one of `needed` is missing.

    The order is free, and other columns are allowed. An empty file has `needed` and no row.
    """
    rows = _rows(lines)
    header = next(rows, needed)
    if missing := [name for name in needed if name not in header]:
        raise lines.error(f"no column {', '.join(missing)}: this is no table of a record")
    return {name: at for at, name in enumerate(header)}, rows


def _rows(lines: Lines) -> Iterator[list[str]]:
    """Yield the header and the rows, which are as long. Raises RecordingError."""
    width = 0
    try:
        for row in csv.reader(iter(lines)):
            width = width or len(row)
            if len(row) != width:
                raise lines.error(f"{len(row)} cells, expected {width}")
            yield row
    except csv.Error as error:
        raise lines.error(f"is no line of CSV: {error}") from None


class NumberColumns:
    """Columns of a table. An empty cell is NaN, or −1 in a column of integers; a huge number is NaN.

    `columns`: those of the file. `kinds`: the type codes of `array` by name.
    """

    def __init__(self, lines: Lines, columns: Mapping[str, int], kinds: Mapping[str, str]) -> None:
        self._lines = lines
        self._values: dict[str, array[Any]] = {name: array(kind) for name, kind in kinds.items()}
        self._there: list[tuple[int, array[Any], Callable[[str], float], float]] = []
        for name, kind in kinds.items():
            parsed, nothing = (float, math.nan) if kind == "d" else (int, -1)
            self._there.append((columns[name], self._values[name], parsed, nothing))

    def __len__(self) -> int:
        return len(self._there[0][1])

    def add(self, row: Sequence[str]) -> None:
        """Add one row, the newest line. Raises RecordingError."""
        cell = ""
        try:
            for at, values, parsed, nothing in self._there:
                cell = row[at]
                values.append(parsed(cell) if cell else nothing)
        except ValueError:
            raise self._lines.error(f"{cell[:40]!r}, expected a number") from None
        except OverflowError:
            raise self._lines.error(f"{cell[:40]} is out of range") from None

    def column(self, name: str, count: int) -> NDArray[Any]:
        """Return the first `count` numbers of a column, which cannot be changed."""
        values = np.array(self._values[name][:count])
        if values.dtype == float:
            values[np.abs(values) > _LARGEST] = math.nan
        values.flags.writeable = False
        return values


def json_object(path: Path) -> dict[str, Any]:
    """Return the object in a JSON file. Raises RecordingError."""
    refuse_no_file(path)
    try:
        with open(path, "rb") as file:
            size = os.fstat(file.fileno()).st_size
            data = file.read(min(size, _LARGEST_OBJECT))
    except OSError as error:
        raise RecordingError(path, f"cannot be read: {error.strerror}") from None
    if size > _LARGEST_OBJECT:
        raise RecordingError(path, f"is larger than {_LARGEST_OBJECT} bytes: this is no file of a record")
    try:
        value = strict_json(data.decode("utf-8-sig"))
    except json.JSONDecodeError as error:
        raise RecordingError(f"{path}:{error.lineno}:{error.colno}", f"is not valid JSON: {error.msg}") from None
    except (ValueError, RecursionError) as error:
        raise RecordingError(path, f"is not valid JSON: {error}") from None
    if not isinstance(value, dict):
        raise RecordingError(f"{path}:1", f"expected a JSON object, found {type(value).__name__}")
    return value


def strict_json(text: str) -> Any:
    """Parse JSON. Raises ValueError, also for half a character, which Python accepts."""
    for escape in _ESCAPE.finditer(text) if "\\" in text else ():
        if escape["half"]:
            raise json.JSONDecodeError("half of a surrogate pair, expected a whole character", text, escape.start())
    return json.loads(text)


def refuse_no_file(path: Path) -> None:
    """Raise RecordingError unless there is a regular file of that name."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError) as error:
        raise RecordingError(path, f"cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not stat.S_ISREG(mode):
        raise RecordingError(path, "is a folder, expected a file" if stat.S_ISDIR(mode) else "is not a regular file")


def number(value: object) -> float | None:
    """Return a number, None for anything else, for NaN and for a huge number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if abs(value) <= _LARGEST else None


def lat_lon(value: object) -> tuple[float, float] | None:
    """Return a list of latitude and longitude in degrees, None for anything else."""
    every = _numbers(value)
    return (every[0], every[1]) if len(every) == 2 and abs(every[0]) <= 90 and abs(every[1]) <= 180 else None


def lat_lon_alt(value: object) -> tuple[float, float, float] | None:
    """Return a list of latitude, longitude and altitude, None for anything else."""
    every = triple(value)
    return every if every and lat_lon([*every[:2]]) else None


def triple(value: object) -> tuple[float, float, float] | None:
    """Return a list of three finite numbers, None for anything else."""
    every = _numbers(value)
    return (every[0], every[1], every[2]) if len(every) == 3 else None


def _numbers(value: object) -> list[float]:
    """Return the numbers of a list, at most four; an empty list if it has anything else."""
    every = [number(one) for one in value[:4]] if isinstance(value, list) else []
    finite = [one for one in every if one is not None]
    return finite if len(finite) == len(every) else []


def text(value: object) -> str:
    """Return a text, "" for anything else."""
    return value if isinstance(value, str) else ""


def mapping(value: object) -> Mapping[str, Any]:
    """Return an object, an empty one for anything else."""
    return value if isinstance(value, dict) else {}


def objects(value: object) -> list[Mapping[str, Any]]:
    """Return the objects of a list, an empty list for anything else."""
    return [mapping(one) for one in value] if isinstance(value, list) else []


def notice_of(event: Mapping[str, Any]) -> Notice | None:
    """Return the text for people of a recorded event; None without one."""
    notice = mapping(event.get("notice"))
    levels: Mapping[str, Level] = {"warning": "warning", "error": "error"}
    words = text(notice.get("text"))
    return Notice(levels.get(text(notice.get("level")), "info"), words) if words else None


def seconds_of(utc: str) -> float | None:
    """Return seconds since 1970 of a UTC time of a record, e.g. 2026-01-31T15:45:00.000Z; else None."""
    try:
        return from_utc(utc) / 1e6
    except ValueError:
        return None
