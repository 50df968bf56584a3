"""A search strategy: to where the receiver heard the transmitter nearest, and about it in a growing spiral."""

from __future__ import annotations

import math

from arva_hil import Found, Observation

_NEAR_CM = 500
_STEP_M = 1.0  # from one round of the spiral to the next


class Homing:
    """Remembers the nearest reading and where it was heard."""

    def __init__(self, speed: float) -> None:
        self.found: Found | None = None
        self._speed = speed
        self._best: tuple[int, float, float] | None = None
        self._turned = 0.0  # rad on the spiral about the best place
        self._time_s = 0.0

    def observe(self, observation: Observation) -> None:
        north, east, _ = observation.position
        if observation.heard and (self._best is None or observation.d_cm < self._best[0]):
            self._best, self._turned = (observation.d_cm, north, east), 0.0
        if self._best and self._best[0] < _NEAR_CM and self._turned > 2 * math.pi:
            self.found = Found(self._best[1], self._best[2])

    def velocity(self, time_s: float, position: tuple[float, float, float]) -> tuple[float, float]:
        passed, self._time_s = min(time_s - self._time_s, 1.0), time_s
        if self._best is None:
            return self._speed, 0.0
        radius = _STEP_M * (1 + self._turned / (2 * math.pi))
        self._turned += 0.7 * self._speed * passed / radius
        north = self._best[1] + radius * math.cos(self._turned) - position[0]
        east = self._best[2] + radius * math.sin(self._turned) - position[1]
        share = self._speed / max(math.hypot(north, east), self._speed)
        return north * share, east * share
