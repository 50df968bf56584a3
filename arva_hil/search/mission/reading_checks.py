"""Checks that the receiver works: frames are new, and readings change. Otherwise a search hovers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from arva_hil.events import Event
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.events.searches import PauseReason, SearchPaused, SearchResumed
from arva_hil.search.strategies.strategy import Position
from firmware_proto import Channel, Frame

_SILENT_S: Final = 2.0  # without a frame: the receiver does not work, hover
_LATE: Final = 8  # frames before the last one: it was overtaken; a larger step back is a restart of the receiver
_SAME_FRAMES: Final = 3  # at least
_OLD_M: Final = 0.5  # a slow receiver may repeat a reading for this distance
_OLD: Final = 0.1  # or this share of d, because far from a transmitter a reading changes little
_OLDEST_M: Final = 1.5  # but at most for this distance
_STUCK_M: Final = 3.0
_STUCK_S: Final = 5.0  # because a search hovers where it expects the transmitter


class NewFrames:
    """Remembers the sequence number of the last frame.

    A repeated number is the same frame, and a slightly lower one is late: neither is used. The decoders of formats
    without a sequence number count, so that each of their frames is new.
    """

    def __init__(self) -> None:
        self.repeats = 0  # of the last frame, in a row
        self._last: int | None = None

    def new(self, frame: Frame) -> bool:
        ahead = _LATE if self._last is None else (frame.sequence - self._last + _LATE) % 256
        if self._last is not None and ahead <= _LATE:
            self.repeats += ahead == _LATE
            return False
        self._last, self.repeats = frame.sequence, 0
        return True


class StuckReadings:
    """Remembers the `whole` frame's present reading, and that of each transmitter in it."""

    def __init__(self) -> None:
        self.whole = SameReading((), (0.0, 0.0, 0.0))
        self._each: dict[int | None, SameReading] = {}

    def repeats(self, id_: int | None) -> bool:
        """Return True if the reading of this transmitter is of another place."""
        return id_ in self._each and self._each[id_].old

    def observe(self, heard: Sequence[Channel], position: Position, time_s: float) -> None:
        """Use the channels of a new frame that have a signal, and the receiver's place."""
        self.whole = self.whole.after(tuple(heard), position, time_s)
        before, self._each, by_id = self._each, {}, dict[int | None, list[Channel]]()
        for channel in heard:
            by_id.setdefault(channel.id, []).append(channel)
        for id_, channels in by_id.items():
            same = before.get(id_) or SameReading(tuple(channels), position)
            self._each[id_] = same.after(tuple(channels), position, time_s)


class SameReading:
    """Remembers a reading, where and when it began, and how far away it came again.

    `old`: too far away to be of this place. `stuck`: too far for an equal reading, or repeated for too long.
    `moved_m`: the largest distance from where it began.
    """

    def __init__(self, channels: tuple[Channel, ...], at: Position) -> None:
        self.channels = channels
        self.old = self.stuck = False
        self.moved_m = 0.0
        self._at = at
        self._old_m = min(max(_OLD_M, _OLD * min((c.d for c in channels), default=0) / 100), _OLDEST_M)
        self._old_since = math.inf
        self._frames = 0

    def after(self, channels: tuple[Channel, ...], position: Position, time_s: float) -> SameReading:
        """Return this object if these channels are the same, otherwise a new one."""
        same = self if channels == self.channels else SameReading(channels, position)
        if channels:
            same._frames += 1
            same.moved_m = max(same.moved_m, math.dist(position, same._at))
            same.old = same.moved_m > same._old_m
            same._old_since = min(same._old_since, time_s) if same.old else math.inf
            long = same.moved_m > _STUCK_M or time_s - same._old_since > _STUCK_S
            same.stuck = same.stuck or (long and same._frames >= _SAME_FRAMES)
        return same


class Pauses:
    """Remembers the last frame, and why the vehicle hovers. `readings`: those that do not change.

    `patience_s`: it hovers no longer than that. `emit` gets the events.
    """

    def __init__(self, start_s: float, patience_s: float, emit: Callable[[Event], None]) -> None:
        self._patience_s = patience_s
        self._last_frame_s = self._since_s = start_s
        self._why: PauseReason | None = None
        self.readings = StuckReadings()
        self._emit = emit

    def on_frame(self, heard: Sequence[Channel], position: Position, time_s: float) -> bool:
        """Check the channels with a signal of a new frame. Returns False if it repeats a reading from another place."""
        self._last_frame_s = time_s
        self.readings.observe(heard, position, time_s)
        return not self.readings.whole.old

    def silent(self, time_s: float) -> Reason | None:
        """Return the end of the search if no frame came for too long."""
        too_long = time_s - self._last_frame_s > self._patience_s
        return because(Why.NO_FRAME, seconds=self._patience_s) if too_long else None

    def waits(self, time_s: float) -> bool:
        """Return True if the search hovers because the receiver does not work."""
        before, stuck = self._why, self.readings.whole.stuck
        silent = time_s - self._last_frame_s > _SILENT_S
        why: PauseReason | None = "same readings" if stuck else None
        self._why = why = "no frame" if silent else why
        if why and why != before:
            self._since_s = time_s
            self._emit(SearchPaused(time_s, why, _SILENT_S, round(self.readings.whole.moved_m, 1)))
        elif before and not why:
            self._emit(SearchResumed(time_s, before))
        return why is not None

    def stuck(self, time_s: float) -> Reason | None:
        """Return the end of the search if the same reading came for too long."""
        too_long = self._why == "same readings" and time_s - self._since_s > self._patience_s
        return because(Why.SAME_READING) if too_long else None
