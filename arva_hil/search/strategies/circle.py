"""A circle about the place of a transmitter, for readings from all sides before it is reported."""

from __future__ import annotations

import math
from typing import Final

from arva_hil.search.strategies.strategy import Position, Velocity, towards

RADIUS_M: Final = 1.5
_TURN: Final = 0.8  # rad/s, at most
_AHEAD: Final = 0.7  # rad: lead of the goal over the vehicle
_ENOUGH: Final = 5.6  # rad to fly, so that readings come from all sides
_READINGS: Final = 6  # least number of readings on the circle


class Circle:
    """Remembers the angle flown and the number of readings. `centre`: north, east [m]."""

    def __init__(self, centre: tuple[float, float], position: Position) -> None:
        self.centre = centre
        self._turned = 0.0  # rad, clockwise from above
        self._readings = 0
        self._at = self._angle(position)

    @property
    def done(self) -> bool:
        """True if readings came from all sides."""
        return self._turned >= _ENOUGH and self._readings >= _READINGS

    def observe(self, centre: tuple[float, float]) -> None:
        """Add a reading, and update the centre."""
        self.centre = centre
        self._readings += 1

    def velocity(self, position: Position, speed: float) -> Velocity:
        """Return the velocity to the circle, then along it."""
        at = self._angle(position)
        if math.dist(position[:2], self.centre) > RADIUS_M / 2:
            self._turned += (at - self._at + math.pi) % (2 * math.pi) - math.pi
        self._at = at
        goal = at + _AHEAD
        place = self.centre[0] + RADIUS_M * math.cos(goal), self.centre[1] + RADIUS_M * math.sin(goal)
        return towards(position, place, min(speed, _TURN * RADIUS_M), gain=math.inf)

    def _angle(self, position: Position) -> float:
        return math.atan2(position[1] - self.centre[1], position[0] - self.centre[0])
