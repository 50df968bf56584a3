"""The place of a transmitter if the reported places drift slowly, like those of a GPS.

While the search flies, the drift on each axis is a slow random process, low-pass filtered as by an estimator. Errors of
readings close in time are alike; errors over a minute average out. The place reported at the end is that without
a drift, with an exact receiver, or that under drifts of all speeds, from seconds to 20 minutes, with an exact receiver
and with one that is late, has unequal antennas and another law of d. Either may lean by a few degrees. A constant
offset does not change the place relative to the vehicle.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.search.strategies import dipole
from arva_hil.search.strategies.strategy import Covariance

DRIFTS_M: Final = (1.0, 0.3, 3.0)  # possible sigmas on each axis; the usual one first
WHITE_M: Final = 0.1  # sigma of the other errors of a place
_EXACT_M: Final = 0.0007  # the same for exact ones
_ROUNDED_M: Final = 0.0025  # of the position now, rounded to 1e-7°: 80 % of its errors are within twice this

_SLOW_S: Final = (30.0, 5.0)  # correlation time, time constant of the filter
_AT_ONCE_S: Final = 1e-6  # time constant of a filter that does nothing
_FARTHEST_M: Final = 2.0  # longest step
_SETTLED_M: Final = 0.01  # stop if a step moves the hypothesis and the drift by less,
_SETTLED: Final = 0.1  # and the lean by less than this share of its sigma
_NEAR_M: Final = 0.1  # the lean is followed after shorter steps
_ROUNDS: Final = 4
_FEW, _APART_M, _BESIDE_M = 4, 0.2, 1.5  # hypotheses; distances of different ones, and of new ones
_LEAST: Final = 0.1  # least size of all errors of a fit, as a share of those assumed
_DISCOUNT: Final = 2.5  # divides the evidence of the readings: their errors are less independent than in the fit
_LIKELY: Final = 0.003  # least share of a fit that is fitted again
# Errors of a real receiver, one sigma: the delay of all readings together, and of each [s]; the gain of each antenna;
# the power of d.
_LATE_S: Final = 0.3
_UNEQUAL: Final = 0.1
_LAW: Final = 0.05
_LAW_M: Final = 3.0  # the law is right here
_MOUNT: Final = 0.03  # sigma of its roll and pitch against those of the vehicle, rad
_LEAN: Final = slice(4, 7)  # roll, pitch and the compass among the causes of its errors

Array = NDArray[np.float64]


class ErrorSizes(NamedTuple):
    """The sizes of the errors of readings."""

    drift_m: float = 0.0
    """Sigma of the drift on each axis."""
    white_m: float = WHITE_M
    """Sigma of the other errors of a place."""
    times_s: tuple[float, float] = _SLOW_S
    """Correlation time of the drift, and time constant of its filter."""
    receiver: float = 0.0
    """Sizes of the receiver's own errors, in usual ones: 0 for one without."""
    chance: float = 1.0
    """Size of its errors by chance, as in `dipole.evaluate`: near 0 for an exact receiver."""
    mount: float = 0.0
    """Sigma of its roll and pitch against those of the vehicle [rad]."""


# An exact receiver has errors by chance as small as those of its place.
ANY: Final = (
    ErrorSizes(0.0, _EXACT_M, chance=_EXACT_M / WHITE_M, mount=_MOUNT),
    *(
        ErrorSizes(drift_m, white_m, times_s, receiver, max(receiver, white_m / WHITE_M), _MOUNT)
        for drift_m, times_s, white_m in (
            (0.6, (600.0, _AT_ONCE_S), 0.01),
            (1.0, (600.0, _AT_ONCE_S), 0.03),
            (2.0, (600.0, _AT_ONCE_S), 0.03),
            (1.0, _SLOW_S, 0.1),
            (1.0, (10.0, _AT_ONCE_S), 0.1),
        )
        for receiver in (0.0, 1.0)
    ),
)


class DriftFit(NamedTuple):
    """A hypothesis under a drift. `now`: its place in the frame reported now, north, east, down."""

    x: Array  # (7,)
    covariance: Array  # (7, 7)
    now: Array  # (3,)
    now_covariance: Array  # (3, 3)
    cost: float  # −ln of the likelihood
    misfit: float  # the sum of the squared errors by their variances
    parts: int  # the number of these errors
    drift: Array  # (3, N) of the readings,
    time_s: Array  # (N,) at these times


class _Linear(NamedTuple):
    """The readings, linearised in one hypothesis, in the drift and in the lean, and the solution; M real parts."""

    of: NDArray[np.intp]  # (M,) the reading of each
    slopes: Array  # (7, M) of the error over the hypothesis
    error: Array  # (M,) without the parts explained by the drift and by the lean
    each: Array  # (M, M) covariance of the errors
    solved: Array  # (M, 8) by it: slopes and error
    information: NDArray[Any]  # (7, 7)
    step: Array  # (7,) to the best hypothesis
    left: Array  # (M,) solved by `each`: the error there
    lean: Array  # (3,) there


def _linear(
    fit: dipole.Fit, k: int, drift: Array, lean: Array, white_m: float, alike: Array, late_m: Array, receiver: Array
) -> _Linear:
    """Return hypothesis k of a fit, linear.

    `lean`: roll, pitch, and the compass's part of the yaw (3,), in sigmas. `alike`: covariance (2N, 2N) of the drifts
    at the readings of two parts. `late_m`: the way (3, N) flown in a delay. `receiver`: its errors (C, 2N) by some
    causes.
    """
    used = np.flatnonzero(fit.weight[k])
    of, j, receiver = used // 2, fit.slopes[k][:, used], receiver[:, used]
    exact = white_m**2 * fit.slope[k, used] + fit.variance[k, used]
    tail = np.where(of, 1 + fit.error[k, used] ** 2 / (dipole.TAIL * exact), 1.0)
    e = fit.error[k, used] - np.add.reduce(j[:3] * drift[:, of]) - lean @ receiver[_LEAN]
    each = (j[:3].T @ j[:3]) * (alike if len(of) == len(alike) else alike[used[:, None], used])
    late = np.add.reduce(j[:3] * late_m[:, of])
    together = np.vstack([late, receiver])
    each += together.T @ together
    each.ravel()[:: len(of) + 1] += exact * tail + late**2
    solved = np.linalg.solve(each, np.column_stack([j.T, e]))
    information, gradient = j @ solved[:, :7] + dipole.RIDGE, j @ solved[:, 7]
    gradient[6] += dipole.RIDGE[6, 6] * fit.x[k, 6]
    step: Array = -np.linalg.solve(information, gradient)
    left = -(solved[:, 7] + solved[:, :7] @ step)
    return _Linear(of, j, e, each, solved, information, step, left, receiver[_LEAN] @ left)


def fitted(
    x: Array,
    o: dipole.DipoleReadings,
    errors: ErrorSizes,
    rounds: int,
    near: Sequence[DriftFit] = (),
    ahead_s: float = 0.0,
    velocity: Array | None = None,
) -> list[DriftFit]:
    """Return for each hypothesis (K, 7) the one near it that fits the readings best.

    The costs of fits without a drift can be compared with others. `near`: fits; the first hypotheses start with their
    drifts. `ahead_s`: the time from the newest reading until now. `velocity`: of the receiver, (3, N) [m/s].
    """
    variance, n = errors.drift_m**2, len(o.time_s)
    alike = variance * _alike(o.time_s[:, None] - o.time_s, errors.times_s)
    newest = variance * _alike(o.time_s - o.time_s[1:].max(initial=0.0) - ahead_s, errors.times_s)
    alike[0], alike[:, 0], newest[0] = 0.0, 0.0, 0.0  # number 0 is the prior
    late_m = np.zeros((3, n)) if velocity is None else errors.receiver * _LATE_S * velocity
    law = errors.receiver * _of_law(o)
    sizes = np.array([*[errors.receiver * _UNEQUAL] * 3, errors.mount, errors.mount, 1.0])[:, None]
    both = alike.repeat(2, axis=0).repeat(2, axis=1)  # of the two parts of each
    there, x, drift, lean = copy.copy(o), x.copy(), np.zeros((len(x), 3, n)), np.zeros((len(x), 3))
    for k, before in enumerate(near):
        drift[k] = _then(before, o.time_s)
    going, fits = dict.fromkeys(range(len(x)), rounds), dict[int, DriftFit]()  # rounds left; the settled fits
    while going:
        numbers = list(going)
        leans, compass = errors.mount * lean[numbers, :2], x[numbers, 6] * lean[numbers, 2]
        there.at, there.axis = o.at - drift[numbers], dipole.leaning(o.axis, leans, compass)
        fit = dipole.evaluate(x[numbers], there, errors.white_m, errors.chance)
        of_receiver = dipole.of_receiver(x[numbers], there) * sizes
        for row, k in enumerate(numbers):
            causes = np.concatenate([law, of_receiver[row]])
            one = _linear(fit, row, drift[k], lean[k], errors.white_m, both, late_m, causes)
            if going[k] <= 0:
                fits[k] = _settled(x[k].copy(), drift[k].copy(), one, newest, variance, o.time_s)
                del going[k]
                continue
            far = float(np.abs(one.step[:3]).max())
            share = min(1.0, _FARTHEST_M / max(far, 1e-9))
            x[k] += share * one.step
            moved = (one.slopes[:3] * one.left) @ alike[one.of] - drift[k]
            drift[k] += share * moved
            leant, far = one.lean - lean[k], max(far, float(np.abs(moved).max()))
            if far < _NEAR_M:
                lean[k] += leant
            going[k] = 0 if far < _SETTLED_M and np.abs(leant).max() < _SETTLED else going[k] - 1
    return [fits[k] for k in range(len(x))]


def _of_law(o: dipole.DipoleReadings) -> Array:
    """Return the errors (1, 2N) of readings by another law of d, one sigma."""
    errors = np.array([-_LAW * (o.said.real + 3 * math.log(_LAW_M)) + 0j])
    errors[:, 0] = 0  # number 0 is the prior
    return errors.view(float)


def _settled(x: Array, drift: Array, one: _Linear, newest: Array, variance: float, time_s: Array) -> DriftFit:
    """Return the fit of a hypothesis; `newest`: covariance (N,) of the drift now with that of each reading."""
    covariance = np.linalg.inv(one.information)
    known = one.slopes[:3] * newest[one.of]  # covariance of the drift now with each error
    turn = np.eye(3, 7) - known @ one.solved[:, :7]
    rest = variance * np.eye(3) - known @ np.linalg.solve(one.each, known.T)
    now_covariance = turn @ covariance @ turn.T + rest
    known_yaw = dipole.RIDGE[6, 6] * x[6] ** 2
    misfit = float(one.error @ one.solved[:, 7])
    cost = 0.5 * float(misfit + np.linalg.slogdet(one.each)[1] + known_yaw)
    now = x[:3] + known @ one.left
    return DriftFit(x, covariance, now, now_covariance, cost, misfit, len(one.error), drift, time_s)


def fitted_again(x: Array, before: Sequence[DriftFit], o: dipole.DipoleReadings, drift_m: float) -> list[DriftFit]:
    """Return hypotheses (K, 7) fitted to more readings, best first; without the unlikely and equal ones.

    The first of them are those of the fits `before`, and begin with their drifts; the best one begins also without.
    """
    followed = min(len(before), _FEW - 1)
    begin = np.concatenate([x[:followed], x[:1]])
    every = _apart(fitted(begin, o, ErrorSizes(drift_m), _ROUNDS, before[:followed]))
    return [one for one in every if one.cost - every[0].cost < dipole.FORGET]


def fitted_beside(x: Array, o: dipole.DipoleReadings, drift_m: float) -> list[DriftFit]:
    """Return fits that begin at a hypothesis (7,) and on all sides of it, without a drift."""
    beside = x[None].repeat(5, axis=0)
    beside[1:, :2] += _BESIDE_M * np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
    return fitted(beside, o, ErrorSizes(drift_m), 2 * _ROUNDS)


class PlaceNow(NamedTuple):
    """A place in the frame reported now, north and east, its covariance, and the fits that are likely.

    `misfit`: the mean squared error of the most likely fit, by the variances.
    """

    place: tuple[float, float]
    covariance: Covariance
    misfit: float
    likely: Sequence[tuple[ErrorSizes, DriftFit]]


def place_now(
    x: Array,
    o: dipole.DipoleReadings,
    near: Sequence[DriftFit],
    ahead_s: float,
    velocity: Array,
    likely: Sequence[tuple[ErrorSizes, DriftFit]] = (),
) -> PlaceNow:
    """Return the place of a transmitter in the frame reported now.

    `x`: hypotheses (K, 7), the best first. `near`: their fits, if they follow a drift; the best one begins also
    without. They are fitted with errors of all sizes, which count by their likelihood. All errors of a fit may be
    smaller than assumed; then the fit is the same. `ahead_s`, `velocity`: as in `fitted`. `likely`: the fits that were
    likely a reading before; only these are fitted again.
    """
    o = o.telling
    if likely:
        begin = {errors: [fit for of, fit in likely if of == errors] for errors, _ in likely}
        tried = [(errors, np.array([fit.x for fit in fits]), fits) for errors, fits in begin.items()]
    else:
        few = _far_apart(x[:, :3])[: _FEW - 1]
        first, followed = x[few], list[DriftFit]()
        if near:
            first, followed = np.concatenate([first, x[:1]]), [near[i] for i in few]
        tried = [(errors, first, followed) for errors in ANY]
    every = [
        (errors, one)
        for errors, first, fits in tried
        for one in _apart(fitted(first, o, errors, 2 * _ROUNDS, fits, ahead_s, velocity))
    ]
    share, scale = _shares([one for _, one in every])
    places = np.array([one.now[:2] for _, one in every])
    north, east = (share @ places).tolist()
    off = places - (north, east)
    each_now = np.array([one.now_covariance[:2, :2] + errors.white_m**2 * np.eye(2) for errors, one in every])
    covariance = np.einsum("k,kij->ij", share * scale, each_now) + (share * off.T) @ off
    covariance += _ROUNDED_M**2 * np.eye(2)
    (nn, ne), (_, ee) = covariance.tolist()
    best = every[int(share.argmax())][1]
    likely = [every[i] for i in np.flatnonzero(share > _LIKELY)]
    return PlaceNow((north, east), (nn, ne, ee), best.misfit / best.parts, likely)


def _shares(fits: Sequence[DriftFit]) -> tuple[Array, Array]:
    """Return the share (K,) of each fit by its likelihood, and the factor (K,) of its variances by its own errors."""
    cost, misfit, free = np.array([(f.cost, f.misfit, max(f.parts - len(f.x), 1)) for f in fits]).T
    scale = np.clip(misfit / free, _LEAST**2, 1.0)
    cost = cost - 0.5 * np.linalg.slogdet(np.array([one.covariance for one in fits]))[1]
    cost = cost + 0.5 * (misfit * (1 / scale - 1) + free * np.log(scale))
    share: Array = np.exp((cost.min() - cost) / _DISCOUNT)
    return share / share.sum(), scale


def _apart(every: Sequence[DriftFit]) -> list[DriftFit]:
    """Return the fits that differ in their places, the best first."""
    best = sorted(every, key=lambda fit: fit.cost)
    return [best[i] for i in _far_apart(np.array([[*one.x[:3], *one.now] for one in best]))]


def _far_apart(places: Array) -> list[int]:
    """Return the numbers of the places that are far from all before them."""
    kept: list[int] = []
    for i, place in enumerate(places):
        if all(math.dist(place, places[j]) > _APART_M for j in kept):
            kept.append(i)
    return kept


def _then(fit: DriftFit, time_s: Array) -> Array:
    """Return the drift of a fit at times (N,); of new readings, as it was last."""
    order = 1 + np.argsort(fit.time_s[1:])
    return np.array([np.interp(time_s, fit.time_s[order], axis[order]) for axis in fit.drift])


def _alike(after_s: Array, times_s: tuple[float, float]) -> Array:
    """Return the correlation of drifts by their distance in time; `times_s`: of the drift, and of its filter."""
    slow, quick = times_s
    t = np.abs(after_s)
    return (slow * np.exp(-t / slow) - quick * np.exp(-t / quick)) / (slow - quick)
