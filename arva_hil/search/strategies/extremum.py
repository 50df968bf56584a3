"""Extremum seeking, without a model of the field: it circles, and drifts towards the stronger signal.

After M. Krstić, and Azzollini, Mimmo, Marconi: An extremum seeking approach to search and rescue operations in
avalanches using ARVA (2020).
"""

from __future__ import annotations

import math
from collections import deque
from statistics import fmean
from typing import Final

import numpy as np

from arva_hil.search.strategies.strategy import STILL, Belief, Found, Observation, Position, Velocity, towards

_DITHER: Final = 0.8  # share of the speed on the circle
_DRIFT: Final = 0.8  # largest share of the speed of its centre; the sum is limited to the speed
_TURN: Final = 0.4  # largest turn rate, rad/s: 16 readings a round at 1 Hz
_RADIUS: Final = 0.6  # share of d: about the distance of false minima of d from the true one
_RADII_M: Final = (0.8, 3.0)
_TRACK: Final = 0.5  # 1/s, gain of the return to the circle
_SETTLED: Final = 0.3  # share of the radius within which the centre is at the minimum
_SILENCE_S: Final = 5.0  # after this time without a signal, fly back to the strongest reading
_ORBIT: Final = 2 * math.pi
_STEP: Final = _ORBIT / 24  # between two readings that are kept
_ENOUGH: Final = 0.75 * _ORBIT  # readings needed for a minimum
_PATIENCE: Final = 3 * _ORBIT  # a centre that swings about a place for this long has settled too


class Extremum:
    """Remembers the circle, its drift, and the readings of the last round: (phase, north, east, 1/d).

    It uses 1/d because it is bounded, and 0 without a signal.
    """

    def __init__(self, speed: float) -> None:
        self.found: Found | None = None
        self._speed = speed
        self._centre: tuple[float, float] | None = None  # None before the first signal
        self._drift = STILL
        self._radius = _RADII_M[1]
        self._phase = 0.0  # radians from north; never wraps
        self._time_s = 0.0  # the time of centre and phase
        self._round: deque[tuple[float, float, float, float]] = deque()
        self._calm = 0.0  # radians flown with the centre at the minimum
        self._centres: deque[tuple[float, float, float]] = deque()  # phase, north, east, over the last rounds
        self._heard_s = 0.0
        self._best = (math.inf, (0.0, 0.0))  # d [m] and its place

    def observe(self, observation: Observation) -> None:
        """Use the reading of one more frame."""
        o = observation
        if not o.finite:
            return
        north, east, _ = o.position
        if self._centre is None:
            if not o.heard:
                return
            self._centre, self._time_s = (north, east), o.time_s
        north_c, east_c, self._phase = self._circle(o.time_s)
        self._centre, self._time_s = (north_c, east_c), o.time_s
        self._heard_s = min(self._heard_s, o.time_s)  # the clock may be set back
        if o.heard:
            self._heard_s = o.time_s
            self._best = min(self._best, (o.d_m, (north, east)))
        elif o.time_s - self._heard_s > _SILENCE_S:
            self._centre, self._drift, self._calm = self._best[1], STILL, 0.0
            self._round.clear()
            self._centres.clear()
            return
        turned = self._phase - self._round[-1][0] if self._round else _STEP
        if turned >= _STEP:
            self._round.append((self._phase, north, east, 1 / o.d_m if o.heard else 0.0))
            while self._round[0][0] < self._phase - _ORBIT:
                self._round.popleft()
            if self._phase - self._round[0][0] > _ENOUGH:
                self._steer(turned)

    @property
    def belief(self) -> Belief:
        """The centre of the circle."""
        return Belief(goal=self._centre)

    def velocity(self, time_s: float, position: Position) -> Velocity:
        """Return the velocity around the drifting centre, or to the place found."""
        if self._centre is None:
            return STILL
        if self.found:
            return towards(position, self.found[:2], self._speed)
        north, east, phase = self._circle(time_s)
        c, s = math.cos(phase), math.sin(phase)
        ahead = self._turn_rate * self._radius
        v_n = self._drift[0] - ahead * s + _TRACK * (north + self._radius * c - position[0])
        v_e = self._drift[1] + ahead * c + _TRACK * (east + self._radius * s - position[1])
        share = self._speed / max(self._speed, math.hypot(v_n, v_e))
        return v_n * share, v_e * share

    @property
    def _turn_rate(self) -> float:
        """The turn rate on the circle [rad/s], limited so that readings and vehicle can follow."""
        return min(_DITHER * self._speed / self._radius, _TURN)

    def _circle(self, time_s: float) -> tuple[float, float, float]:
        """Return the centre of the circle [m north, east] at a time, and the phase [rad]."""
        assert self._centre is not None
        dt = min(max(time_s - self._time_s, 0.0), _SILENCE_S)
        north, east = self._centre
        return north + self._drift[0] * dt, east + self._drift[1] * dt, self._phase + self._turn_rate * dt

    def _steer(self, turned: float) -> None:
        """Set radius and drift from the last round. The place is found if the centre stays for another round."""
        assert self._centre is not None
        north, east, d = minimum(self._round)
        wanted = min(max(_RADIUS * d, _RADII_M[0]), _RADII_M[1])
        self._radius += (wanted - self._radius) * min(1.0, turned / _ORBIT)
        off_n, off_e = north - self._centre[0], east - self._centre[1]
        off = math.hypot(off_n, off_e)
        rate = min(self._turn_rate / _ORBIT, _DRIFT * self._speed / max(off, 1e-9))
        self._drift = off_n * rate, off_e * rate
        self._calm = self._calm + turned if off < _SETTLED * self._radius else 0.0
        if self._calm > _ORBIT:
            self.found = Found(north, east)
        elif (middle := self._swings()) is not None:
            self.found = Found(*middle)

    def _swings(self) -> tuple[float, float] | None:
        """Return the place around which the centre has swung for several rounds; None if it moves away."""
        assert self._centre is not None
        self._centres.append((self._phase, *self._centre))
        while self._centres[0][0] < self._phase - _PATIENCE:
            self._centres.popleft()
        if self._phase - self._centres[0][0] < _PATIENCE - 2 * _STEP:
            return None
        north, east = (fmean(column) for column in list(zip(*self._centres, strict=True))[1:])
        swing = max(math.hypot(n - north, e - east) for _, n, e in self._centres)
        return (north, east) if swing < _SETTLED * self._radius else None


def minimum(heard: deque[tuple[float, float, float, float]]) -> tuple[float, float, float]:
    """Return (north, east) of the least d, and d amid the readings [m], by the plane through (phase, north, east, 1/d).

    If d² grows by the square of the distance from the minimum, the minimum is d³ ∇(1/d) away.
    """
    _, north, east, near = np.array(heard).T
    middle = np.array([north.mean(), east.mean()])
    offsets = np.column_stack([north - middle[0], east - middle[1]])
    slope = np.linalg.lstsq(offsets, near - near.mean(), rcond=None)[0]
    d = 1 / max(float(near.mean()), 0.02)
    place = middle + d**3 * slope
    return float(place[0]), float(place[1]), d
