"""Follows the flux line as in the paper (eq. 10), from the receiver's integers only; then the rescuers' cross.

The cross is for the last metres: along one axis to the middle of the lowest d, then across.
"""

from __future__ import annotations

import math
from itertools import pairwise
from statistics import fmean
from typing import Final

from arva_hil.search.strategies.strategy import STILL, Found, Observation, Position, Velocity, towards

_K: Final = 0.8  # 1/m; speed · K d / √(1 + (K d)²)
_RISE: Final = 1.08  # d rises above this multiple of its minimum
_FALL: Final = 0.7  # d has fallen below this share of its first value
_MOST_TURNS: Final = 3  # largest number of turns without a fall of d
_SMOOTH_S: Final = 1.0  # time constant
_SILENCE_S: Final = 3.0  # after this time without a signal turn back, then again after twice the time, and so on


class Flux:
    """Remembers the course, and the changes and the minimum of d since it was chosen.

    A flux line has two directions. In the right one d falls, except at the dipole's equator; if d rises, the other one
    is right. If d rises after it has fallen, or does not change, the line has ended: at the transmitter, or at a point
    beside it where the field is vertical.
    """

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._course: float | None = None  # radians from north; None before the first signal
        self._d = 0.0  # smoothed, m
        self._first = 0.0  # d when the course was taken
        self._least = math.inf  # least d since then; inf before the course is taken
        self._place = (0.0, 0.0)  # of the least d
        self._turns = 0
        self._heard_s = -math.inf  # the last signal, or the last turn back
        self._patience_s = _SILENCE_S
        self._cross: Cross | None = None

    @property
    def found(self) -> Found | None:
        """The centre of the cross, once it does not move any more."""
        return Found(*self._cross.centre) if self._cross and self._cross.settled else None

    def observe(self, observation: Observation) -> None:
        """Use the reading of one more frame."""
        o = observation
        if not o.finite:
            return
        self._heard_s = min(self._heard_s, o.time_s)  # the clock may be set back
        if self._cross:
            self._d = o.d_m if o.heard else self._d
            self._cross.observe(o.time_s, o.position, o.d_m if o.heard else math.inf)
        elif o.heard:
            self._course = self._along(o)
            self._measure(o)
            self._decide(o)
        elif self._course is not None and o.time_s - self._heard_s > self._patience_s:
            self._turn_back(o)

    def velocity(self, time_s: float, position: Position) -> Velocity:
        """Return the velocity along the course or the cross; slower near the transmitter."""
        if self._course is None:
            return STILL
        s = _K * self._d
        speed = self._speed * s / math.sqrt(1 + s * s)
        if self._cross:
            return towards(position, self._cross.target(position), speed)
        return speed * math.cos(self._course), speed * math.sin(self._course)

    def _along(self, o: Observation) -> float:
        """Return the course along the flux line, in the direction nearer to the present course."""
        if self._course is None:
            return o.bearing
        if o.inner:
            return self._course
        return o.bearing if math.cos(o.bearing - self._course) >= 0 else o.bearing + math.pi

    def _measure(self, o: Observation) -> None:
        if self._least == math.inf:
            self._take(o.d_m, o)
        self._d += (o.d_m - self._d) * (1 - math.exp((self._heard_s - o.time_s) / _SMOOTH_S))
        self._heard_s, self._patience_s = o.time_s, _SILENCE_S
        if self._d < self._least:
            self._least, self._place = self._d, o.position[:2]

    def _decide(self, o: Observation) -> None:
        """Continue, turn round, or begin the cross."""
        assert self._course is not None
        if o.inner:
            self._cross = Cross(o.position[:2], self._course)
        elif self._d > _RISE * self._least:
            if self._least < _FALL * self._first or self._turns >= _MOST_TURNS:
                self._cross = Cross(self._place, self._course)
            else:
                self._turns += 1
                self._course += math.pi
                self._take(self._d, o)

    def _turn_back(self, o: Observation) -> None:
        """Turn back to the minimum of d and beyond it, and choose the course again there."""
        self._turns += self._least < math.inf
        self._least = math.inf
        self._course = math.atan2(self._place[1] - o.position[1], self._place[0] - o.position[0])
        self._heard_s = o.time_s
        self._patience_s *= 2

    def _take(self, d: float, o: Observation) -> None:
        """Choose the course again, at this d [m]."""
        self._d = self._first = self._least = d
        self._place = o.position[:2]


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
        if not 0 <= time_s - self._time_s < _TOGETHER_S:  # also if the clock was set back
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
