"""Checks that the readings agree with the place found: the last check of a search with any strategy.

Dipoles are fitted to the readings, anywhere, under each possible cause of errors: late readings, places that drift, a
dead antenna, loud electronics. The readings agree with a place if a dipole near it explains nearly all of them, and far
better than any dipole elsewhere under any cause.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.search.strategies import dipole
from arva_hil.search.strategies.history import OUTLIERS, ROUGH_M, ROUGHLY, Explanation, History
from arva_hil.search.strategies.strategy import Observation, Position

_STEP_M: Final = 0.4  # keep a reading after this distance
_STEP_S: Final = 1.0  # or after this time
_AGAIN: Final = (0.2, 1.5)  # m, s: an equal reading beyond this distance, within this time, is the last one shown again
_DOWN_M: Final = 0.5  # depth of the initial dipoles below the ground
# Directions of their moments, within half a turn, as m and −m give equal readings; and down.
_TURNS: Final = 3
_RISES: Final = (0.0, 0.7, -0.7)  # rad
_NEAR_M: Final = 2.5  # a dipole within this distance is at the place

_UNEXPLAINED_M: Final = 1.2  # largest error of the receiver's places
_DEEPEST_M: Final = 8.0  # largest depth below the ground
_STRONGEST: Final = 4.0  # largest moment, in reference transmitters; the smallest is its inverse
_BETTER: Final = 6.0  # least advantage of the place: more likely by e^6
_SIGMA_M: Final = 1.2  # largest sigma of the place
_FINE_M: Final = 0.2  # a usual error of the receiver's place
_NEWEST: Final = 0.4  # largest share of outliers among the newest readings
_NEWEST_S: Final = 10.0
_KNOWN_M: Final = 0.1  # least error of the receiver's place in the check
_CAUTION: Final = 2.0  # factor of sigma: readings are less independent than in the fit
_SINCE: Final = 0.3  # share of a drift that may have been added since the fit
_CONTRADICTS: Final = 4.0  # variances: larger deviations contradict a place reported before

Array = NDArray[np.float64]


class Judgement(NamedTuple):
    """The agreement of a transmitter at a place with the readings."""

    unexplained_m: float  # error of the receiver's places
    below_m: float  # depth of the transmitter below the lowest of those places
    depth_m: float | None  # depth below the ground, if that is known
    strength: float  # moment, in reference transmitters
    better: float  # log-likelihood of the place over that of the best place elsewhere
    sigma_m: float  # of the place, under all causes
    outliers: float  # share of the readings that are not explained
    newest: float  # the same of the newest readings
    covariance: tuple[float, float, float]  # of north and east about the place, as in `Found`
    there: Explanation  # the best one near the place

    def agrees(self, height_m: float) -> bool:
        """Return True if the place is plausible for a receiver that was flown at `height_m`."""
        depth_m = self.below_m - height_m if self.depth_m is None else self.depth_m
        buried = depth_m < _DEEPEST_M and 1 / _STRONGEST < self.strength < _STRONGEST
        fits = self.unexplained_m < _UNEXPLAINED_M and self.outliers < OUTLIERS and self.newest < _NEWEST
        return buried and fits and self.better > _BETTER and self.sigma_m < _SIGMA_M


class Evidence(History):
    """Remembers the nearest readings of one transmitter, and their places."""

    def __init__(self) -> None:
        super().__init__()
        self._at = (math.inf, math.inf)
        self._time_s = -math.inf
        self._there: Explanation | None = None  # of the place judged last
        self._shown: tuple[object, ...] = ()  # the newest values, and where and when they were shown first
        self._first: tuple[Position, float] = (0.0, 0.0, 0.0), 0.0

    def add(self, o: Observation) -> bool:
        """Add a reading, unless it is from the same place as the last one.

        Return False if it is no reading: a receiver on its way shows its last one again. What a search flies by may be
        of some place near (`SameReading` in choice.py); a fit needs the place itself.
        """
        if not o.finite:
            return False
        self.pose(o)
        shown = o.d_cm, o.delta_deg, o.inner, o.signal
        if shown != self._shown:
            self._shown, self._first = shown, (o.position, o.time_s)
        at, time_s = self._first
        if o.d_cm > 0 and math.dist(o.position, at) > _AGAIN[0] and o.time_s - time_s < _AGAIN[1]:
            return False
        same = math.dist(self._at, o.position[:2]) < _STEP_M and 0 <= o.time_s - self._time_s < _STEP_S
        if o.heard and not same:
            self._at, self._time_s = o.position[:2], o.time_s
            self.read(o)
        return True

    def judge(self, place: tuple[float, float]) -> Judgement | None:
        """Judge a transmitter at `place` (north, east); None without a reading near it."""
        judgement = judged(place, self.explanations(beginning(place, self))) if self.nearest else None
        self._there = judgement.there if judgement else None
        return judgement

    def contradictions(self, newest: Sequence[Observation]) -> list[bool]:
        """Return, for each of these later readings, True if it contradicts the place judged last; [] without one."""
        there = self._there
        if there is None or not newest:
            return []
        o, drift = dipole.DipoleReadings(there.cause.gains, there.cause.deaf_m), there.best.now - there.best.x[:3]
        for one in newest:
            position, rotation = self.at(one.time_s - one.age_s - there.cause.lag_s)
            for measured in one.measurements:
                o.add((np.array(position) - drift).tolist(), rotation, *measured, one.time_s, one.ground)
        sigma = float(np.linalg.eigvalsh(there.best.now_covariance)[2]) ** 0.5
        error = math.hypot(max(_KNOWN_M, there.pose_error), _CAUTION * sigma, _SINCE * there.cause.drift_m)
        beyond: list[bool] = dipole.unexplained(there.best.x, o, error, _CONTRADICTS).tolist()
        return beyond


def beginning(place: tuple[float, float], history: History) -> Array:
    """Return dipoles (K, 7) to begin with: some at a place, and those that agree with the strongest reading."""
    o = history.nearest
    assert o is not None
    turned = [(math.cos(a), math.sin(a)) for a in np.arange(_TURNS) * math.pi / _TURNS]
    ways = [(x * math.cos(rise), y * math.cos(rise), math.sin(rise)) for rise in _RISES for x, y in turned]
    moments = dipole.MOMENT * np.array([*ways, (0, 0, 1)])
    there = [[*place, (o.ground or 0.0) + _DOWN_M, *moment, 0.0] for moment in moments]
    return np.concatenate([there, dipole.seeds(o.position, o.bearing, o.d_m, o.ground)])


def judged(place: tuple[float, float], explanations: Iterable[Explanation]) -> Judgement | None:
    """Judge a transmitter at a place by the explanations of the readings; None if no explanation is near it."""
    there: Explanation | None = None
    here = elsewhere = math.inf
    nears = []
    for one in explanations:
        near = np.hypot(one.x[:, 0] - place[0], one.x[:, 1] - place[1]) < _NEAR_M
        elsewhere = min(elsewhere, float(np.min(one.costs[~near], initial=math.inf)))
        if near[0]:
            nears.append(one)
            if one.cost < here:
                there, here = one, one.cost
    if there is None:
        return None
    o, x = there.readings, there.best.x
    placed = copy.copy(o)
    placed.at = o.at - there.best.drift
    strength = float(np.linalg.norm(x[3:6])) / dipole.MOMENT
    if there.cause.drift_m:
        strength = math.sqrt(strength)  # if heights drift, the strength is less certain
    likely = [(math.exp(here - one.cost), one.best) for one in nears]
    spread = sum(share * float(np.linalg.eigvalsh(fit.covariance[:2, :2])[1]) for share, fit in likely)
    sigma = math.sqrt(spread / sum(share for share, _ in likely))
    down = float(there.best.now[2])
    below, depth = down - float(o.at[2, 1:].max()), down - float(o.level(there.x)[0]) if o.sloping else None
    rough = dipole.unexplained(x, placed, max(ROUGH_M, there.pose_error), ROUGHLY)
    everything = float(rough[o.time_s[1:] >= min(there.cause.since_s, o.time_s[1:].max())].mean())
    fine = dipole.unexplained(x, placed, max(_FINE_M, there.pose_error), 4.0)
    newest = fine[o.time_s[1:] > o.time_s[1:].max() - _NEWEST_S]
    off = x[:2] - place
    (nn, ne), (_, ee) = (there.best.covariance[:2, :2] + np.outer(off, off)).tolist()
    better, share = elsewhere - here, float(newest.mean())
    return Judgement(there.pose_error, below, depth, strength, better, sigma, everything, share, (nn, ne, ee), there)
