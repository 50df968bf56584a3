"""The log of a search: one row for each step of the flight, and its outcome."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from arva_hil.clock import Clock
from arva_hil.events import Event
from arva_hil.records.writing.growing_files import GrowingFiles, RecordError, refuse_old
from arva_hil.records.writing.layout import EventLines
from arva_hil.search.mission.outcome import SearchStep

TRACK, OUTCOME, NEWS = SEARCH_FILES = ("search.csv", "search.json", "search.jsonl")
_BATCH_BYTES: Final = 1 << 12


def refuse_search(folder: Path) -> None:
    """Raise RecordError if `folder` contains a search already. Nothing is written."""
    refuse_old(folder, SEARCH_FILES, "a search")


def refuse_team(folder: Path, names: Sequence[str]) -> None:
    """Raise RecordError if the search of one of these names cannot have a folder there. Nothing is written."""
    for own in (folder / name for name in names):
        if os.path.lexists(own) and (own.is_symlink() or not own.is_dir()):
            raise RecordError(f"{own}: is no folder of its own; name another folder")
        refuse_search(own)


class SearchLog(GrowingFiles):
    """Writes `search.csv` and, at the end, `search.json` into a folder, which may contain the emulator's record too.

    With `start_s`, the time 0 of the steps on their clock, it also writes the events, as lines of `search.jsonl`.
    `clock`: real time, independent of the loop's clock. Raises RecordError if the folder cannot be written or contains
    a search already.
    """

    def __init__(self, folder: Path, clock: Clock | None = None, *, start_s: float | None = None) -> None:
        super().__init__(folder, [TRACK] if start_s is None else [TRACK, NEWS], "a search", OUTCOME, clock=clock)
        self._start_s = start_s
        self._lines = EventLines(0)
        self._pending[TRACK] += (",".join(SearchStep._fields) + "\n").encode()

    def row(self, row: SearchStep) -> None:
        """Add one step."""
        cells = ["" if value is None else str(value) for value in row]
        self._pending[TRACK] += (",".join(cells) + "\n").encode()
        self._flush_now_and_then(full=len(self._pending[TRACK]) > _BATCH_BYTES)

    def observe(self, event: Event) -> None:
        """Add an event."""
        if self._start_s is not None:
            self._pending[NEWS] += self._lines.of(replace(event, time_s=event.time_s - self._start_s))
            self._flush_now_and_then(full=False)
