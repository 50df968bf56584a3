"""MAVLink telemetry logs. Each record is a time stamp and one raw packet.

A time stamp is 8 bytes: microseconds since 1970, big-endian. Logs with little-endian time stamps are read too, and
streams of packets without time stamps.
"""

from __future__ import annotations

import os
import re
import stat
import struct
from collections.abc import Generator, Iterable, Iterator
from typing import BinaryIO, Final

from arva_hil.clock import Clock
from arva_hil.links.base import Link, LinkEnded, LinkError, Opening
from arva_hil.links.tlog_timeline import Record, Timeline
from arva_hil.links.url import Address

_CHUNK: Final = 65536


LONGEST: Final = 8 + 12 + 255 + 13  # bytes of a record
DAY_US: Final = 86_400_000_000
_YEAR_2001_US: Final = 978_307_200_000_000
_YEAR_2100_US: Final = 4_102_444_800_000_000


class TlogLayout:
    """A layout of records. `name`: for a person; `before`: bytes before the packet; `size`: bytes of time and head."""

    def __init__(self, name: str, time: str, begins: bytes, enough: int) -> None:
        self.name = name
        self.begins = re.compile(begins)  # matches the time stamp and the magic byte, roughly
        self.enough = enough  # this many records in a row cannot be chance
        head = struct.Struct(f"{time}3B")  # time, and the packet's magic, payload length and flags (MAVLink 2)
        self.size = head.size
        self.before = head.size - 3
        self.unpack = head.unpack_from


BIG: Final = TlogLayout("big-endian times", ">Q", rb"\x00[\x00-\x0e][\s\S]{6}[\xfd\xfe]", 3)
LITTLE: Final = TlogLayout("little-endian times", "<Q", rb"[\s\S]{6}[\x00-\x0e]\x00[\xfd\xfe]", 3)
BARE: Final = TlogLayout("no times", "", rb"[\xfd\xfe]", 10)


def look(buffer: bytes, at: int, layout: TlogLayout) -> tuple[int, int]:
    """Return length [bytes] and time [µs] of the record at `at`; (0, 0) if its time or magic is impossible."""
    if at + layout.size > len(buffer):
        return 0, 0
    if layout is BARE:
        time_us, (magic, payload, flags) = 0, layout.unpack(buffer, at)
    else:
        time_us, magic, payload, flags = layout.unpack(buffer, at)
        if time_us >= _YEAR_2100_US:
            return 0, 0
    if magic == 0xFD:
        return layout.before + payload + (25 if flags & 1 else 12), time_us
    return (layout.before + payload + 8, time_us) if magic == 0xFE else (0, 0)


def follows(near: int | None, time_us: int, layout: TlogLayout) -> bool:
    """Return True if a record's time is plausible after one at `near`; None: it is the first record."""
    if near is None:
        return time_us >= _YEAR_2001_US or layout is BARE
    return abs(time_us - near) <= DAY_US


def is_step(buffer: bytes, at: int, before: int | None, layout: TlogLayout) -> bool:
    """Return True if the log's clock was set before the record at `at`.

    Two more records, or the file's end, then follow without a gap, and their times agree with it. If a record at time
    `before` is directly before it, they may agree with that.
    """
    length, first = look(buffer, at, layout)
    near = [first] if before is None else [first, before]
    if (end := at + length) == len(buffer):
        return before is not None
    for _ in range(layout.enough - 1):
        length, time_us = look(buffer, end, layout)
        if not length or not any(abs(time_us - other) <= DAY_US for other in near):
            return False
        if (end := end + length) == len(buffer):
            return True
    return end < len(buffer)


def find(buffer: bytes, start: int, stop: int, near: int | None, layout: TlogLayout) -> int | None:
    """Return the start of the first record in [start, stop) that is followed by another one or by the buffer's end."""
    found = layout.begins.search(buffer, start)
    while found and found.start() < stop:
        at = found.start()
        length, time_us = look(buffer, at, layout)
        if length and follows(near, time_us, layout):
            following = look(buffer, at + length, layout)
            if at + length == len(buffer) or (following[0] and abs(following[1] - time_us) <= DAY_US):
                return at
        elif length and is_step(buffer, at, None, layout):
            return at
        found = layout.begins.search(buffer, at + 1)
    return None


def layout_of(start: bytes) -> TlogLayout:
    """Return the layout of the file with these first bytes."""
    if _row(start, 0, BIG):
        return BIG
    if _covered(start, LITTLE) > (big := _covered(start, BIG)):
        return LITTLE
    return BARE if not big and _covered(start, BARE) > len(start) / 2 else BIG  # any data contains packets by chance


def _row(buffer: bytes, at: int, layout: TlogLayout) -> int:
    """Return bytes of the records in a row from `at` on; 0 if so few may be chance."""
    start, count, near = at, 0, 0
    while True:
        length, time_us = look(buffer, at, layout)
        if not length or at + length > len(buffer) or (count and abs(time_us - near) > DAY_US):
            return at - start if count >= layout.enough else 0
        at, count, near = at + length, count + 1, time_us


def _covered(buffer: bytes, layout: TlogLayout) -> int:
    """Return bytes of records in rows that cannot be chance."""
    covered = 0
    found = layout.begins.search(buffer)
    while found:
        row = _row(buffer, found.start(), layout)
        covered += row
        found = layout.begins.search(buffer, found.start() + max(1, row))
    return covered


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
    - `last_us`: the time of the latest record; None before the first.

    `stamped` is False for a log without time stamps; then every record's time is 0. `layout`: the layout of the
    records, in words.

    The time of a record must be within a day of the one before, and the first in 2001…2100. Other times are accepted if
    records follow without a gap. After garbage, a record counts only if another record or the file's end follows it. A
    record inside which another one starts counts as garbage.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = os.fspath(path)
        self.records = self.skipped = self.torn = self.consumed = 0
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
