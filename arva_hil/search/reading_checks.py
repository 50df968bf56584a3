"""Is the receiver alive? Frames that come again are none, and readings that never change are of no use."""

from __future__ import annotations

import math
from typing import Final

from arva_hil.search.strategy import Position
from firmware_proto import Channel, Frame

_LATE: Final = 8  # frames behind the last: one that was overtaken; farther back the receiver has started anew
_SAME_FRAMES: Final = 3  # at least


class Fresh:
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


class Standstill:
    """Remembers since where the receiver says the same. `stuck`: over too many `METRES` to be true."""

    METRES: Final = 3.0

    def __init__(self) -> None:
        self.stuck = False
        self._channels: tuple[Channel, ...] = ()
        self._at: Position = (0.0, 0.0, 0.0)
        self._frames = 0

    def hear(self, frame: Frame, position: Position) -> None:
        """A new frame, and where the receiver was."""
        if frame.channels != self._channels:
            self._channels, self._at, self._frames, self.stuck = frame.channels, position, 0, False
        self._frames += 1
        hears = any(channel.valid for channel in frame.channels)
        far = math.dist(position, self._at) > self.METRES
        self.stuck = self.stuck or (hears and far and self._frames >= _SAME_FRAMES)
