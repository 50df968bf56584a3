"""The readings of one transmitter with the receiver's poses, and their explanations.

Readings may be late, reported places may drift, an antenna may be dead or detuned, electronics may mask distant
transmitters, and the transmitter may have moved. Several of these causes are tried on the readings.
"""

from __future__ import annotations

import bisect
import math
import operator
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.search.strategies import dipole
from arva_hil.search.strategies.drift import DRIFTS_M, WHITE_M, DriftFit, ErrorSizes, fitted
from arva_hil.search.strategies.strategy import Observation, Position

_LAGS_S: Final = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0)
_LATER_S: Final = 0.5  # step between two delays that are tried
_GAINS: Final = ((1.0, 0.0), (0.0, 1.0), (1.0, 0.5), (0.5, 1.0))  # of the antennas x and y
_DEAF_M: Final = (35.0, 20.0)  # 10 and 50 nA/m of electronics
_AGO_S: Final = (15.0, 30.0, 60.0)  # times since a change that are tried
_NEXT_S: Final = 0.1  # between two poses that are kept
_MOST: Final = (4096, 192)  # poses, readings
_SOME_ROUNDS, _MORE_ROUNDS = 4, 15  # rounds under a drift: for the choice, and for the final fit
_FEW, _FEWER = 3, 2  # hypotheses; the same under a drift
_ROUGH_FIT_M: Final = 0.3  # error of the receiver's places, at first
_PASSES: Final = ((2, 12), (4, _FEW), (6, _FEW))  # rounds, and the hypotheses that are kept after them
_ODD: Final = 4.0  # prior cost of any cause except the usual drift
_NEWEST: Final = 32  # newest readings, which are all used
_WALK_M: Final = 5.0  # sigma of the motion of one who walks, as a drift
_STANDS_M: Final = 0.6  # up to this error of the places it may stand still
_WALKED_M: Final = 8.0  # of the newest track, at least
_EVIDENT: Final = 16.0  # a walk is more likely by e^16 than all else
_FITS_M: Final = 0.08  # up to this error of the places no lag or drift is tried
_DOWNS: Final = (-2.5, 3.5)  # usual depth of a transmitter below the ground [m]
_STRENGTH: Final = 2.3  # usual moment: at most this multiple of the reference transmitter's, at least its inverse
OUTLIERS: Final = 0.15  # accept at most this share of outliers
ROUGH_M, ROUGHLY = 0.5, 9.0  # an outlier exceeds this error of the places, and this variance
_time: Final = operator.attrgetter("time_s")

Array = NDArray[np.float64]


class Cause(NamedTuple):
    """The reasons for which readings do not agree.

    The fields are the delay of the readings, the drift of their places, the gains of the antennas x and y, the distance
    at which the reference transmitter is no stronger than noise, and the time since which the transmitter is at its
    present place.
    """

    lag_s: float = 0.0
    drift_m: float = 0.0
    gains: tuple[float, float] = (1.0, 1.0)
    deaf_m: float = math.inf
    since_s: float = -math.inf


NOTHING: Final = Cause()  # the readings need no explanation
_CAUSES: Final = (
    *(Cause(lag_s=lag_s) for lag_s in _LAGS_S),
    *(Cause(gains=gains) for gains in _GAINS),
    *(Cause(deaf_m=deaf_m) for deaf_m in _DEAF_M),
)


Track = tuple[tuple[float, float, float], ...]  # time [s], north, east [m]


class Explanation(NamedTuple):
    """A cause, and its fits to the readings. `cost`: −ln of the likelihood of `best`; `costs`: of all, best first."""

    cause: Cause
    readings: dipole.DipoleReadings
    x: Array  # (K, 7)
    pose_error: float
    best: DriftFit
    cost: float
    costs: Array  # (K,)


class History:
    """Remembers poses and readings, both in order of time."""

    def __init__(self) -> None:
        self._poses: list[Observation] = []
        self._read: list[Observation] = []

    def pose(self, o: Observation) -> None:
        """Remember a pose of the receiver."""
        if self._poses and (back_s := self._poses[-1].time_s - o.time_s) > 0:  # the clock was set back
            self._poses, self._read = (
                [one._replace(time_s=one.time_s - back_s) for one in some] for some in (self._poses, self._read)
            )
        if self._poses and not o.time_s - self._poses[-1].time_s >= _NEXT_S:
            return
        self._poses.append(o)
        if len(self._poses) > _MOST[0]:
            del self._poses[: _MOST[0] // 4]

    def read(self, o: Observation) -> None:
        """Add a reading."""
        self._read.append(o)
        if len(self._read) > _MOST[1]:
            del self._read[: _MOST[1] // 4]

    @property
    def nearest(self) -> Observation | None:
        """The strongest reading, None before the first."""
        return min(self._read, key=_distance, default=None)

    @property
    def newest_s(self) -> float:
        """The time of the newest reading."""
        return self._read[-1].time_s

    def readings(self, cause: Cause = NOTHING) -> dipole.DipoleReadings:
        """Return the newest readings and some earlier ones.

        They are at the receiver's places at their times, with the gains of its antennas.
        """
        there = dipole.DipoleReadings(cause.gains, cause.deaf_m, cause.since_s)
        rest, newest = self._read[:-_NEWEST], self._read[-_NEWEST:]
        if len(self._read) >= dipole.MOST:
            rest = [rest[i] for i in np.linspace(0, len(rest) - 1, dipole.MOST - 1 - _NEWEST).astype(int)]
        places = [(o, self.at(o.time_s - o.age_s - cause.lag_s)) for o in (*rest, *newest)]
        there.add_all([(*place, *measured, o.time_s, o.ground) for o, place in places for measured in o.measurements])
        return there

    def explanations(self, x: Array, cause: Cause = NOTHING) -> list[Explanation]:
        """Return the fits under each cause, for hypotheses (K, 7) to begin with; this cause first.

        If readings without delay and drift fit a usual transmitter, no other cause is tried.
        """
        first = self._fitted(x, cause)
        if cause == NOTHING and first.pose_error < _FITS_M and _usual(first):
            return [first]
        every = [first, *(self._fitted(x, one) for one in _CAUSES if one != cause)]
        late = min((one for one in every if one.cause == Cause(one.cause.lag_s)), key=lambda one: one.cost)
        since = [self._read[-1].time_s - ago_s for ago_s in _AGO_S]
        changed = [Cause(lag_s, since_s=one) for one in since for lag_s in sorted({0.0, late.cause.lag_s})]
        every += [self._fitted(x, one) for one in changed if one.since_s > self._read[0].time_s]
        drifts = self._drifting(x, first, late.cause.lag_s)
        every[0] = next((one for one in drifts if one.cause == cause), first)
        return every + [one for one in drifts if one.cause != cause]

    def track(self, x: Array, every: Sequence[Explanation]) -> Track:
        """Return the track of a transmitter that walks: () if another explanation of `every` is about as likely.

        It is as if the places reported drifted faster and farther than those of any GPS. `x`: hypotheses (K, 7).
        """
        best = min(every, key=lambda one: one.cost)
        if best.cause.drift_m < max(DRIFTS_M) and best.pose_error < _STANDS_M:
            return ()
        walks = self._fitted(x, Cause(drift_m=_WALK_M))
        if walks.cost > best.cost - _EVIDENT:
            return ()
        time_s, moved = walks.best.time_s[1:], walks.best.x[:2] + walks.best.drift[:2, 1:].T
        order = np.argsort(time_s)[-_NEWEST:]
        far = np.ptp(moved[order], axis=0)
        if math.hypot(*far) < _WALKED_M:
            return ()
        return tuple((at, *place) for at, place in zip(time_s[order].tolist(), moved[order].tolist(), strict=True))

    def _drifting(self, x: Array, first: Explanation, lag_s: float) -> list[Explanation]:
        """Return the fits under each drift, for a delay of about `lag_s`. Each fit begins at the end of another."""
        some = (self._fitted(x, Cause(lag_s=one, drift_m=DRIFTS_M[0])) for one in (0.0, _LATER_S))
        best, tried = min(some, key=lambda one: one.cost), {0.0, _LATER_S}
        if first.cause.drift_m and first.cost < best.cost:
            best = first
        beside = {lag_s, best.cause.lag_s + _LATER_S}
        while beside := beside & set(_LAGS_S) - tried:
            tried |= beside
            near = [self._fitted(x, best.cause._replace(lag_s=one), best) for one in sorted(beside)]
            best = min([best, *near], key=lambda one: one.cost)
            beside = {best.cause.lag_s - _LATER_S, best.cause.lag_s + _LATER_S}
        every, begun = {best.cause.drift_m: best}, dict[float, Explanation]()
        for drift_m in DRIFTS_M * 2:
            least = min(every.values(), key=lambda one: one.cost)
            if begun.get(drift_m) is least:
                continue
            begun[drift_m] = least
            one = self._fitted(x, best.cause._replace(drift_m=drift_m), least)
            every[drift_m] = min(one, every.get(drift_m, one), key=lambda one: one.cost)
        return list(every.values())

    def _fitted(self, x: Array, cause: Cause, near: Explanation | None = None) -> Explanation:
        """Return the fit under a cause. Under a drift it begins at `near`, another explanation of the same readings."""
        drift_m = cause.drift_m
        there = near.readings if near and near.cause.lag_s == cause.lag_s else self.readings(cause)
        if near is not None:
            one = near.best
            return _drifts(cause, there, fitted(one.x[None], there, ErrorSizes(drift_m), _MORE_ROUNDS, [one]))
        nearest = min((o for o in self._read if o.time_s >= cause.since_s), key=_distance, default=self._read[-1])
        position, _ = self.at(nearest.time_s - nearest.age_s - cause.lag_s)
        given = x[:_FEW]
        if cause != Cause(lag_s=cause.lag_s):
            x = np.concatenate([x, dipole.seeds(position, nearest.bearing, nearest.d_m, nearest.ground)])
            x = np.unique(x, axis=0)
        damping, errors = np.full(len(x), 0.01), np.full(len(x), max(_ROUGH_FIT_M, drift_m))
        for rounds, kept in _PASSES:
            fit, damping = dipole.refine(x, damping, there, errors[:, None], rounds)
            costs = fit.cost
            if not drift_m:  # with the same large error for all, a wrong dipole may be the better one
                errors, costs = dipole.likely_pose_errors(fit, np.arange(len(x)), there, dipole.WIDE)
            best = np.argsort(costs, kind="stable")[:kept]
            x, damping, errors, costs = fit.x[best], damping[best], errors[best], costs[best]
        if drift_m:
            begin = np.concatenate([given, x])
            rough = sorted(fitted(begin, there, ErrorSizes(drift_m), _SOME_ROUNDS), key=lambda one: one.cost)[:_FEWER]
            better = np.array([one.x for one in rough])
            return _drifts(cause, there, fitted(better, there, ErrorSizes(drift_m), _MORE_ROUNDS, rough))
        error = float(errors[0])
        (one,) = fitted(x[:1], there, ErrorSizes(white_m=error), 0)
        surprise = 0.5 * (math.log(error / dipole.USUAL[0]) / dipole.USUAL[1]) ** 2
        cost = one.cost + surprise + _ODD * (cause != NOTHING)
        return Explanation(cause, there, x, error, one, cost, cost + costs - costs[0])

    def at(self, time_s: float) -> tuple[Position, Array]:
        """Return position and rotation at a time; the first ones before all times, the last ones after."""
        i = bisect.bisect_right(self._poses, time_s, key=_time)
        if i == 0 or i == len(self._poses):
            o = self._poses[max(i - 1, 0)]
            return o.position, o.rotation
        a, b = self._poses[i - 1 : i + 1]
        share = (time_s - a.time_s) / (b.time_s - a.time_s)
        north, east, down = (p + (q - p) * share for p, q in zip(a.position, b.position, strict=True))
        return (north, east, down), a.rotation if share < 0.5 else b.rotation

    def velocity(self, time_s: Array) -> Array:
        """Return the receiver's velocity (3, N) at times (N,), NED [m/s]: the mean of one second."""
        poses = np.array([(o.time_s, *o.position) for o in self._poses]).T
        begin, end = np.clip([time_s - 0.5, time_s + 0.5], poses[0, 0], poses[0, -1])
        way = np.array([np.interp(end, poses[0], axis) - np.interp(begin, poses[0], axis) for axis in poses[1:]])
        velocity: Array = way / np.maximum(end - begin, 0.1)
        return velocity


def speed_of(track: Track) -> float:
    """Return the mean speed along a track [m/s]."""
    way = sum(math.dist(a[1:], b[1:]) for a, b in pairwise(track))
    return way / max(track[-1][0] - track[0][0], 1.0)


def _distance(o: Observation) -> float:
    return o.d_cm if o.heard else math.inf


def _drifts(cause: Cause, readings: dipole.DipoleReadings, fits: list[DriftFit]) -> Explanation:
    """Return the explanation by fits under a drift."""
    fits.sort(key=lambda one: one.cost)
    odd = _ODD * ((cause.lag_s > 0) + (cause.drift_m != DRIFTS_M[0]))
    costs, x = (np.array(column) for column in zip(*((odd + one.cost, one.x) for one in fits), strict=True))
    return Explanation(cause, readings, x, WHITE_M, fits[0], float(costs[0]), costs)


def _usual(one: Explanation) -> bool:
    """Return True if its dipole has a usual depth and moment, and explains most readings."""
    x, (level, *_) = one.best.x, one.readings.level(one.x)
    strength = float(np.linalg.norm(x[3:6])) / dipole.MOMENT
    outliers = dipole.unexplained(x, one.readings, ROUGH_M, ROUGHLY).mean()
    usual = bool(_DOWNS[0] < x[2] - level < _DOWNS[1]) and 1 / _STRENGTH < strength < _STRENGTH
    return usual and bool(outliers < OUTLIERS)
