"""The times of a log without the steps of its clock. At a step, the vehicles' clocks are used.

This module knows only that three messages begin with `time_boot_ms`, milliseconds since the vehicle was
switched on: https://mavlink.io/en/messages/common.html#ATTITUDE
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from typing import Final, NamedTuple

_BOOT_IDS: Final = (30, 31, 33)  # ATTITUDE, ATTITUDE_QUATERNION, GLOBAL_POSITION_INT
_BACK_US: Final = 1_000_000  # two writers of one log may differ by this much
_AHEAD_US: Final = 3_000_000  # the longest pause that is not checked
_HOUR_US: Final = 3_600_000_000
_DAY_US: Final = 86_400_000_000
_REMEMBERED: Final = 1024  # records
_LOOK_AHEAD: Final = 400  # records that are read before a step is judged
_LOOK_AHEAD_US: Final = 3_000_000  # judge a step within this much of the log's new time
_AGREE_US: Final = 1_000_000  # boot times of one instant may differ by this, because of delays
_SAME_US: Final = 2_000_000  # a pause by the log's clock and by the vehicle's may differ by this
_SAME_SHARE: Final = 0.05  # a long pause may differ by this share of it
_MOST_SOURCES: Final = 16

_Source = tuple[int, int]  # system, component


class Record(NamedTuple):
    """One packet, and when it was received [µs since 1970]."""

    time_us: int
    raw: bytes

    @property
    def time_s(self) -> float:
        """Seconds since 1970."""
        return self.time_us / 1e6


class Timeline(Iterator[Record]):
    """The records of a log, to be read once. Their times never go back by more than a second.

    The log's time stamps are kept if they are continuous. A step is removed: the boot times of vehicles before
    and after it give the true length of the pause. A pause that they confirm is kept, and so is one of up to an hour
    without boot times. Without stamps (`stamped` is false) the time comes from boot times alone, and begins at 0.

    Counters: `steps`: how often the log's clock was set; `strays`: single records with a wrong time. `tell` is called
    at the first step or outlier.
    """

    def __init__(
        self, records: Iterable[Record], *, stamped: bool = True, tell: Callable[[], None] = lambda: None
    ) -> None:
        self.steps = 0
        self.strays = 0
        self._tell = tell
        self._records = iter(records)
        self._ahead: deque[Record] = deque()  # records read, but not returned yet
        self._past: deque[Record] = deque(maxlen=_REMEMBERED)  # returned lately
        self._shift = 0  # time line minus the log's stamps [µs]
        self._clocks: dict[_Source, int] = {}  # without stamps: time line minus a vehicle's boot time [µs]
        self._doubted: dict[_Source, int] = {}  # without stamps: a boot time that is not continuous
        self._line = self._by_stamps() if stamped else self._by_boot_times()

    def __iter__(self) -> Iterator[Record]:
        return self._line

    def __next__(self) -> Record:
        return next(self._line)

    def _by_stamps(self) -> Iterator[Record]:
        ahead, records, remember = self._ahead, self._records, self._past.append
        heard: int | None = None  # the latest time returned
        shift, most_back, most_ahead = 0, -_BACK_US, _AHEAD_US
        while (record := ahead.popleft() if ahead else next(records, None)) is not None:
            stamp = record.time_us
            time_us = stamp + shift
            if heard is None or 0 < time_us - heard <= most_ahead:
                heard = time_us
            elif not most_back <= time_us - heard <= 0:
                time_us = heard = self._placed(record, heard)
                shift = self._shift
            if time_us != stamp:
                record = Record(time_us, record.raw)
            remember(record)
            yield record

    def _placed(self, record: Record, heard: int) -> int:
        """Return the time [µs] of a record whose stamp is not continuous."""
        self._read_ahead(record.time_us)
        follows = any(-_BACK_US <= r.time_us + self._shift - heard <= _AHEAD_US for r in list(self._ahead)[:2])
        if follows or not self._ahead:
            self._count(strays=1)
            return heard
        stamped = record.time_us + self._shift
        by_boot = self._told_by_boot_times(record)
        if by_boot is not None and not 0 <= by_boot - heard + _AGREE_US <= _DAY_US:
            by_boot = None  # rebooted
        pause = stamped - heard
        if by_boot is None:
            real = 0 < pause <= _HOUR_US
        else:
            real = pause > 0 and abs(stamped - by_boot) <= max(_SAME_US, _SAME_SHARE * pause)
        if not real:
            self._count(steps=1)
            stamped = max(heard, by_boot or heard)
            self._shift = stamped - record.time_us
        return stamped

    def _read_ahead(self, since_us: int) -> None:
        while len(self._ahead) < _LOOK_AHEAD:
            if self._ahead and not -_BACK_US <= self._ahead[-1].time_us - since_us <= _LOOK_AHEAD_US:
                return
            if (record := next(self._records, None)) is None:
                return
            self._ahead.append(record)

    def _told_by_boot_times(self, record: Record) -> int | None:
        """Return the time of a record [µs], by boot times of vehicles before and after it.

        None if there is no such vehicle, or if no two boot times agree. The least delayed message counts.
        """
        clocks: dict[_Source, list[int]] = {}
        for past in self._past:
            if (said := _boot_time(past.raw)) is not None:
                clocks.setdefault(said[0], []).append(past.time_us - said[1])
        from statistics import median  # slow to import

        told = []
        for later in (record, *self._ahead):
            since = later.time_us - record.time_us
            if -_BACK_US <= since <= _LOOK_AHEAD_US and (said := _boot_time(later.raw)) and said[0] in clocks:
                told.append(round(median(clocks[said[0]][-9:])) + said[1] - since)
        told.sort(reverse=True)
        return next((a for a, b in pairwise(told) if a - b <= _AGREE_US), None)

    def _by_boot_times(self) -> Iterator[Record]:
        heard = 0
        for record in self._records:
            if said := _boot_time(record.raw):
                heard = self._advanced(*said, heard)
            yield Record(heard, record.raw)

    def _advanced(self, source: _Source, boot_us: int, heard: int) -> int:
        """Return the time [µs] of a boot time.

        One that is not continuous is used only if the next one agrees with it.
        """
        if source not in self._clocks:
            if len(self._clocks) < _MOST_SOURCES:
                self._clocks[source] = heard - boot_us
            return heard
        time_us = self._clocks[source] + boot_us
        doubted = self._doubted.pop(source, None)
        if -_BACK_US <= time_us - heard <= _AHEAD_US:
            return max(heard, time_us)
        if doubted is None or not 0 <= boot_us - doubted <= _AHEAD_US:
            self._doubted[source] = boot_us
            return heard
        if 0 < time_us - heard <= _HOUR_US:
            return time_us
        self._count(steps=1)
        self._clocks[source] = heard - boot_us
        return heard

    def _count(self, steps: int = 0, strays: int = 0) -> None:
        if not self.steps + self.strays:
            self._tell()
        self.steps += steps
        self.strays += strays


def _boot_time(raw: bytes) -> tuple[_Source, int] | None:
    """Return the sender of a packet and its boot time [µs]; None if the packet has no boot time."""
    if raw[0] == 0xFD:
        if len(raw) < 12 or raw[7] not in _BOOT_IDS or raw[8] or raw[9]:
            return None
        source, payload = (raw[5], raw[6]), raw[10 : 10 + min(raw[1], 4)]
    else:
        if len(raw) < 8 or raw[5] not in _BOOT_IDS:
            return None
        source, payload = (raw[3], raw[4]), raw[6 : 6 + min(raw[1], 4)]
    return source, 1000 * int.from_bytes(payload, "little")
