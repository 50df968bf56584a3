"""Checks that the readings agree with the place found: the last check of a search with any strategy.

A dipole at that place is fitted to the readings in depth and direction. The remaining error is expressed as an error of
the receiver's own place: small if the transmitter is there, large if the readings were late, did not change, or were of
something else. Then the dipole is fitted without a fixed place, for comparison.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.search import dipole
from arva_hil.search.drift import WHITE_M, fitted
from arva_hil.search.history import EVIDENT, Explanation, History
from arva_hil.search.strategy import Observation

_STEP_M: Final = 0.4  # flown between two readings that are kept,
_STEP_S: Final = 1.0  # or the time
_DOWNS: Final = (-1.0, 0.5, 2.0, 4.0)  # of the dipole to begin with, below the take-off point, m
_TURNS: Final = 3  # and its moment's directions: level ones within half a turn, and down; m and −m sound alike
_ROUNDS: Final = 12
_DRIFT_ROUNDS: Final = (4, 12)  # the weights of outliers change with each: the best of the two
_NEAR_M: Final = 2.5  # so near to the place is there

_UNEXPLAINED_M: Final = 1.2  # at most
_DEEPEST_M: Final = 8.0  # under the ground
_STRONGEST: Final = 4.0  # times the reference transmitter's moment, or that part of it
_BETTER: Final = 12.0  # elsewhere: more likely by e^12

Array = NDArray[np.float64]


class Judgement(NamedTuple):
    """How well a transmitter at a place explains the readings."""

    unexplained_m: float  # how far off the receiver's own places are
    below_m: float  # how far it lies below the lowest of them
    strength: float  # of the reference transmitter's moment
    better: float  # the logarithm of how much more likely it is somewhere else

    @property
    def odd(self) -> bool:
        """No transmitter is so strong or so weak."""
        return not 1 / _STRONGEST < self.strength < _STRONGEST

    def agrees(self, height_m: float) -> bool:
        """It can be true; the receiver was flown at that height."""
        deep = not self.below_m < height_m + _DEEPEST_M
        return not (deep or self.odd) and self.unexplained_m < _UNEXPLAINED_M and self.better < _BETTER


class Evidence:
    """Remembers the nearest readings of one transmitter, and their places."""

    def __init__(self) -> None:
        self._history = History()
        self._at = (math.inf, math.inf)
        self._time_s = -math.inf
        self._lowest = -math.inf  # down
        self._strongest: Observation | None = None

    def add(self, o: Observation) -> None:
        """Add a reading, unless it is from the same place as the last one."""
        if not (np.isfinite(o.position).all() and np.isfinite(o.rotation).all()):
            return
        self._history.pose(o)
        same = math.dist(self._at, o.position[:2]) < _STEP_M and 0 <= o.time_s - self._time_s < _STEP_S
        if o.heard and not same:
            self._at, self._time_s = o.position[:2], o.time_s
            self._lowest = max(self._lowest, o.position[2])
            if self._strongest is None or o.d_cm < self._strongest.d_cm:
                self._strongest = o
            self._history.read(o)

    def judge(self, place: tuple[float, float]) -> Judgement | None:
        """Judge a transmitter at `place` (north, east); None if nothing was heard.

        It is judged by readings that are as late, or whose places drift as much, as explains them best.
        """
        o = self._strongest
        if o is None:
            return None
        seeds = dipole.seeds(o.position, o.bearing, o.d_m)
        there, _ = _turned(_hypotheses(place), np.full(4 * len(_DOWNS), 0.01), self._history.readings(0.0), 1.0)
        every = np.concatenate([there.x[np.argsort(there.cost, kind="stable")], seeds])
        plain, *odd = self._history.explanations(every)
        best = min([plain, *odd], key=lambda one: one.cost)
        if plain.cost - best.cost < EVIDENT:
            best = plain
        if best.drift_m:
            likely = [one for one in odd if one.drift_m and one.cost - best.cost < _BETTER]
            return min(
                (self._drifting(there.x, best.cost, one) for one in likely), key=lambda one: (one.odd, one.better)
            )
        return self._judged(place, best.readings, np.concatenate([seeds, best.x]))

    def _judged(self, place: tuple[float, float], readings: dipole.Readings, others: Array) -> Judgement:
        x = _hypotheses(place)
        error, damping = 1.0, np.full(len(x), 0.01)
        for _ in range(3):
            there, damping = _turned(x, damping, readings, error)
            best = int(np.argmin(there.cost))
            x = there.x
            error = dipole.likely_pose_error(there, best, readings, dipole.WIDE)
        down, strength = float(x[best, 2]), float(np.linalg.norm(x[best, 3:])) / dipole.MOMENT
        free = np.concatenate([x[[best]], others])
        fit, _ = dipole.refine(free, np.full(len(free), 0.01), readings, error, _ROUNDS)
        near = np.hypot(fit.x[:, 0] - place[0], fit.x[:, 1] - place[1]) < _NEAR_M
        here = min(float(there.cost[best]), float(np.min(fit.cost[near], initial=math.inf)))
        better = here - float(np.min(fit.cost))
        return Judgement(error, down - self._lowest, strength, better)

    def _drifting(self, x: Array, least: float, how: Explanation) -> Judgement:
        """The best of hypotheses at a place, if it drifts so; `least`: the cost without a fixed place."""
        every = [fitted(one, how.readings, WHITE_M, how.drift_m, n, held=True) for one in x for n in _DRIFT_ROUNDS]
        fit = min(every, key=lambda one: one.cost)
        strength = math.sqrt(float(np.linalg.norm(fit.x[3:])) / dipole.MOMENT)  # where heights drift, it is less known
        return Judgement(WHITE_M, float(fit.now[2]) - self._lowest, strength, max(0.0, fit.cost - least))


def _hypotheses(place: tuple[float, float]) -> Array:
    """Dipoles (K, 6) at a place, of the reference strength."""
    level = [(math.cos(a), math.sin(a), 0.0) for a in np.arange(_TURNS) * math.pi / _TURNS]
    moments = dipole.MOMENT * np.array([*level, (0, 0, 1)])
    return np.array([[*place, down, *moment] for down in _DOWNS for moment in moments])


def _turned(x: Array, damping: Array, o: dipole.Readings, error: float) -> tuple[dipole.Fit, Array]:
    """Fit depth and moment only, with steps of Levenberg and Marquardt, until the fit converges."""
    now, settled = dipole.evaluate(x, o, error), 0
    for _ in range(_ROUNDS):
        damped = now.information[:, 2:, 2:] * (1 + damping[:, None, None] * np.eye(4))
        step = np.zeros_like(now.x)
        step[:, 2:] = np.linalg.solve(damped, now.gradient[:, 2:, None])[:, :, 0]
        new = dipole.evaluate(now.x - step, o, error)
        better = new.cost < now.cost
        damping = np.clip(np.where(better, damping / 8, damping * 8), 1e-4, 1e4)
        settled = settled + 1 if (now.cost - new.cost).max() < dipole.SETTLED else 0
        now = dipole.the_better(now, new, better)
        if settled > 1:
            break
    return now, damping
