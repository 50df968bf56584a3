"""MAVLink telemetry logs: again and again 8 bytes, big-endian microseconds since 1970, then one raw packet.

All that is known of MAVLink here is how long a packet is: https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

import os
import re
import stat
import struct
from collections.abc import Generator, Iterator
from typing import BinaryIO, Final, NamedTuple

from arva_hil.clock import Clock
from arva_hil.links.base import Link, LinkEnded, LinkError

_CHUNK: Final = 65536
_LONGEST: Final = 8 + 12 + 255 + 13  # bytes of a record
_AHEAD: Final = 4 * _LONGEST  # bytes kept in sight: a record and those that it is judged by
_DAY_US: Final = 86_400_000_000
_YEAR_2001_US: Final = 978_307_200_000_000
_YEAR_2100_US: Final = 4_102_444_800_000_000
_HEAD: Final = struct.Struct(">Q3B")  # time, then of the packet: magic, payload length, flags (MAVLink 2)
_STAMP: Final = re.compile(rb"\x00[\x03-\x0e][\s\S]{6}[\xfd\xfe]")  # a time 2001…2100 and a magic, roughly


class Record(NamedTuple):
    """One packet and when it was received, in microseconds since 1970."""

    time_us: int
    raw: bytes

    @property
    def time_s(self) -> float:
        """Seconds since 1970."""
        return self.time_us / 1e6


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

    A record's time is within a day of the one before, the first one's in 2001…2100. Behind garbage a record
    counts only when another one or the file's end follows it. A record that another one starts inside of was
    cut and counts as garbage.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = os.fspath(path)
        self.records = self.skipped = self.torn = self.consumed = 0
        self.first_us: int | None = None
        self.last_us: int | None = None
        self._file = _open_regular(self.path)
        self.size = os.fstat(self._file.fileno()).st_size
        self._records = self._read()

    def __iter__(self) -> Iterator[Record]:
        return self._records

    def __next__(self) -> Record:
        return next(self._records)

    def close(self) -> None:
        self._records.close()
        self._file.close()

    def _read(self) -> Generator[Record, None, None]:
        buffer, at, ended = b"", 0, False
        length = time_us = 0  # of the record at `at`; 0: not known yet, or none starts there
        in_step = True  # at the file's start or right behind a record
        while True:
            if len(buffer) - at < _AHEAD and not ended:
                chunk = self._chunk()
                buffer, at, ended = buffer[at:] + chunk, 0, not chunk
                continue
            size = len(buffer)
            if not length:
                length, time_us = _look(buffer, at, self.last_us)
            end = at + length
            if length:
                following = _look(buffer, end, time_us)
                good = following[0] or end == size
                if not good and in_step and end < size:  # garbage follows, unless this one was cut by another
                    good = _find(buffer, at + 1, end, self.last_us) is None
                if good:
                    record = Record(time_us, buffer[at + 8 : end])
                    if self.first_us is None:
                        self.first_us = time_us
                    self.last_us = time_us
                    self.records += 1
                    self.consumed += length
                    at, in_step = end, True
                    length, time_us = following
                    yield record
                    continue
            found = _find(buffer, at, size, self.last_us)
            goal = (size if ended else size - _AHEAD // 2) if found is None else found
            if ended and found is None and (end > size or size - at < _HEAD.size):
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

    Time is `clock`'s, counted from when the link was opened. Writes go nowhere. `read` raises LinkEnded
    behind the last record. `reader` has the counters.
    """

    def __init__(self, path: str | os.PathLike[str], clock: Clock) -> None:
        self.reader = read_tlog(path)
        self.name = self.reader.path
        self._clock = clock
        self._start = clock.now()
        self._next = next(self.reader, None)

    def read(self) -> bytes:
        if self._next is None:
            if not self.reader.records:
                raise LinkError(self.name, "there is no packet in it", "is it a MAVLink telemetry log?")
            raise LinkEnded(self.name, "end of log")
        due = []
        while self._next and self.ready():
            due.append(self._next.raw)
            self._next = next(self.reader, None)
        return b"".join(due)

    def write(self, data: bytes) -> bool:
        return True

    def close(self) -> None:
        self.reader.close()
        self._next = None

    def ready(self) -> bool:
        if self._next is None:
            return True
        first_us = self.reader.first_us or 0
        return self._clock.now() - self._start >= (self._next.time_us - first_us) / 1e6


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


def _look(buffer: bytes, at: int, near: int | None) -> tuple[int, int]:
    """Length [bytes] and time of the record at `at`; (0, 0) when by its time or magic none starts there."""
    if at + _HEAD.size > len(buffer):
        return 0, 0
    time_us, magic, payload, flags = _HEAD.unpack_from(buffer, at)
    if near is None:
        if not _YEAR_2001_US <= time_us < _YEAR_2100_US:
            return 0, 0
    elif not -_DAY_US <= time_us - near <= _DAY_US:
        return 0, 0
    if magic == 0xFD:
        return payload + (33 if flags & 1 else 20), time_us
    return (payload + 16, time_us) if magic == 0xFE else (0, 0)


def _find(buffer: bytes, start: int, stop: int, near: int | None) -> int | None:
    """Where the first record starts in [start, stop) that another one follows, or the buffer's end."""
    found = _STAMP.search(buffer, start)
    while found and found.start() < stop:
        at = found.start()
        length, time_us = _look(buffer, at, near)
        if length and (at + length == len(buffer) or _look(buffer, at + length, time_us)[0]):
            return at
        found = _STAMP.search(buffer, at + 1)
    return None
