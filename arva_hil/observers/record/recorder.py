"""The record of a run: packets, frames, readings with their poses, and how it ended."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from io import FileIO
from pathlib import Path
from typing import Any, Final

from arva_hil import files
from arva_hil.errors import ArvaError
from arva_hil.events import BytesSent, Event, FrameMade, PacketsReceived, StatusReport
from arva_hil.links.tlog import tlog_record
from arva_hil.mavlink.codec import dialect
from arva_hil.observers.record.layout import (
    COLUMNS,
    EVENTS,
    FILES,
    FRAMES,
    READINGS,
    RUN,
    TABLE,
    VERSION,
    EventLines,
    RecordLayout,
    header_of_frames,
    moment,
    rows,
)
from arva_hil.runtime.clock import Clock, RealClock
from arva_hil.runtime.worker_thread import WorkerThread

NOT_ENDED: Final[Mapping[str, Any]] = {"ended": None, "exit_code": None}  # in run.json until the run ends
_BATCH_BYTES: Final = 1 << 16
_FLUSH_S: Final = 0.2  # with a status four times a second, a killed program loses less than half a second
_SYNC_S: Final = 1.0  # a power failure loses this much more
_LAST_S: Final = 5.0  # for the last data to be written at the end
_FEW_JOBS: Final = 8  # one batch each: a replay waits for the disk instead of filling the memory
_MANY_JOBS: Final = 10_000  # one batch of 0.2 s each


class RecordError(ArvaError):
    """The record could not be written. `str()` says where and why."""


class Recorder:
    """Writes `autopilot.tlog`, `frames.bin`, `frames.csv`, `readings.csv`, `events.jsonl` and `run.json` into a folder
    of its own, and with several receivers or links into the files of `layout`.

    `epoch_us`: microseconds since 1970 at the loop's time 0. `run`: the first content of run.json, which also says
    until `close` that the run has not ended. `patient`: whether the loop may wait for a slow disk, as a replay may.
    `clock`: real time, whatever the loop's clock is. All files are new, and symlinks are not followed. Raises
    RecordError if the folder cannot be written or contains a record already.
    """

    def __init__(
        self,
        folder: Path,
        epoch_us: int,
        run: Mapping[str, Any] | None = None,
        *,
        patient: bool = False,
        clock: Clock | None = None,
        layout: RecordLayout | None = None,
    ) -> None:
        self._folder = folder
        self._layout = layout or RecordLayout()
        self._folders: list[Path] = []
        self._epoch_us = epoch_us
        self._patient = patient
        self.give_up: Callable[[], bool] = lambda: not patient
        self._clock = clock or RealClock()
        self._next_flush = self._next_sync = self._clock.now()
        self._files: dict[str, FileIO] = {}
        self._begun: dict[str, int] = {}  # the slots of those frames.csv that have their header, as of the first frame
        self._events = EventLines(epoch_us)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            refuse_old(folder, list(dict.fromkeys([*FILES, *self._layout.files, *self._layout.folders])), "a record")
            for name in self._layout.folders:
                (folder / name).mkdir()
                self._folders.append(folder / name)
            for name in self._layout.files:
                self._files[name] = files.create(folder / name)
            files.replace(folder / RUN, _json({"record": VERSION, **NOT_ENDED, **(run or {})}))
        except OSError as error:
            self._take_back()
            raise RecordError(why(folder, error)) from None
        self._pending: dict[str, bytearray] = {name: bytearray() for name in self._files}
        for name, pending in self._pending.items():
            if name.endswith(READINGS):
                pending += (",".join(COLUMNS) + "\n").encode()
        self._background = WorkerThread("record", most_jobs=_FEW_JOBS if patient else _MANY_JOBS)

    @property
    def error(self) -> str:
        """The reason if recording has stopped, "" while it goes on."""
        if self._background.error is not None:
            return why(self._folder, self._background.error)
        if self._background.refused:
            return f"{self._folder}: the disk is too slow, the record has {self._background.refused} gaps"
        return ""

    def observe(self, event: Event) -> None:
        self._pending[EVENTS] += self._events.of(event)
        if isinstance(event, PacketsReceived):
            self._on_packets(event)
        elif isinstance(event, FrameMade):
            self._on_frame(event)
        elif isinstance(event, BytesSent):
            pending = self._pending[self._layout.of_receiver(event.vehicle, event.receiver, FRAMES)]
            pending += event.data
        elif isinstance(event, StatusReport):
            self._flush_now_and_then()

    def _on_frame(self, event: FrameMade) -> None:
        readings = self._layout.of_receiver(event.vehicle, event.receiver, READINGS)
        table = self._layout.of_receiver(event.vehicle, event.receiver, TABLE)
        if table not in self._begun:
            self._begun[table] = len(event.reading.channels)
            self._pending[table] += header_of_frames(len(event.reading.channels)).encode()
        of_slots, of_frame = rows(event, self._begun[table])
        self._pending[readings] += of_slots.encode()
        self._pending[table] += (moment(event.time_s - event.late_s, self._epoch_us) + of_frame).encode()
        self._flush_now_and_then(full=len(self._pending[readings]) > _BATCH_BYTES)

    def _on_packets(self, event: PacketsReceived) -> None:
        time_us = self._epoch_us + round(event.time_s * 1e6)
        pending = self._pending[self._layout.tlog(event.link)]
        for packet in event.packets:
            if packet.msgid != dialect.MAVLINK_MSG_ID_SETUP_SIGNING:  # it holds a key
                pending += tlog_record(time_us, packet.raw)
        if len(pending) > _BATCH_BYTES:
            self._flush()

    def close(self, run: Mapping[str, Any]) -> None:
        """Close all files and replace run.json by `run`, also after errors. Raises RecordError if there was one."""
        for table in self._layout.tables:
            if table not in self._begun:
                self._pending[table] += header_of_frames(0).encode()
        give_up, until = self.give_up, self._clock.now() + _LAST_S
        self.give_up = lambda: give_up() or self._clock.now() >= until
        self._flush()
        finished = self._background.close(*(_closing(file) for file in self._files.values()))
        ending = WorkerThread("end of record")  # the other one may hang
        said = ending.close(lambda: files.replace(self._folder / RUN, _json({"record": VERSION, **run})))
        if ending.error is not None:
            raise RecordError(why(self._folder / RUN, ending.error))
        if self.error:
            raise RecordError(self.error)
        if not (finished and said):
            raise RecordError(f"{self._folder}: the disk does not take the record in time")

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

    def _flush(self) -> None:
        for name, pending in self._pending.items():
            if pending:
                self._pending[name] = bytearray()
                self._background.put(_writing(self._files[name], pending), self.give_up)

    def _sync(self) -> None:
        for file in self._files.values():
            os.fsync(file.fileno())

    def _take_back(self) -> None:
        """Remove the empty files that were made, so that the same folder can be tried again."""
        for name, file in self._files.items():
            file.close()
            with contextlib.suppress(OSError):
                (self._folder / name).unlink()
        for made in reversed(self._folders):
            with contextlib.suppress(OSError):
                made.rmdir()


def refuse_old(folder: Path, names: Sequence[str], what: str) -> None:
    """Raise RecordError if `folder` contains one of these files: `what` would be overwritten."""
    there = [name for name in names if files.there(folder / name)]
    if there:
        raise RecordError(f"{folder}: holds {what} already ({', '.join(there)}); name another folder")


def _json(run: Mapping[str, Any]) -> bytes:
    return json.dumps(run, indent=2).encode() + b"\n"


def _writing(file: FileIO, data: bytes | bytearray) -> Callable[[], None]:
    """A job that writes all of `data`, or nothing if the disk is full: a file ends with a whole frame."""

    def write() -> None:
        start, left = file.tell(), memoryview(data)
        try:
            while left:
                left = left[file.write(left) :]
        except OSError:
            with contextlib.suppress(OSError):
                file.truncate(start)
            raise

    return write


def _closing(file: FileIO) -> Callable[[], None]:
    """A job that closes a file after it is on the disk."""

    def close() -> None:
        with file:
            os.fsync(file.fileno())

    return close


def why(folder: Path, error: Exception) -> str:
    """The error of a record, for a person."""
    if isinstance(error, OSError):
        where = error.filename or folder
        return f"{where}: cannot record: {error.strerror or error}"
    return f"{folder}: cannot record: {error!r}"
