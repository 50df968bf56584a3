"""The layout of records in a telemetry log: the time stamp, where a record starts, what may follow it.

This module knows only the length of MAVLink packets: https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

import re
import struct
from typing import Final

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
