"""MAVLink telemetry logs. Each record is a time stamp and one raw packet.

A time stamp is 8 bytes: microseconds since 1970, big-endian. Logs with little-endian time stamps are read too, and
streams of packets without time stamps.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Generator, Iterable, Iterator
from typing import BinaryIO, Final

from arva_hil.clock import Clock
from arva_hil.links.base import Link, LinkEnded, LinkError, Opening
from arva_hil.links.tlog_layout import BARE, DAY_US, LONGEST, find, follows, is_step, layout_of, look
from arva_hil.links.tlog_timeline import Record, Timeline
from arva_hil.links.url import Address

_CHUNK: Final = 65536
_AHEAD: Final = 4 * LONGEST  # bytes kept in the buffer: a record and those needed to judge it


def tlog_record(time_us: int, raw: bytes) -> bytes:
    """Return the bytes of one record: a packet received at `time_us`, microseconds since 1970, 0 to 2**64 - 1."""
    if not 0 <= time_us < 1 << 64:
        raise ValueError(f"time_us must be 0 to 2**64 - 1, is {time_us}")
    return time_us.to_bytes(8, "big") + raw


class TlogReader(Iterable[Record]):
    """An iterator over the records of a log, in the file's order. It skips garbage, and needs little memory.

    Raises LinkError if the file cannot be opened: no such file, a directory, no permission.

    Counters, right during the iteration too:

    - `records`: the records so far. `consumed`: the bytes so far, of `size`.
    - `skipped`: the bytes of garbage between records. `torn`: the bytes of an incomplete last record.
    - `first_us`, `last_us`: the times of the first and the latest record; None before the first.

    `stamped` is False for a log without time stamps; then every record's time is 0. `layout`: the layout of the
    records, in words.

    The time of a record must be within a day of the one before, and the first in 2001…2100. Other times are accepted if
    records follow without a gap. After garbage, a record counts only if another record or the file's end follows it. A
    record inside which another one starts counts as garbage.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = os.fspath(path)
        self.records = self.skipped = self.torn = self.consumed = 0
        self.first_us: int | None = None
        self.last_us: int | None = None
        self._file = _open_regular(self.path)
        self.size = os.fstat(self._file.fileno()).st_size
        self._start = self._chunk()
        self._layout = layout_of(self._start)
        self._records = self._read()

    @property
    def stamped(self) -> bool:
        """True if records have times."""
        return self._layout is not BARE

    @property
    def layout(self) -> str:
        """The kind of time stamps, for a person."""
        return self._layout.name

    def __iter__(self) -> Iterator[Record]:
        return self._records

    def close(self) -> None:
        self._records.close()
        self._file.close()

    def _read(self) -> Generator[Record, None, None]:
        layout, before = self._layout, self._layout.before
        buffer, self._start, at, ended = self._start, b"", 0, False
        length = time_us = 0  # of the record at `at`; 0: not known yet, or no record starts there
        in_step = True  # at the file's start or directly after a record
        while True:
            if len(buffer) - at < _AHEAD and not ended:
                chunk = self._chunk()
                buffer, at, ended = buffer[at:] + chunk, 0, not chunk
                continue
            size, last = len(buffer), self.last_us
            if not length:
                length, time_us = look(buffer, at, layout)
            end = at + length
            if length and end <= size:
                following = look(buffer, end, layout)
                if (last is not None and -DAY_US <= time_us - last <= DAY_US) or follows(last, time_us, layout):
                    good = (following[0] and -DAY_US <= following[1] - time_us <= DAY_US) or end == size
                    if not good and in_step and end < size:  # garbage follows, or another record cut this one
                        good = find(buffer, at + 1, end, self.last_us, layout) is None
                else:
                    good = is_step(buffer, at, self.last_us if in_step else None, layout)
                if good:
                    record = Record(time_us, buffer[at + before : end])
                    if self.first_us is None:
                        self.first_us = time_us
                    self.last_us = time_us
                    self.records += 1
                    self.consumed += length
                    at, in_step = end, True
                    length, time_us = following
                    yield record
                    continue
            found = find(buffer, at, size, self.last_us, layout)
            goal = size if ended else size - _AHEAD // 2
            goal = goal if found is None else found
            if ended and found is None and (end > size or size - at < layout.size):
                self.torn = size - at
            else:
                self.skipped += goal - at
            self.consumed += goal - at
            at, length, in_step = goal, 0, False
            if ended and at == size:
                self._file.close()
                return

    def _chunk(self) -> bytes:
        try:
            return self._file.read(_CHUNK)
        except OSError as error:
            raise LinkError(self.path, f"cannot be read: {error.strerror}") from error


class TlogLink(Link):
    """Plays a log in real time by `clock`. The first packet comes at once.

    A `Timeline` removes the steps of the log's clock. Writes are discarded. `read` raises LinkEnded after the last
    record. `reader` has the counters.
    """

    @classmethod
    def open(cls, address: Address, how: Opening) -> Link:
        return cls(address.path, how.clock)

    def __init__(self, path: str | os.PathLike[str], clock: Clock) -> None:
        self.reader = TlogReader(path)
        self.name = self.reader.path
        self._clock = clock
        self._start = clock.now()
        self._records = Timeline(self.reader, stamped=self.reader.stamped)
        self._next = next(self._records, None)
        self._first_us = self._next.time_us if self._next else 0

    def read(self) -> bytes:
        if self._next is None:
            if not self.reader.records:
                raise LinkError(self.name, "there is no packet in it", "is it a MAVLink telemetry log?")
            raise LinkEnded(self.name, "end of log")
        due = []
        while self._next and self.ready():
            due.append(self._next.raw)
            self._next = next(self._records, None)
        return b"".join(due)

    def write(self, data: bytes) -> bool:
        return True

    def close(self) -> None:
        self.reader.close()
        self._next = None

    def ready(self) -> bool:
        if self._next is None:
            return True
        return self._clock.now() - self._start >= (self._next.time_us - self._first_us) / 1e6


def _open_regular(path: str) -> BinaryIO:
    try:
        mode = os.stat(path).st_mode  # before `open`, which would wait for the writer of a pipe
        if not stat.S_ISREG(mode):
            raise LinkError(path, "is a directory" if stat.S_ISDIR(mode) else "is not a regular file")
        return open(path, "rb")
    except FileNotFoundError:
        raise LinkError(path, "no such file") from None
    except PermissionError as error:
        raise LinkError(path, "permission denied", f"ls -l {path}") from error
    except (OSError, ValueError) as error:
        raise LinkError(path, f"cannot be opened: {error}") from error
