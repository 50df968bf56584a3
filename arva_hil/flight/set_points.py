"""When to send set-points, so that the autopilot follows them, and how long none was sent."""

from __future__ import annotations

import math
from typing import Final

EVERY_S: Final = 0.2  # PX4 leaves OFFBOARD below 2 Hz, ArduPilot stops after 3 s
_LONG_S: Final = 0.8  # PX4's COM_OF_LOSS_T is 1 s
_OF_LATE_S: Final = 5.0


class Pace:
    """Remembers the last set-point and the longest gap lately. Times are seconds on the caller's clock."""

    def __init__(self) -> None:
        self._last = self._next = -math.inf
        self._longest = (0.0, -math.inf)  # the gap [s], and when it ended

    def due(self, now: float) -> bool:
        return now >= self._next

    def left(self, now: float) -> None:
        """A set-point was sent."""
        gap = now - self._last
        if self._last > -math.inf and (gap > self._longest[0] or now - self._longest[1] > _OF_LATE_S):
            self._longest = gap, now
        self._last, self._next = now, max(self._next + EVERY_S, now)

    def rest(self) -> None:
        """No set-points are needed from now on."""
        self._last = -math.inf

    def stalled_s(self, now: float) -> float:
        """The longest gap [s] lately; 0 if they were sent often enough."""
        gap, until = self._longest
        worst = max(gap if now - until <= _OF_LATE_S else 0.0, now - self._last if self._last > -math.inf else 0.0)
        return worst if worst > _LONG_S else 0.0
