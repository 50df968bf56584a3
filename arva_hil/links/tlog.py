"""MAVLink telemetry logs: again and again 8 bytes, big-endian microseconds since 1970, then one raw packet.

Logs with little-endian times are read too, and streams of packets without times.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Generator, Iterator
from typing import BinaryIO, Final

from arva_hil.links.base import Link, LinkEnded, LinkError, Opening
from arva_hil.links.tlog_layout import BARE, DAY_US, LONGEST, find, follows, is_step, layout_of, look
from arva_hil.links.tlog_timeline import Record, Timeline
from arva_hil.links.url import Address
from arva_hil.runtime.clock import Clock

__all__ = ["Record", "TlogLink", "TlogReader", "read_tlog", "tlog_record"]

_CHUNK: Final = 65536
_AHEAD: Final = 4 * LONGEST  # bytes kept in sight: a record and those that it is judged by


def tlog_record(time_us: int, raw: bytes) -> bytes:
    """The bytes of one record: a packet received at `time_us`, microseconds since 1970, 0 to 2**64 - 1."""
    if not 0 <= time_us < 1 << 64:
        raise ValueError(f"time_us must be 0 to 2**64 - 1, is {time_us}")
    return time_us.to_bytes(8, "big") + raw


def read_tlog(path: str | os.PathLike[str]) -> TlogReader:
    """Open a log to iterate over its records. Raises LinkError: missing, a directory, no permission."""
    return TlogReader(path)


class TlogReader(Iterator[Record]):
    """The records of a log, once, in the file's order, whatever else is in the file; memory stays flat.

    Counters, right at any moment of the iteration: `records`; `skipped`, bytes of garbage between records;
    `torn`, bytes of a last record that the file's end cuts; `consumed` of `size` bytes. `first_us` and
    `last_us` are the times of the first and the latest record, None before the first.

    A record's time is within a day of the one before, the first one's in 2001…2100; a clock that steps further, or is
    wrong from the start, is believed where records go on without a gap. Behind garbage a record counts only when
    another one or the file's end follows it. A record that another one starts inside of was cut and counts as garbage.
    Without times (`stamped` is false) every record's time is 0; `layout` says how the file is laid out.
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
        """Whether records have times."""
        return self._layout is not BARE

    @property
    def layout(self) -> str:
        """Which times there are, for a person."""
        return self._layout.name

    def __iter__(self) -> Iterator[Record]:
        return self._records

    def __next__(self) -> Record:
        return next(self._records)

    def close(self) -> None:
        self._records.close()
        self._file.close()

    def _read(self) -> Generator[Record, None, None]:
        layout, before = self._layout, self._layout.before
        buffer, at, ended = self._start, 0, False
        self._start = b""
        length = time_us = 0  # of the record at `at`; 0: not known yet, or none starts there
        in_step = True  # at the file's start or right behind a record
        while True:
            if len(buffer) - at < _AHEAD and not ended:
                chunk = self._chunk()
                buffer, at, ended = buffer[at:] + chunk, 0, not chunk
                continue
            size, last = len(buffer), self.last_us
            if length and last is not None and layout is not BARE and -DAY_US <= time_us - last <= DAY_US:
                while size - at >= _AHEAD:  # the many that simply follow each other, without the calls below
                    next_us, magic, payload, flags = layout.unpack(buffer, end := at + length)
                    if not -DAY_US <= next_us - time_us <= DAY_US or (magic != 0xFD and magic != 0xFE):
                        break
                    raw = buffer[at + before : end]
                    self.last_us, self.records, self.consumed = time_us, self.records + 1, self.consumed + length
                    yield Record(time_us, raw)
                    at, time_us = end, next_us
                    length = payload + (16 if magic == 0xFE else 33 if flags & 1 else 20)
                if size - at < _AHEAD and not ended:
                    continue
                last = self.last_us
            if not length:
                length, time_us = look(buffer, at, layout)
            end = at + length
            if length and end <= size:
                following = look(buffer, end, layout)
                if (last is not None and -DAY_US <= time_us - last <= DAY_US) or follows(last, time_us, layout):
                    good = (following[0] and -DAY_US <= following[1] - time_us <= DAY_US) or end == size
                    if not good and in_step and end < size:  # garbage follows, unless this one was cut by another
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
            goal = (size if ended else size - _AHEAD // 2) if found is None else found
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
    """A log as if it came from a vehicle: each packet at its time behind the first one, which comes at once.

    Where the log's clock was set, its `Timeline` goes on. Time is `clock`'s, counted from when the link was opened.
    Writes go nowhere. `read` raises LinkEnded behind the last record. `reader` has the counters.
    """

    @classmethod
    def open(cls, address: Address, how: Opening) -> Link:
        """See `Link`."""
        return cls(address.path, how.clock)

    def __init__(self, path: str | os.PathLike[str], clock: Clock) -> None:
        self.reader = read_tlog(path)
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
        mode = os.stat(path).st_mode  # before it is opened: opening a pipe would wait
        if not stat.S_ISREG(mode):
            raise LinkError(path, "is a directory" if stat.S_ISDIR(mode) else "is not a regular file")
        return open(path, "rb")
    except FileNotFoundError:
        raise LinkError(path, "no such file") from None
    except PermissionError as error:
        raise LinkError(path, "permission denied", f"ls -l {path}") from error
    except (OSError, ValueError) as error:
        raise LinkError(path, f"cannot be opened: {error}") from error
