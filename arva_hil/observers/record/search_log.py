"""The log of a search: one row for each step of the flight, and its outcome."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Final

from arva_hil.observers.record.growing_files import GrowingFiles, refuse_old
from arva_hil.runtime.clock import Clock
from arva_hil.search.outcome import SearchStep

TRACK, OUTCOME = SEARCH_FILES = ("search.csv", "search.json")
_BATCH_BYTES: Final = 1 << 12


def refuse_search(folder: Path) -> None:
    """Raise RecordError if `folder` contains a search already. Nothing is written."""
    refuse_old(folder, SEARCH_FILES, "a search")


class SearchLog(GrowingFiles):
    """Writes `search.csv` and, at the end, `search.json` into a folder, which may contain the emulator's record too.

    `clock`: real time, independent of the loop's clock. Raises RecordError if the folder cannot be written or contains
    a search already.
    """

    def __init__(self, folder: Path, clock: Clock | None = None) -> None:
        super().__init__(folder, [TRACK], "a search", OUTCOME, clock=clock)
        self.rows: list[SearchStep] = []
        self._line = io.StringIO()
        self._csv = csv.writer(self._line, lineterminator="\n")
        self._add(SearchStep._fields)

    def row(self, row: SearchStep) -> None:
        """Add one step."""
        self.rows.append(row)
        self._add(row)
        self._flush_now_and_then(full=len(self._pending[TRACK]) > _BATCH_BYTES)

    def _add(self, cells: tuple[object, ...]) -> None:
        self._csv.writerow(cells)
        self._pending[TRACK] += self._line.getvalue().encode()
        self._line.seek(0)
        self._line.truncate()
