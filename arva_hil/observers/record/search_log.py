"""The log of a search: one row for each step of the flight, and its outcome."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from arva_hil import files
from arva_hil.observers.record.recorder import RecordError, refuse_old, why
from arva_hil.runtime.clock import Clock, RealClock
from arva_hil.runtime.worker_thread import WorkerThread
from arva_hil.search.outcome import SearchStep

TRACK, OUTCOME = SEARCH_FILES = ("search.csv", "search.json")
_BATCH: Final = 1 << 12  # characters
_FLUSH_S: Final = 0.2  # a killed program loses this much, and one row


def refuse_search(folder: Path) -> None:
    """Raise RecordError if `folder` contains a search already. Nothing is written."""
    try:
        refuse_old(folder, SEARCH_FILES, "a search")
    except OSError as error:
        raise RecordError(why(folder, error)) from None


class SearchLog:
    """Writes `search.csv` and, at the end, `search.json` into a folder, which may contain the emulator's record too.

    `clock`: real time, independent of the loop's clock. Raises RecordError if the folder cannot be written or contains
    a search already.
    """

    def __init__(self, folder: Path, clock: Clock | None = None) -> None:
        self.rows: list[SearchStep] = []
        self.folder = folder
        self._clock = clock or RealClock()
        self._next_flush = self._clock.now()
        self._pending = io.StringIO()
        self._csv = csv.writer(self._pending, lineterminator="\n")
        self._csv.writerow(SearchStep._fields)
        refuse_search(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = files.create(folder / TRACK)
        except OSError as error:
            raise RecordError(why(folder, error)) from None
        self._background = WorkerThread("search log")

    @property
    def error(self) -> Exception | None:
        """The error if nothing more is written, else None."""
        return self._background.error

    def row(self, row: SearchStep) -> None:
        """Add one step."""
        self.rows.append(row)
        self._csv.writerow(row)
        if self._pending.tell() > _BATCH or self._clock.now() >= self._next_flush:
            self._flush()

    def close(self, outcome: Mapping[str, Any]) -> None:
        """Close the files and write `outcome` to search.json. Raises RecordError if anything went wrong."""
        self._flush()
        finished = self._background.close(self._end)
        ending = WorkerThread("end of search log")  # the other one may hang
        data = json.dumps(outcome, indent=2).encode() + b"\n"
        said = ending.close(lambda: files.replace(self.folder / OUTCOME, data))
        for error in (ending.error, self._background.error):
            if error is not None:
                raise RecordError(why(self.folder, error))
        if not (finished and said) or self._background.refused:
            raise RecordError(f"{self.folder}: the disk does not take the log in time")

    def _flush(self) -> None:
        self._next_flush = self._clock.now() + _FLUSH_S
        left = memoryview(self._pending.getvalue().encode())
        self._pending.seek(0)
        self._pending.truncate()

        def write() -> None:
            rest = left
            while rest:
                rest = rest[self._file.write(rest) :]

        self._background.put(write)

    def _end(self) -> None:
        with self._file:
            os.fsync(self._file.fileno())
