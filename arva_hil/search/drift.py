"""Where a transmitter is if the places reported drift slowly, as those of a GPS do.

The drift on each axis is a slow random process, low-pass filtered as an estimator does it: the errors of readings near
in time are alike, those of a minute average out.
"""

from __future__ import annotations

import copy
import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.search import dipole

DRIFTS_M: Final = (0.3, 1.0, 3.0)  # sigmas on each axis thought possible
WHITE_M: Final = 0.1  # sigma of what else is wrong with a place

_SLOW_S: Final = (30.0, 5.0)  # forgotten in, filtered with
_STEP: Final = 1e-5
_FARTHEST_M: Final = 2.0  # of a step

Array = NDArray[np.float64]


class DriftFit(NamedTuple):
    """A hypothesis under a drift. `now`: where it is in the places reported now, north, east, down."""

    x: Array  # (6,)
    covariance: Array  # (6, 6)
    now: Array  # (3,)
    now_covariance: Array  # (3, 3)
    cost: float  # −ln of the likelihood


def fitted(x: Array, o: dipole.Readings, pose_error: float, drift_m: float, rounds: int) -> DriftFit:
    """The hypothesis (6,) near x that fits the readings best; sigmas of each place and of the drift [m].

    The cost of a fit with `drift_m` 0 can be compared with others.
    """
    alike = drift_m**2 * _alike(o.time_s[:, None] - o.time_s)
    newest = drift_m**2 * _alike(o.time_s - o.time_s[1:].max(initial=0.0))
    alike[0], alike[:, 0], newest[0] = 0.0, 0.0, 0.0  # number 0 is no reading
    spread = np.repeat(np.repeat(alike, 2, 0), 2, 1)
    aside = _STEP * np.concatenate([np.zeros((1, 6)), np.eye(6), -np.eye(6)])
    there, drift = copy.copy(o), np.zeros((3, len(o.time_s)))
    for n in range(rounds + 1):
        there.at = o.at - drift
        fit = dipole.evaluate(x + aside, there, pose_error)
        slopes = fit.error[1:7] - fit.error[7:]
        slopes[:, 3::2] -= math.pi * np.rint(slopes[:, 3::2] / math.pi)
        used = (fit.weight[0] > 0).astype(float)
        j = slopes / (2 * _STEP) * used
        exact = pose_error**2 * fit.slope[0] + fit.variance[0]
        tail = 1 + fit.error[0] ** 2 / (dipole.TAIL * exact)
        tail[:2] = 1.0
        by_drift = j[:3] * np.repeat(drift, 2, 1)
        e = fit.error[0] * used - by_drift.sum(axis=0)
        each = np.diag(exact * tail) + (j[:3].T @ j[:3]) * spread
        solved = np.linalg.solve(each, np.column_stack([j.T, e]))
        information = j @ solved[:, :6] + dipole.RIDGE
        step = -np.linalg.solve(information, j @ solved[:, 6])
        left = -(solved[:, 6] + solved[:, :6] @ step)
        if n < rounds:
            share = min(1.0, _FARTHEST_M / max(float(np.abs(step[:3]).max()), 1e-9))
            x = x + share * step
            aim = (j[:3] * left).reshape(3, -1, 2).sum(axis=2) @ alike
            drift = drift + share * (aim - drift)
    covariance: Array = np.linalg.inv(information)
    now_drift = (j[:3] * left).reshape(3, -1, 2).sum(axis=2) @ newest
    known = j[:3] * np.repeat(newest, 2)  # covariance of the drift now with each error
    turn = np.eye(3, 6) - known @ solved[:, :6]
    rest = drift_m**2 * np.eye(3) - known @ np.linalg.solve(each, known.T)
    now_covariance: Array = turn @ covariance @ turn.T + rest
    cost = 0.5 * float(e @ solved[:, 6] + np.log(exact * tail) @ (1 - used) * -1 + np.linalg.slogdet(each)[1])
    return DriftFit(x, covariance, x[:3] + now_drift, now_covariance, cost)


def _alike(after_s: Array) -> Array:
    """The correlation of drifts that are so far apart in time."""
    slow, quick = _SLOW_S
    t = np.abs(after_s)
    return (slow * np.exp(-t / slow) - quick * np.exp(-t / quick)) / (slow - quick)
