"""Where a transmitter is if the places reported drift slowly, as those of a GPS do.

The drift on each axis is a slow random process, low-pass filtered as an estimator does it: the errors of readings near
in time are alike, those of a minute average out.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from itertools import zip_longest
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.search import dipole

DRIFTS_M: Final = (1.0, 0.3, 3.0)  # sigmas on each axis thought possible; the usual one first
WHITE_M: Final = 0.1  # sigma of what else is wrong with a place

_SLOW_S: Final = (30.0, 5.0)  # forgotten in, filtered with
_FARTHEST_M: Final = 2.0  # of a step
_SETTLED_M: Final = 0.01  # a step that moves it and the drift less is the last
_ROUNDS: Final = 4
_FEW, _APART_M = 4, 0.2  # hypotheses

Array = NDArray[np.float64]


class DriftFit(NamedTuple):
    """A hypothesis under a drift. `now`: where it is in the places reported now, north, east, down."""

    x: Array  # (6,)
    covariance: Array  # (6, 6)
    now: Array  # (3,)
    now_covariance: Array  # (3, 3)
    cost: float  # −ln of the likelihood
    drift: Array  # (3, N) of the readings,
    time_s: Array  # (N,) at these times


def fitted(
    x: Array, o: dipole.Readings, pose_error: float, drift_m: float, rounds: int, near: DriftFit | None = None
) -> DriftFit:
    """The hypothesis (6,) near x that fits the readings best; sigmas of each place and of the drift [m].

    `near`: a fit whose drift it begins with. The cost of a fit with `drift_m` 0 can be compared with others.
    """
    alike = drift_m**2 * _alike(o.time_s[:, None] - o.time_s)
    newest = drift_m**2 * _alike(o.time_s - o.time_s[1:].max(initial=0.0))
    alike[0], alike[:, 0], newest[0] = 0.0, 0.0, 0.0  # number 0 is no reading
    there, drift = copy.copy(o), np.zeros((3, len(o.time_s))) if near is None else _then(near, o.time_s)
    while True:
        there.at = o.at - drift
        fit = dipole.evaluate(x[None], there, pose_error)
        used = np.flatnonzero(fit.weight[0])
        of, j = used // 2, fit.slopes[0][:, used]
        exact = (pose_error**2 * fit.slope + fit.variance)[0, used]
        tail = np.where(of, 1 + fit.error[0, used] ** 2 / (dipole.TAIL * exact), 1.0)
        e = fit.error[0, used] - np.add.reduce(j[:3] * drift[:, of])
        each = (j[:3].T @ j[:3]) * alike[of[:, None], of]
        each.flat[:: len(of) + 1] += exact * tail
        solved = np.linalg.solve(each, np.column_stack([j.T, e]))
        information = j @ solved[:, :6] + dipole.RIDGE
        step = -np.linalg.solve(information, j @ solved[:, 6])
        left = -(solved[:, 6] + solved[:, :6] @ step)
        if rounds <= 0:
            break
        far = float(np.abs(step[:3]).max())
        share = min(1.0, _FARTHEST_M / max(far, 1e-9))
        x = x + share * step
        moved = (j[:3] * left) @ alike[of] - drift
        drift = drift + share * moved
        rounds = 0 if max(far, float(np.abs(moved).max())) < _SETTLED_M else rounds - 1
    covariance: Array = np.linalg.inv(information)
    known = j[:3] * newest[of]  # covariance of the drift now with each error
    turn = np.eye(3, 6) - known @ solved[:, :6]
    rest = drift_m**2 * np.eye(3) - known @ np.linalg.solve(each, known.T)
    now_covariance: Array = turn @ covariance @ turn.T + rest
    cost = 0.5 * float(e @ solved[:, 6] + np.linalg.slogdet(each)[1])
    return DriftFit(x, covariance, x[:3] + known @ left, now_covariance, cost, drift, o.time_s)


def fitted_again(x: Array, before: Sequence[DriftFit], o: dipole.Readings, drift_m: float) -> list[DriftFit]:
    """Hypotheses (K, 6) fitted to more readings, best first; the first of them are of the fits `before`, and begin with
    their drifts. Unlikely and equal ones are dropped.
    """
    pairs = zip_longest(x[:_FEW], before[:_FEW])
    every = sorted((fitted(one, o, WHITE_M, drift_m, _ROUNDS, near) for one, near in pairs), key=lambda fit: fit.cost)
    kept: list[DriftFit] = []
    for one in every:
        if one.cost - every[0].cost < dipole.FORGET and all(
            math.dist(one.x[:3], other.x[:3]) > _APART_M for other in kept
        ):
            kept.append(one)
    return kept


def _then(fit: DriftFit, time_s: Array) -> Array:
    """The drift of a fit at times (N,); of new readings, as it was last."""
    order = 1 + np.argsort(fit.time_s[1:])
    return np.array([np.interp(time_s, fit.time_s[order], axis[order]) for axis in fit.drift])


def _alike(after_s: Array) -> Array:
    """The correlation of drifts that are so far apart in time."""
    slow, quick = _SLOW_S
    t = np.abs(after_s)
    return (slow * np.exp(-t / slow) - quick * np.exp(-t / quick)) / (slow - quick)
