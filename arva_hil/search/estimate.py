"""A search that estimates the place of the transmitter from the field of a dipole, and flies there.

Several hypotheses are kept, with weights from the likelihood of all readings; unlikely ones are dropped. The vehicle
flies to their average, which separates them. Before it stops, it looks for other hypotheses again.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from . import dipole
from .strategy import STILL, Belief, Found, Observation, Position, Velocity, towards

_STEP_M: Final = 0.48  # flown between two readings that are kept,
_STEP_S: Final = 0.2  # and the time at least
_FORGET: Final = 12.0  # a hypothesis whose likelihood is e^−12 of the best one's
_SAME: Final = np.array([0.02] * 3 + [0.1] * 3)  # apart by less: place over distance, and moment
_MANY: Final = 40
_ROUNDS: Final = 2
_DOUBTS: Final = (4, 4)  # rounds again, before it stops
_CAUTION: Final = 2.0  # of the covariance: readings are not as independent as the fit believes
_SURE_M: Final = 0.3  # sigma
_HERE_M: Final = 0.5
_MISFIT_M: Final = 0.6  # a pose error that tells rather of a wrong hypothesis
_AFRESH: Final = 5  # readings between two looks for other hypotheses
_LOST: Final = 6  # readings in a row in which nothing was heard
_TURN_M: Final = 2.5  # first turn of the spiral in which more is learnt
_GAIN: Final = 1.5  # 1/s


class Estimate:
    """Remembers the readings, the hypotheses that are left, and the place that it flies to."""

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._found: Found | None = None
        self._readings = dipole.Readings()
        self._strongest: Observation | None = None
        self._last_s = -math.inf
        self._silent = self._age = self._turns = 0
        self._x, self._damping, self._pose_error = np.empty((0, 6)), np.empty(0), 0.1
        self._share = np.empty(0)
        self._covariance = np.zeros((2, 2))
        self._sure = False
        self._heading = np.zeros(2)
        self._target: tuple[float, float] | None = None

    @property
    def found(self) -> Found | None:
        return self._found

    @property
    def belief(self) -> Belief:
        """The hypotheses, the covariance of their average, and where it flies to."""
        (nn, ne), (_, ee) = self._covariance.tolist()
        every = np.column_stack([self._x[:, :2], self._share]).tolist()
        return Belief(tuple(map(tuple, every)), (nn, ne, ee) if every else None, self._target)

    def velocity(self, time_s: float, position: Position) -> Velocity:
        return towards(position, self._target, self._speed, gain=_GAIN) if self._target else STILL

    def hear(self, observation: Observation) -> None:
        o = observation
        soon = 0 <= o.time_s - self._last_s < max(_STEP_S, _STEP_M / self._speed)
        if self._found or soon or not (np.isfinite(o.position).all() and np.isfinite(o.rotation).all()):
            return
        if o.heard and (self._strongest is None or o.d_cm < self._strongest.d_cm):
            self._strongest = o
        if self._strongest is None:
            return
        self._last_s = o.time_s
        self._silent = 0 if o.heard else self._silent + 1
        self._age += 1
        self._readings.add(o.position, o.rotation, o.d_m, math.radians(o.delta_deg), o.inner)
        if not len(self._x):
            self._heading = np.array([math.cos(o.bearing), math.sin(o.bearing)])
            self._seed(o)
        elif self._pose_error > _MISFIT_M and self._age > _AFRESH:
            self._seed(self._strongest)
        self._weigh(o, _ROUNDS)
        if self._arrived(o) and self._age:
            self._seed(self._strongest)
            for rounds in _DOUBTS:
                self._weigh(o, rounds)
            if self._arrived(o):
                (nn, ne), (_, ee) = self._covariance.tolist()
                north, east, down = (self._share @ self._x[:, :3]).tolist()
                self._found = Found(north, east, down, (nn, ne, ee))
        self._steer(o, self._strongest)

    def _seed(self, o: Observation) -> None:
        new = dipole.seeds(o.position, o.bearing, o.d_m)
        self._x = np.concatenate([self._x, new])
        self._damping = np.append(self._damping, np.full(len(new), 0.01))
        self._age = 0

    def _weigh(self, o: Observation, rounds: int) -> None:
        """Fit the hypotheses, and drop unlikely and equal ones."""
        fit, damping = dipole.refine(self._x, self._damping, self._readings, self._pose_error, rounds)
        order = np.argsort(fit.cost, kind="stable")
        x, cost = fit.x[order], fit.cost[order] - fit.cost[order[0]]
        x[:, 3:] *= np.where(x[:, 3:] @ x[0, 3:] < 0, -1, 1)[:, None]  # m and −m sound alike
        scale = _SAME * ([1 + math.dist(x[0, :3], o.position)] * 3 + [1] * 3)
        apart = (np.abs(x[:, None] - x) > scale).any(axis=2)
        kept = np.flatnonzero((cost < _FORGET) & (apart | ~np.tri(len(x), k=-1, dtype=bool)).all(axis=1))[:_MANY]
        order = order[kept]
        self._x, self._damping, self._share = x[kept], damping[order], np.exp(-cost[kept])
        self._share /= self._share.sum()
        self._pose_error = dipole.likely_pose_error(fit, int(order[0]), self._readings)
        off = self._x[:, :2] - self._share @ self._x[:, :2]
        each = _CAUTION * np.linalg.inv(fit.information[order])[:, :2, :2] + off[:, :, None] * off[:, None]
        self._covariance = np.einsum("k,kij->ij", self._share, each)
        self._sure = bool(np.linalg.eigvalsh(self._covariance)[1] < _SURE_M**2) and self._pose_error < _MISFIT_M

    def _arrived(self, o: Observation) -> bool:
        return self._sure and math.dist(o.position[:2], self._share @ self._x[:, :2]) < _HERE_M

    def _steer(self, o: Observation, strongest: Observation) -> None:
        """Fly to the hypotheses, or after the signal is lost to the best place; there, in a spiral."""
        here = np.array(o.position[:2])
        if self._sure:
            self._turns = 0
        elif self._target and math.dist(here, self._target) < _HERE_M:
            self._turns += 1
        angle, radius = 2.4 * self._turns, _TURN_M * math.sqrt(self._turns)
        aside = np.array([radius * math.cos(angle), radius * math.sin(angle)])
        goal = strongest.position[:2] + aside
        if self._silent <= _LOST:
            to = self._x[:, :2] + aside - here
            distance = np.maximum(np.hypot(to[:, 0], to[:, 1]), 1e-9)
            mean = self._share @ (to / distance[:, None])
            heading = mean + 0.5 * (1 - math.hypot(*mean)) * self._heading  # as before, as far as they disagree
            self._heading = heading / max(math.hypot(*heading), 1e-9)
            goal = here + self._heading * (self._share @ distance)
        self._target = (float(goal[0]), float(goal[1]))
