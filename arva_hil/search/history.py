"""What was read of one transmitter and where the receiver was, so that readings can be put where they were made.

A receiver, its cable or its host may be late. How late, the way flown tells: several lags are tried.
"""

from __future__ import annotations

import bisect
import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.search import dipole
from arva_hil.search.drift import DRIFTS_M, WHITE_M, fitted
from arva_hil.search.strategy import Observation, Position

_LAGS_S: Final = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0)
_EXPLANATIONS: Final = (*((lag_s, 0.0) for lag_s in _LAGS_S), *((0.0, drift_m) for drift_m in DRIFTS_M))  # tried
_NEXT_S: Final = 0.1  # between two poses that are kept
_MOST: Final = (4096, 192)  # poses, readings
_ROUNDS: Final = 6
_FEW: Final = 3  # hypotheses
EVIDENT: Final = 16.0  # more likely by e^16
_ODD: Final = 4.0  # cost of a lag or a drift
_FITS_M: Final = 0.08  # an error of the receiver's places that leaves nothing to explain by a lag or a drift

Array = NDArray[np.float64]


class Explanation(NamedTuple):
    """How late readings are and how their places drift, and what fits them then. `cost`: −ln of how likely it is."""

    lag_s: float
    drift_m: float
    readings: dipole.Readings
    x: Array  # (K, 6)
    pose_error: float
    cost: float


class History:
    """Remembers poses and readings, both in order of time."""

    def __init__(self) -> None:
        self._poses: list[Observation] = []
        self._read: list[Observation] = []

    def pose(self, o: Observation) -> None:
        """The receiver was there, whatever it heard."""
        if self._poses and o.time_s < self._poses[-1].time_s:
            self._poses.clear()  # the clock was set back
        if self._poses and not o.time_s - self._poses[-1].time_s >= _NEXT_S:
            return
        self._poses.append(o)
        if len(self._poses) > _MOST[0]:
            del self._poses[: _MOST[0] // 4]

    def read(self, o: Observation) -> None:
        """A reading to be used."""
        self._read.append(o)
        if len(self._read) > _MOST[1]:
            del self._read[: _MOST[1] // 4]

    def readings(self, lag_s: float) -> dipole.Readings:
        """All readings, where the receiver was `lag_s` before each."""
        there = dipole.Readings()
        for o in self._read:
            position, rotation = self.at(o.time_s - lag_s)
            there.add(position, rotation, o.d_m, math.radians(o.delta_deg), o.inner, o.time_s)
        return there

    def explained(self, x: Array, lag_s: float, drift_m: float) -> Explanation:
        """What explains the readings best, for hypotheses (K, 6) that were fitted with this lag and drift.

        Without evidence, what was believed is left as it is.
        """
        every = self.explanations(x, lag_s, drift_m)
        best = min(every, key=lambda one: one.cost)
        return best if every[0].cost - best.cost > EVIDENT else every[0]

    def explanations(self, x: Array, lag_s: float = 0.0, drift_m: float = 0.0) -> list[Explanation]:
        """All that are tried, this lag and drift first. Where readings in time and in place fit, no other is."""
        first = self._fitted(x, lag_s, drift_m)
        if not (lag_s or drift_m) and first.pose_error < _FITS_M:
            return [first]
        return [first, *(self._fitted(x, *how) for how in _EXPLANATIONS if how != (lag_s, drift_m))]

    def _fitted(self, x: Array, lag_s: float, drift_m: float) -> Explanation:
        there, error = self.readings(lag_s), max(0.3, drift_m)
        nearest = min(self._read, key=lambda o: o.d_cm if o.heard else math.inf)
        position, _ = self.at(nearest.time_s - lag_s)
        if drift_m:
            x = np.concatenate([x, dipole.seeds(position, nearest.bearing, nearest.d_m)])
        damping, given = np.full(len(x), 0.01), x[:_FEW]
        for _ in range(2):
            fit, damping = dipole.refine(x, damping, there, error, _ROUNDS)
            best = np.argsort(fit.cost, kind="stable")[:_FEW]
            x, damping = fit.x[best], damping[best]
            if not drift_m:
                error = dipole.likely_pose_error(fit, int(best[0]), there, dipole.WIDE)
        cost = _ODD if lag_s or drift_m else 0.0
        if drift_m:
            begin = np.concatenate([given, x])
            every = sorted((fitted(one, there, WHITE_M, drift_m, _ROUNDS) for one in begin), key=lambda one: one.cost)
            cost += every[0].cost
            x, error = np.array([one.x for one in every[:_FEW]]), WHITE_M
        else:
            cost += fitted(x[0], there, error, 0.0, 0).cost
            cost += 0.5 * (math.log(error / dipole.USUAL[0]) / dipole.USUAL[1]) ** 2
        return Explanation(lag_s, drift_m, there, x, error, cost)

    def at(self, time_s: float) -> tuple[Position, Array]:
        """The pose then: position and rotation; before all the first one, after all the last one."""
        i = bisect.bisect_right(self._poses, time_s, key=lambda o: o.time_s)
        if i == 0 or i == len(self._poses):
            o = self._poses[max(i - 1, 0)]
            return o.position, o.rotation
        a, b = self._poses[i - 1 : i + 1]
        share = (time_s - a.time_s) / (b.time_s - a.time_s)
        north, east, down = (p + (q - p) * share for p, q in zip(a.position, b.position, strict=True))
        return (north, east, down), b.rotation
