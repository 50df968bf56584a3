"""The raw bytes of a record: packets and the receiver's bytes, each with its time."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from arva_hil.records.reading import Lines, RecordingError, logged, refuse_no_file, table
from arva_hil.records.received.receiver_log import AUTOPILOT, RECEIVER, ReceiverLog
from arva_hil.records.writing.layout import CHUNK_COLUMNS, CHUNKS, FRAMES, TLOG
from arva_hil.runtime.audience import Audience

_STEP_S: Final = 0.1  # between two calls of `advance`
_MOST_BYTES: Final = 1 << 24  # that a link gives at once


class KeptBytes(NamedTuple):
    """Bytes that came on a link at `time_us`, microseconds since 1970."""

    time_us: int
    link: str
    data: bytes

    @classmethod
    def of(cls, folder: Path) -> Iterator[KeptBytes]:
        """Iterate over the bytes of both links of a record, in time. Raises RecordingError."""
        path = folder / TLOG
        log = logged(path) if path.exists() and path.stat().st_size else ()
        packets = (cls(time_us, AUTOPILOT, raw) for time_us, raw in log)
        return heapq.merge(packets, _chunks(folder), key=lambda one: one.time_us)


def play(kept: Iterator[KeptBytes], log: ReceiverLog, audience: Audience, epoch_us: int) -> None:
    """Feed kept bytes to a log. `epoch_us`: microseconds since 1970 at its time 0."""
    now = due = 0.0
    for time_us, link, data in kept:
        now = max(now, (time_us - epoch_us) / 1e6)
        if now >= due:
            log.advance(now)
            due = now + _STEP_S
        log.receive(link, data, now, whole=link == AUTOPILOT)
        log.output()
        audience.emit(log.events())
    log.advance(now, final=True)
    audience.emit(log.events())


def _chunks(folder: Path) -> Iterator[KeptBytes]:
    if not (folder / CHUNKS).exists():
        raise RecordingError(folder, f"there is no {CHUNKS} in it: only a record of `arva-hil record` has one")
    lines = Lines(folder / CHUNKS)
    columns, rows = table(lines, CHUNK_COLUMNS)
    refuse_no_file(folder / FRAMES)
    with open(folder / FRAMES, "rb") as data:
        for row in rows:
            time_us, size = (lines.whole_number(row[columns[name]]) for name in CHUNK_COLUMNS)
            if not 0 <= size <= _MOST_BYTES:
                raise lines.error(f"{size} bytes, expected 0 to {_MOST_BYTES}")
            if len(chunk := data.read(size)) < size:
                return  # a program that was killed has written the one and not the other
            yield KeptBytes(time_us, RECEIVER, chunk)
