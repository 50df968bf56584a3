"""Reads a record's readings.csv, one row a reading and slot, into columns."""

from __future__ import annotations

import itertools
import math
from array import array
from collections.abc import Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.records.reading.lines import Lines, RecordingError, table
from arva_hil.records.reading.receivers import NO_ID, RecordedReceiver

_OF_FRAME: Final = "time_s boot_ms north_m east_m down_m roll_deg pitch_deg yaw_deg pose_age_ms".split()
_LATER: Final = "reported_north_m reported_east_m reported_down_m late_ms".split()  # old records lack them
_OF_SLOT: Final = {"id": "h", "zone": "b", "d_cm": "i", "delta_deg": "h"}  # kinds of arrays
_NEEDED: Final = ("seq", *_OF_FRAME, "slot", *_OF_SLOT, "true_range_m")
_MOST_FAULTS: Final = 1024  # sets of them
_MOST_SLOTS: Final = 255
_MOST_ROWS: Final = 10_000_000


def read_receiver(path: Path, vehicle: str = "", receiver: str = "") -> tuple[RecordedReceiver, list[str]]:
    """Return the readings in a file, and notes about unused parts. Raises RecordingError.

    Takes 50 bytes of memory a row with four slots a frame, 140 with one. An infinite number becomes NaN. A
    command may change the number of slots in a run.
    """
    lines = Lines(path)
    columns, rows = table(lines, _NEEDED)
    builder = _Builder(lines, columns)
    for row in itertools.islice(rows, _MOST_ROWS):
        builder.add(row)
    notes = []
    if next(rows, None):
        notes = [f"{path}: only the first {_MOST_ROWS} rows are used"]
    if lines.torn:
        notes = [f"{path}: the last frame is cut, what is before it is used"]
    if notes:
        builder.drop_frame()
    return builder.built(vehicle, receiver), notes


class _Builder:
    """Remembers the rows so far."""

    def __init__(self, lines: Lines, columns: Mapping[str, int]) -> None:
        self._before = 0  # the slot of the newest row
        self._begins = array("q")  # the number of each frame's first row
        self._lines = lines
        self._later = [name for name in _LATER if name in columns]
        self._frames, self._ranges = array("d"), array("d")
        self._sequence, self._fault_set = array("i"), array("i")
        self._fault_sets: dict[str, int] = {"": 0}
        self._slots = [array(kind) for kind in _OF_SLOT.values()]
        if columns:
            self._seq, self._slot, self._range = (columns[name] for name in ("seq", "slot", "true_range_m"))
            self._faults = columns.get("faults")
            self._of_frame = itemgetter(*(columns[name] for name in (*_OF_FRAME, *self._later)))
            self._of_slot = itemgetter(*(columns[name] for name in _OF_SLOT))

    def add(self, row: Sequence[str]) -> None:
        """Add one row. Raises RecordingError."""
        slot = self._number(row[self._slot])
        if slot == 1:
            self._begin_frame(row)
        elif not 1 < slot == self._before + 1 <= _MOST_SLOTS:
            raise self._lines.error(f"slot {slot}, expected 1{f' or {self._before + 1}' if self._before else ''}")
        self._before = slot
        cell = ""
        try:
            for column, cell in zip(self._slots, self._of_slot(row), strict=True):
                column.append(int(cell) if cell else NO_ID)
            cell = row[self._range]
            self._ranges.append(float(cell or math.nan))
        except ValueError:
            raise self._no_number(cell) from None
        except OverflowError:
            raise self._lines.error(f"{cell[:40]} is out of range") from None

    def built(self, vehicle: str, receiver: str) -> RecordedReceiver:
        """Return the complete frames of all rows."""
        n, rows = len(self._begins), len(self._ranges)
        parts = len(_OF_FRAME) + len(self._later)
        frames = _frozen(self._frames, n * parts).reshape(n, parts)
        later = {name: frames[:, len(_OF_FRAME) + at] for at, name in enumerate(self._later)}
        nothing = np.full(n, np.nan)
        id_, zone, d_cm, delta_deg = (_frozen(column, rows) for column in self._slots)
        return RecordedReceiver(
            vehicle,
            receiver,
            _frozen(self._sequence, n),
            frames[:, 0],
            frames[:, 1],
            frames[:, 2:5],
            frames[:, 5:8],
            frames[:, 8],
            np.stack([later.get(name, nothing) for name in _LATER[:3]], axis=1),
            later.get(_LATER[3], nothing),
            np.append(_frozen(self._begins, n), rows),
            id_,
            zone,
            d_cm,
            delta_deg,
            _frozen(self._ranges, rows),
            tuple(tuple(names.lstrip("'").split("+")) if names else () for names in self._fault_sets),
            _frozen(self._fault_set, n),
        )

    def drop_frame(self) -> None:
        """Forget the newest frame, if there is one."""
        if self._begins:
            begin = self._begins.pop()
            del self._ranges[begin:]
            for column in self._slots:
                del column[begin:]

    def _begin_frame(self, row: Sequence[str]) -> None:
        cell = row[self._seq]
        try:
            self._begins.append(len(self._ranges))
            self._sequence.append(int(cell))
            for cell in self._of_frame(row):
                self._frames.append(float(cell) if cell else math.nan)
        except (ValueError, OverflowError):
            raise self._no_number(cell) from None
        names = "" if self._faults is None else row[self._faults]
        if names not in self._fault_sets and len(self._fault_sets) >= _MOST_FAULTS:
            raise self._lines.error(f"more than {_MOST_FAULTS} different sets of faults")
        self._fault_set.append(self._fault_sets.setdefault(names, len(self._fault_sets)))

    def _number(self, cell: str) -> int:
        try:
            return int(cell)
        except ValueError:
            raise self._no_number(cell) from None

    def _no_number(self, cell: str) -> RecordingError:
        return self._lines.error(f"{cell[:40]!r}, expected a number")


def _frozen(data: array[Any], count: int) -> NDArray[Any]:
    """Return the first `count` numbers, infinite ones as NaN, as a read-only array."""
    values = np.frombuffer(data, data.typecode, count) if count else np.zeros(0, data.typecode)
    if data.typecode == "d" and np.isinf(values).any():
        values[np.isinf(values)] = np.nan
    values.flags.writeable = False
    return values
