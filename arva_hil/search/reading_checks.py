"""Checks that the receiver works: frames must be new, and readings must change."""

from __future__ import annotations

import math
from typing import Final

from arva_hil.search.strategy import Position
from firmware_proto import Channel, Frame

_LATE: Final = 8  # frames before the last one: it was overtaken; a larger step back is a restart of the receiver
_SAME_FRAMES: Final = 3  # at least
_OLD_M: Final = 0.5  # a slow receiver may repeat a reading for this distance
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
    """Remembers where and when the present reading began, and the largest distance from there since then.

    `old`: so far away that the reading is not of this place. `stuck`: too far for an equal reading, or away for too
    long.
    """

    def __init__(self) -> None:
        self.old = self.stuck = False
        self.moved_m = 0.0
        self._channels: tuple[Channel, ...] = ()
        self._at: Position = (0.0, 0.0, 0.0)
        self._old_since = math.inf
        self._frames = 0

    def hear(self, frame: Frame, position: Position, time_s: float) -> None:
        """Use a new frame and the receiver's place."""
        if frame.channels != self._channels:
            self._channels, self._at, self._frames = frame.channels, position, 0
            self.old, self.stuck, self.moved_m, self._old_since = False, False, 0.0, math.inf
        self._frames += 1
        if not any(channel.valid for channel in frame.channels):
            return
        self.moved_m = max(self.moved_m, math.dist(position, self._at))
        self.old = self.old or self.moved_m > _OLD_M
        self._old_since = min(self._old_since, time_s) if self.old else math.inf
        long = self.moved_m > _STUCK_M or time_s - self._old_since > _STUCK_S
        self.stuck = self.stuck or (long and self._frames >= _SAME_FRAMES)
