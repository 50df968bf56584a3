"""The rescuers' cross for the last metres: along one axis to the middle of the lowest d, then across."""

from __future__ import annotations

import math
from itertools import pairwise
from statistics import fmean
from typing import Final

from arva_hil.search.strategies.strategy import Position

_LOW: Final = 1.3  # d is low below this multiple of the least d
_REACH: Final = 0.7  # reach past the low part, in multiples of the least d: no false minimum ends an arm
_SHORTEST_M: Final = 1.5  # shortest reach
_TOGETHER_S: Final = 0.4  # average readings within this time: fifty a second are too many
_AT_M: Final = 0.5  # a goal is reached within this distance
_SETTLED_M: Final = 0.5  # a middle that moved less has settled
_MOST_ARMS: Final = 8

Place = tuple[float, float]  # north, east; m
Reading = tuple[float, float]  # along the arm, m; power of the field, d⁻⁶: 0 without a signal


class Cross:
    """Remembers the present arm, an axis through the middle of the last one, and the readings along it.

    An arm goes from `centre` in both directions until d is no longer low, plus a reach. Its middle is the next
    centre. `settled`: the centre does not move any more. `course`: of the first arm [rad from north].
    """

    def __init__(self, centre: Place, course: float) -> None:
        self.settled = False
        self._course = course
        self._arms = 0
        self._begin(centre)

    def _begin(self, centre: Place) -> None:
        self.centre = centre
        self._on_arm = False
        self._sense = 1
        self._heard: list[Reading] = []
        self._together: list[Reading] = []
        self._time_s = -math.inf  # of the last that are one

    def observe(self, time_s: float, position: Position, d: float) -> None:
        """Use a reading: d in metres, inf without a signal."""
        north, east = position[0] - self.centre[0], position[1] - self.centre[1]
        if not self._on_arm and math.hypot(north, east) > _AT_M:
            return
        self._on_arm = True
        self._together.append((north * math.cos(self._course) + east * math.sin(self._course), d**-6))
        if time_s - self._time_s >= _TOGETHER_S:
            along, power = map(fmean, zip(*self._together, strict=True))
            self._heard.append((along, power))
            self._together, self._time_s = [], time_s
            self._judge()

    def target(self, position: Position) -> Place:
        """Return the next goal: the centre, then the end of the arm."""
        if not self._on_arm:
            return self.centre
        c, s = math.cos(self._course), math.sin(self._course)
        along = (position[0] - self.centre[0]) * c + (position[1] - self.centre[1]) * s + 2 * self._sense
        return self.centre[0] + along * c, self.centre[1] + along * s

    def _judge(self) -> None:
        """Extend the arm, or complete it."""
        most = max(power for _, power in self._heard)
        low = [along for along, power in self._heard if power >= most * _LOW**-6] if most else [0.0]
        reach = max(_SHORTEST_M, _REACH * most ** (-1 / 6)) if most else _SHORTEST_M
        ahead = max(self._heard)[0] >= max(low) + reach
        behind = min(self._heard)[0] <= min(low) - reach
        self._sense = -1 if ahead else 1
        if ahead and behind:
            moved = middle(self._heard) if most else 0.0
            self._arms += most > 0
            self.settled = most > 0 and self._arms >= 2 and (abs(moved) <= _SETTLED_M or self._arms >= _MOST_ARMS)
            north, east = self.centre
            self._begin((north + moved * math.cos(self._course), east + moved * math.sin(self._course)))
            self._course += math.pi / 2


def middle(heard: list[Reading]) -> float:
    """Return the middle of an arm [m along it]: the centroid of the field's power.

    The readings are at several places.
    """
    total = moment = 0.0
    for (a, power_a), (b, power_b) in pairwise(sorted(heard)):
        share = (b - a) * (power_a + power_b)
        total += share
        moment += share * (a + b) / 2
    return moment / total
