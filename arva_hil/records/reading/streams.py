"""The rates of each message of a vehicle: from the packets in a record's logs."""

from __future__ import annotations

import math
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
from arva_hil.mavlink.codec import dialect
from arva_hil.records.reading.lines import RecordingError, mapping, text
from arva_hil.records.reading.recording import Recording
from arva_hil.records.writing.layout import TLOG

_MOST: Final = 1_000_000  # largest number of pairs of message and second
_LONGEST_S: Final = 1_000_000


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
    for time_s, message, _ in packets(recording, vehicle):
        counts[message, math.floor(time_s)] += 1
        if len(counts) > _MOST:
            raise RecordingError(recording.folder, "the times of its packets are too far apart to be right")
    return _streams(counts)


def packets(recording: Recording, vehicle: str = "") -> Iterator[tuple[float, int, bytes]]:
    """Yield the packets of a vehicle: time from the start of the run [s], message id, bytes.

    If its ids are unknown, yield all packets of its log. Raises RecordingError if the log cannot be read.
    """
    said = recording.run.vehicle(vehicle) if recording.run else {}
    known = mapping(said.get("vehicle"))
    ids = known.get("system"), known.get("component")
    path = recording.folder / Path(text(said.get("tlog")) or TLOG).name
    if not path.exists():
        return
    try:
        with closing(TlogReader(path)) as log:
            start_us = None if recording.log_start_s is None else recording.log_start_s * 1e6
            for time_us, raw in log:
                system, component, message = _head(raw)
                if None in ids or (system, component) == ids:
                    start_us = time_us if start_us is None else start_us
                    yield (time_us - start_us) / 1e6, message, raw
    except LinkError as error:
        raise RecordingError(path, str(error)) from None


def _head(raw: bytes) -> tuple[int, int, int]:
    """Return system, component and message id of a packet."""
    if raw[0] == 0xFD:
        return raw[5], raw[6], int.from_bytes(raw[7:10], "little")
    return raw[3], raw[4], raw[5]


def _streams(counts: Counter[tuple[int, int]]) -> list[RecordedStream]:
    seconds = [second for _, second in counts]
    if not seconds:
        return []
    first, last = min(seconds), max(seconds)
    if last - first > _LONGEST_S:
        return []
    rows: dict[int, NDArray[np.float64]] = {}
    for (message, second), count in counts.items():
        row = rows.setdefault(message, np.zeros(last - first + 1))
        row[second - first] = count
    time_s = np.arange(first, last + 1, dtype=float)
    found = [RecordedStream(_name(message), time_s, row) for message, row in rows.items()]
    return sorted(found, key=lambda stream: -float(stream.hz.sum()))


def _name(message: int) -> str:
    kind = dialect.mavlink_map.get(message)
    return kind.msgname if kind else f"message {message}"
