"""A search strategy: along the flux line, then crosses about the place with the smallest d."""

from __future__ import annotations

import math

from arva_hil import STILL, Found, Observation, Position, Velocity, towards

NEAR_M = 8.0  # fly crosses if d is smaller
ARM_M = 3.0  # length of a cross's arm
SAME_M = 1.0  # end if a cross moves the best place by less


class Follow:
    """State: the course, the place with the smallest d, and the corners of the cross that are left."""

    def __init__(self, speed: float) -> None:
        self.found: Found | None = None
        self._speed = speed  # m/s, the limit
        self._course: float | None = None  # radians from north
        self._last_d = math.inf  # m
        self._best = math.inf, (0.0, 0.0)  # d, and where: m north, m east
        self._centre: tuple[float, float] | None = None  # of the present cross
        self._corners: list[tuple[float, float]] = []

    def observe(self, observation: Observation) -> None:
        """Use one frame."""
        if not observation.heard:
            return
        self._best = min(self._best, (observation.d_m, observation.position[:2]))
        if self._centre is None and observation.d_m < NEAR_M:
            self._begin_cross()
        elif not observation.inner:  # δ is not valid in the inner zone
            self._turn(observation)
        self._last_d = observation.d_m

    def velocity(self, time_s: float, position: Position) -> Velocity:
        """Return the velocity to fly now, m/s north and east."""
        if self._centre is not None:
            return self._fly_cross(position)
        if self._course is None:
            return STILL
        return self._speed * math.cos(self._course), self._speed * math.sin(self._course)

    def _turn(self, observation: Observation) -> None:
        """Follow the line that δ gives, in the same direction as before; turn round if d grows."""
        line = observation.bearing
        if self._course is not None:
            ahead = self._course + (math.pi if observation.d_m > self._last_d else 0.0)
            line += 0.0 if math.cos(line - ahead) > 0 else math.pi
        self._course = line

    def _begin_cross(self) -> None:
        north, east = self._centre = self._best[1]
        self._corners = [(north + ARM_M, east), (north - ARM_M, east), (north, east + ARM_M), (north, east - ARM_M)]

    def _fly_cross(self, position: Position) -> Velocity:
        assert self._centre is not None
        if self._corners and math.dist(position[:2], self._corners[0]) < 0.3:
            self._corners.pop(0)
        if self._corners:
            return towards(position, self._corners[0], self._speed)
        if math.dist(self._centre, self._best[1]) < SAME_M:
            self.found = Found(*self._best[1])
            return towards(position, self._best[1], self._speed)
        self._begin_cross()
        return STILL
