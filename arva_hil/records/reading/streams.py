"""The rates of each message of a vehicle: from the packets in a record's logs."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.links import LinkError
from arva_hil.links.tlog import TlogReader
from arva_hil.links.tlog_timeline import Timeline
from arva_hil.mavlink.codec import dialect
from arva_hil.records.reading.lines import RecordingError, mapping, text
from arva_hil.records.reading.recording import Recording
from arva_hil.records.writing.layout import TLOG

_MOST: Final = 1_000_000  # largest number of pairs of message and second
_MOST_CELLS: Final = 1 << 24  # of a table of all messages and seconds


@dataclass(frozen=True, eq=False)
class RecordedStream:
    """One kind of message. `hz` (N,): number in each second `time_s` (N,) from the start of the run."""

    name: str
    time_s: NDArray[np.float64]
    hz: NDArray[np.float64]

    @property
    def mean_hz(self) -> float:
        """Mean rate over the whole seconds between the first and the last message."""
        whole = self.hz[1:-1] if len(self.hz) > 2 else self.hz
        return float(whole.mean()) if len(whole) else 0.0


def streams(recording: Recording, vehicle: str = "") -> list[RecordedStream]:
    """Return the messages of a vehicle, the most frequent first. Raises RecordingError: see `packets`."""
    counts: Counter[tuple[int, int]] = Counter()  # by message id and second
    for came_s, message, _ in packets(recording, vehicle):
        counts[message, math.floor(came_s)] += 1
        if len(counts) > _MOST:
            raise RecordingError(recording.folder, "the times of its packets are too far apart to be right")
    rows = {message: row for row, message in enumerate(dict.fromkeys(message for message, _ in counts))}
    first = min((second for _, second in counts), default=0)
    length = max((second for _, second in counts), default=0) + 1 - first
    if len(rows) * length > _MOST_CELLS:
        return []
    hz = np.zeros((len(rows), length))
    for (message, second), count in counts.items():
        hz[rows[message], second - first] = count
    time_s = np.arange(first, first + length, dtype=float)
    found = (RecordedStream(_name(message), time_s, hz[row]) for message, row in rows.items())
    return sorted(found, key=lambda stream: -float(stream.hz.sum()))


def packets(recording: Recording, vehicle: str = "") -> Iterator[tuple[float, int, bytes]]:
    """Yield the packets of a vehicle: time from the start of the run [s], message id, bytes.

    If its ids are unknown, yield all packets of its log. Raises RecordingError if the log cannot be read.
    """
    said = recording.run.vehicle(vehicle) if recording.run else {}
    known = mapping(said.get("vehicle"))
    ids = known.get("system"), known.get("component")
    path = recording.folder / Path(text(said.get("tlog")) or TLOG).name
    if not os.path.exists(path):  # also a name that no file can have
        return
    start_us = None if recording.log_start_s is None else recording.log_start_s * 1e6
    for time_us, raw in logged(path):
        system, component, message = _head(raw)
        if None in ids or (system, component) == ids:
            start_us = time_us if start_us is None else start_us
            yield (time_us - start_us) / 1e6, message, raw


def logged(path: Path, *, continuous: bool = False) -> Iterator[tuple[int, bytes]]:
    """Yield the packets of a log, each with its time [µs since 1970]. Raises RecordingError.

    `continuous`: without the steps of the log's clock.
    """
    try:
        with closing(TlogReader(path)) as log:
            yield from Timeline(log, stamped=log.stamped) if continuous else log
    except LinkError as error:
        raise RecordingError(path, error.what) from None


def _head(raw: bytes) -> tuple[int, int, int]:
    """Return system, component and message id of a packet."""
    if raw[0] == 0xFD:
        return raw[5], raw[6], int.from_bytes(raw[7:10], "little")
    return raw[3], raw[4], raw[5]


def _name(message: int) -> str:
    kind = dialect.mavlink_map.get(message)
    return kind.msgname if kind else f"message {message}"
