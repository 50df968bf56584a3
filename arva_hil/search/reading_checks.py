"""Is the receiver alive? Frames that come again are none, and readings that never change are of no use."""

from __future__ import annotations

import math
from typing import Final

from arva_hil.search.strategy import Position
from firmware_proto import Channel, Frame

_LATE: Final = 8  # frames behind the last: one that was overtaken; farther back the receiver has started anew
_SAME_FRAMES: Final = 3  # at least
_OLD_M: Final = 0.5  # a slow receiver may say the same for so long
_STUCK_M: Final = 3.0
_STUCK_S: Final = 5.0  # it flies to a place where it believes the transmitter, and hovers there


class NewFrames:
    """Remembers the sequence number of the last frame.

    A number that comes again is the same frame, and one a little lower is late: neither says anything of now. Formats
    without a sequence number count for themselves, so that each of their frames is new.
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
    """Remembers since where and when the receiver says the same, and how far from there it has been since.

    `old`: so far that what it says is none of here. `stuck`: too far to be true, or off that place for too long.
    """

    def __init__(self) -> None:
        self.old = self.stuck = False
        self.moved_m = 0.0
        self._channels: tuple[Channel, ...] = ()
        self._at: Position = (0.0, 0.0, 0.0)
        self._old_since = math.inf
        self._frames = 0

    def hear(self, frame: Frame, position: Position, time_s: float) -> None:
        """A new frame, and where the receiver was."""
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
