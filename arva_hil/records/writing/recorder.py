"""The record of a run: packets, frames, readings with their poses, and its end."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from arva_hil.clock import Clock, from_utc, utc
from arva_hil.events import BytesSent, Event, FrameMade, PacketsReceived, StatusReport
from arva_hil.links.tlog import tlog_record
from arva_hil.mavlink.codec import dialect
from arva_hil.records.writing import layout as names
from arva_hil.records.writing.growing_files import GrowingFiles, RecordError, refuse_old
from arva_hil.records.writing.layout import EventLines, RecordLayout

_BATCH_BYTES: Final = 1 << 16


class Recorder(GrowingFiles):
    """The record of a run, in a folder of its own.

    It writes `autopilot.tlog`, `frames.bin`, `frames.csv`, `readings.csv`, `events.jsonl` and `run.json`, and with
    several receivers or links the files of `layout`.

    `epoch_us`: microseconds since 1970 at the loop's time 0. `run`: the first content of run.json, which also contains
    until `close` that the run has not ended. For the other arguments see `GrowingFiles`. Raises RecordError if the
    folder cannot be written or already contains a record.
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
        self._layout = layout = layout or RecordLayout()
        if taken := layout.taken_name:
            raise RecordError(f"{folder}: a vehicle is named {taken}, as a file of the record: give it another name")
        self._epoch_us = epoch_us
        self._begun: dict[str, int] = {}  # the slots of those frames.csv that have their header, as of the first frame
        self._events = EventLines(epoch_us)
        about = {"record": names.VERSION, "ended": None, "exit_code": None, **(run or {})}  # until the run ends
        self._date_us = epoch_us or from_utc(about.get("started", utc(0)))  # a stepped clock has no date of its own
        refuse_old(
            folder, [name for name in (*names.FILES, names.CHUNKS) if name not in layout.files], "a record"
        )  # of another layout
        super().__init__(
            folder, layout.files, "a record", names.RUN, about, folders=layout.folders, patient=patient, clock=clock
        )
        for name, pending in self._pending.items():
            if name.endswith(names.READINGS):
                pending += (",".join(names.COLUMNS) + "\n").encode()
        if layout.real:
            self._pending[names.CHUNKS] += (",".join(names.CHUNK_COLUMNS) + "\n").encode()

    def observe(self, event: Event) -> None:
        if isinstance(event, PacketsReceived):  # the most frequent event, without a line in events.jsonl
            self._on_packets(event)
            return
        self._pending[names.EVENTS] += self._events.of(event)
        if isinstance(event, FrameMade):
            self._on_frame(event)
        elif isinstance(event, BytesSent):
            self._pending[self._layout.of_receiver(event.vehicle, event.receiver, names.FRAMES)] += event.data
            if self._layout.real:
                came_us = self._epoch_us + round(event.time_s * 1e6)
                self._pending[names.CHUNKS] += f"{came_us},{len(event.data)}\n".encode()
        elif isinstance(event, StatusReport):
            self._flush_now_and_then()

    def _on_frame(self, event: FrameMade) -> None:
        readings = self._layout.of_receiver(event.vehicle, event.receiver, names.READINGS)
        table = self._layout.of_receiver(event.vehicle, event.receiver, names.TABLE)
        if table not in self._begun:
            self._begun[table] = len(event.reading.channels)
            self._pending[table] += names.header_of_frames(len(event.reading.channels)).encode()
        of_slots, of_frame = names.rows(event, self._begun[table])
        self._pending[readings] += of_slots.encode()
        self._pending[table] += (names.moment(event.time_s - event.late_s, self._date_us) + of_frame).encode()
        self._flush_now_and_then(full=len(self._pending[readings]) > _BATCH_BYTES)

    def _on_packets(self, event: PacketsReceived) -> None:
        pending = self._pending[self._layout.tlog(event.link)]
        time_us = self._epoch_us + round(event.time_s * 1e6)
        for packet in event.packets:
            if packet.msgid != dialect.MAVLINK_MSG_ID_SETUP_SIGNING:  # it holds a key
                pending += tlog_record(time_us, packet.raw)
        if len(pending) > _BATCH_BYTES:
            self._flush()

    def close(self, last: Mapping[str, Any]) -> None:
        """Close all files and replace run.json by `last`, also after errors. Raises RecordError if there was one.

        A run that ended well, but whose record is not complete, has failed: run.json contains the error.
        """
        for table in self._layout.tables:
            if table not in self._begun:
                self._pending[table] += names.header_of_frames(0).encode()
        self._settle()
        about = {"record": names.VERSION, **last}
        if self.error and not last.get("exit_code"):
            about |= {"ended": self.error, "exit_code": 1}
        self._write_last(about)
