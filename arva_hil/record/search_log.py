"""The log of a search: one row a step of the flight, and how it ended."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from arva_hil.background import Background
from arva_hil.record.recorder import RecordError, refuse_old, why
from arva_hil.search.outcome import Row

TRACK, OUTCOME = SEARCH_FILES = ("search.csv", "search.json")
_BATCH: Final = 1 << 12  # characters


def refuse_search(folder: Path) -> None:
    """Raise RecordError when `folder` holds a search already; nothing is written."""
    try:
        refuse_old(folder, SEARCH_FILES, "a search")
    except OSError as error:
        raise RecordError(why(folder, error)) from None


class SearchLog:
    """Writes `search.csv` and `search.json` into a folder, which may hold the emulator's record too.

    Raises RecordError when the folder cannot be written or holds a search already.
    """

    def __init__(self, folder: Path) -> None:
        self.rows: list[Row] = []
        self.folder = folder
        self._pending = io.StringIO()
        self._csv = csv.writer(self._pending, lineterminator="\n")
        self._csv.writerow(Row._fields)
        refuse_search(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = (folder / TRACK).open("w")
        except OSError as error:
            raise RecordError(why(folder, error)) from None
        self._background = Background("search log")

    @property
    def error(self) -> Exception | None:
        """Why nothing more is written."""
        return self._background.error

    def row(self, row: Row) -> None:
        """Take one step."""
        self.rows.append(row)
        self._csv.writerow(row)
        if self._pending.tell() > _BATCH:
            self._flush()

    def close(self, outcome: Mapping[str, Any]) -> None:
        """Close the files, `outcome` as search.json; RecordError when anything went wrong."""
        self._flush()
        self._background.put(self._file.close, wait=True)
        finished = self._background.close()
        try:
            (self.folder / OUTCOME).write_text(json.dumps(outcome, indent=2) + "\n")
        except OSError as error:
            raise RecordError(why(self.folder, error)) from None
        if self._background.error is not None:
            raise RecordError(why(self.folder, self._background.error))
        if not finished or self._background.refused:
            raise RecordError(f"{self.folder}: the disk does not take the log in time")

    def _flush(self) -> None:
        text = self._pending.getvalue()
        self._pending.seek(0)
        self._pending.truncate()

        def write() -> None:
            self._file.write(text)
            self._file.flush()

        self._background.put(write)
