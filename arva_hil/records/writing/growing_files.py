"""Files of a record that grow: made in a folder, and written by a thread of their own."""

from __future__ import annotations

import contextlib
import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from io import FileIO
from pathlib import Path
from typing import Any, Final

from arva_hil.clock import Clock, RealClock
from arva_hil.errors import ArvaError
from arva_hil.links import files
from arva_hil.runtime.worker_thread import WorkerThread

_FLUSH_S: Final = 0.2  # with a status four times a second, a killed program loses less than half a second
_SYNC_S: Final = 1.0  # a power failure loses one more second
_LAST_S: Final = 5.0  # for the last data to be written at the end
_FEW_JOBS: Final = 8  # one batch each: a replay waits for the disk instead of filling the memory
_MANY_JOBS: Final = 10_000  # one batch of 0.2 s each


class RecordError(ArvaError):
    """The record could not be written. `str()`: the place and the reason."""


class GrowingFiles:
    """New files in a folder. It collects the bytes for each, and writes them at intervals.

    - `last`: a file of JSON that `close` replaces. `first`: its content until then, None for no such file.
    - `what`: the name for all files together, e.g. "a record".
    - `folders`: the folders to make, outer ones first.
    - `patient`: the loop may wait for a slow disk, as in a replay, until 5 s after `broken_off()` is first true.
    - `clock`: real time, whatever the loop's clock is.

    Raises RecordError if the folder cannot be written or one of the files exists. Symlinks are not followed.
    """

    def __init__(
        self,
        folder: Path,
        names: Sequence[str],
        what: str,
        last: str,
        first: Mapping[str, Any] | None = None,
        *,
        folders: Sequence[str] = (),
        patient: bool = False,
        clock: Clock | None = None,
    ) -> None:
        self.folder = folder
        self.broken_off: Callable[[], bool] = lambda: False
        self._last = last
        self._patient = patient
        self._clock = clock or RealClock()
        self._next_flush = self._next_sync = self._clock.now()
        self._wait_until = math.inf
        self._unfinished = False  # the thread still writes, after the end
        self._files: dict[str, FileIO] = {}
        self._pending: dict[str, bytearray] = {name: bytearray() for name in names}
        try:
            refuse_old(folder, [*names, last, *folders], what)
            folder.mkdir(parents=True, exist_ok=True)
            for name in folders:
                (folder / name).mkdir()
            for name in names:
                self._files[name] = files.create(folder / name)
            if first is not None:
                files.replace(folder / last, _json(first))
        except OSError as error:
            for name, file in self._files.items():  # the folder can then be used again
                file.close()
                with contextlib.suppress(OSError):
                    (folder / name).unlink()
            for name in reversed(folders):
                with contextlib.suppress(OSError):
                    (folder / name).rmdir()
            raise RecordError(_why(folder, error)) from None
        self._background = WorkerThread(what, most_jobs=_FEW_JOBS if patient else _MANY_JOBS)

    @property
    def error(self) -> str:
        """The reason if writing has stopped, otherwise ""."""
        if self._background.error is not None:
            return _why(self.folder, self._background.error)
        if self._background.refused:
            return f"{self.folder}: the disk is too slow, the record has {self._background.refused} gaps"
        return f"{self.folder}: the disk does not take the record in time" if self._unfinished else ""

    def close(self, last: Mapping[str, Any]) -> None:
        """Close all files and write the last one, also after errors. Raises RecordError if there was one."""
        self._settle()
        self._write_last(last)

    def _settle(self) -> None:
        """Write the last data and close the growing files, also after errors. `error` does not change after it."""
        self.broken_off = lambda: True
        self._flush()
        self._unfinished = not self._background.close(*(partial(_close, file) for file in self._files.values()))

    def _write_last(self, last: Mapping[str, Any]) -> None:
        ending = WorkerThread("end of record")  # the first one may hang
        said = ending.close(lambda: files.replace(self.folder / self._last, _json(last)))
        if ending.error is not None:
            raise RecordError(_why(self.folder / self._last, ending.error))
        if self.error:
            raise RecordError(self.error)
        if not said:
            raise RecordError(f"{self.folder}: the disk does not take the record in time")

    def _flush_now_and_then(self, *, full: bool = False) -> None:
        """Pass pending data to the thread after some time, or if there is much of it."""
        now = self._clock.now()
        if now < self._next_flush and not full:
            return
        self._next_flush = now + _FLUSH_S
        self._flush()
        if now >= self._next_sync and not self._patient:
            self._next_sync = now + _SYNC_S
            self._background.put(self._sync)

    def _sync(self) -> None:
        for file in self._files.values():
            os.fsync(file.fileno())

    def _flush(self) -> None:
        for name, pending in self._pending.items():
            if pending:
                self._pending[name] = bytearray()
                self._background.put(partial(_write, self._files[name], pending), self._give_up)

    def _give_up(self) -> bool:
        """Return True when waiting for the disk should end."""
        if self._wait_until == math.inf and self.broken_off():
            self._wait_until = self._clock.now() + _LAST_S
        return not self._patient or self._clock.now() >= self._wait_until


def refuse_old(folder: Path, names: Sequence[str], what: str) -> None:
    """Raise RecordError if `folder` is a file, or contains one of these files: `what` would be overwritten."""
    if os.path.exists(folder) and not os.path.isdir(folder):
        raise RecordError(f"{folder}: is no folder; name another one")
    if there := [name for name in names if os.path.lexists(folder / name)]:
        raise RecordError(f"{folder}: holds {what} already ({', '.join(there)}); name another folder")


def _json(value: Mapping[str, Any]) -> bytes:
    return json.dumps(value, indent=2).encode() + b"\n"


def _write(file: FileIO, data: bytes | bytearray) -> None:
    """Write all of `data`, or nothing if the disk is full: a file ends with a whole frame."""
    start, left = file.tell(), memoryview(data)
    try:
        while left:
            left = left[file.write(left) :]
    except OSError:
        with contextlib.suppress(OSError):
            file.truncate(start)
        raise


def _close(file: FileIO) -> None:
    """Close a file after it is on the disk."""
    with file:
        os.fsync(file.fileno())


def _why(folder: Path, error: Exception) -> str:
    if isinstance(error, OSError):
        return f"{error.filename or folder}: cannot record: {error.strerror or error}"
    return f"{folder}: cannot record: {error!r}"
