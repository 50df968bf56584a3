"""A search that estimates the place of the transmitter from the field of a dipole, and flies there.

The strategy keeps several hypotheses, weighted by the likelihood of all readings, and drops unlikely ones. The vehicle
flies to their average, which separates them. Before it stops, it samples other hypotheses again, and circles about the
place until a reading tells well where it is now: a reading beside a transmitter tells more than one right above it. The
strategy detects late readings, places that drift like those of a GPS, dead antennas, and electronics that mask distant
transmitters.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from . import dipole
from .agreement import Evidence, beginning, judged
from .circle import RADIUS_M, Circle
from .drift import DRIFTS_M, WHITE_M, DriftFit, ErrorSizes, fitted_again, fitted_beside, place_now
from .history import NOTHING, Explanation, Track
from .strategy import STILL, Belief, Found, Observation, Position, Velocity, sigma_of, towards

_STEP_M: Final = 0.48  # keep a reading after this distance
_STEP_S: Final = 0.2  # keep readings no closer in time
_DRIFTING_S: Final = 1.5  # the same under a drift
# hypotheses this close are equal: place over distance (3), moment (3), yaw
_SAME: Final = np.array([0.02] * 3 + [0.1] * 4)
_MANY: Final = 40  # most hypotheses kept
_ROUNDS: Final = 2  # rounds of a fit
_DOUBTS: Final = (4, 4)  # rounds of the fits before the search stops
_CAUTION: Final = 2.0  # times the covariance: readings are less independent than in the fit
_SURE_M: Final = 0.3  # sigma
_TURNED: Final = math.radians(5.0)  # report a yaw only beyond this
_TURNED_SIGMAS: Final = 3.0  # and beyond this many sigmas
_HERE_M: Final = 0.5  # the goal is reached within this distance
_NEAR_M: Final = RADIUS_M + 0.5  # begin to circle within this distance
_ASTRAY_M: Final = RADIUS_M + 1.5  # end the circle beyond this distance
_MISFIT_M: Final = 0.6  # a larger pose error means a wrong hypothesis
_AFRESH: Final = 5  # readings between two samples of hypotheses
_LOST: Final = 6  # readings in a row without a signal
_TURN_M: Final = 2.5  # radius of the first turn of the spiral, flown for more readings
_GAIN: Final = 1.5  # 1/s
_TELL_S: Final = 120.0  # time above a place in which another circle may distinguish a drift from none
_EXPLAIN_EVERY: Final = 15  # readings between two comparisons of causes, if the readings are odd
_EXPLAIN_LATER: Final = 60  # the same, if they are not
_EXPLAIN_DRIFTING: Final = 30  # the same under a known drift
_ODD_M: Final = 0.3  # a larger pose error is odd
_EVIDENT: Final = 16.0  # accept another cause if it is more likely by e^16
_LATE_S: Final = 1.0  # readings with a larger delay need another circle
_LIKELY: Final = 3.0  # accept a drift at the end if it is more likely by e^3
_LIKELIER: Final = 6.0  # accept any cause by e^6 if the place is doubtful
_UNLIKELY: Final = 9.0  # drop a drift that is less likely by e^9
_DOUBTFUL_S: Final = 90.0  # report the place as it is after this time
_LONGEST_S: Final = 240.0  # the same after the first hover above a place, without exception
_REACH_S: Final = 20.0  # and after this time more if the place moves too fast to be reached
_DRIFT_CAUTION: Final = 1.6  # times the covariance of the place now if a drift is known or likely
_WANDERS_M: Final = 0.45  # with a larger pose error and no drift, the places wander as no drift that is tried
_UNEXPLAINED: Final = 1.2  # a larger mean squared error, by the variances, is of an error that is not tried
_FARTHER_M: Final = 1.0  # sigma added then, and under the largest drift, which may be a larger one
_REPORT_S: Final = 1.0  # time between two readings that may report a place
_KNOWN_M: Final = 0.22  # report a place whose sigma is less now
_AT_ONCE_M: Final = 0.02  # report it without another circle if its sigma is less than this
_PATIENCE_S: Final = 180.0  # time from the first hover after which that sigma grows
_TRIES: Final = 1.5  # times the covariance of a place that is reported after that: it is one of many
_DRIFT: Final = 0.3  # share of a drift by which sigma may be larger in a hover


class Hypotheses:
    """Dipoles that may explain the readings, under one cause; their shares add up to 1.

    - `cause`: of the errors of the readings. `readings`: with the poses under that cause.
    - `x`: dipoles (K, 7). `share`: (K,).
    - `drifts`: the fits under a drift of the places, the best first; none without a drift.
    - `covariance`: of north and east of the average [m²].
    - `pose_error`: of the receiver's places [m]. `age`: readings since other hypotheses were added.
    """

    def __init__(self, evidence: Evidence) -> None:
        self.readings = dipole.DipoleReadings()
        self.cause = NOTHING
        self.drifts: list[DriftFit] = []
        self.x, self.pose_error = np.empty((0, 7)), 0.1
        self.share = np.empty(0)
        self.covariance = np.zeros((2, 2))
        self.age = 0
        self._evidence = evidence
        self._damping = np.empty(0)
        self._yaw_sigma = math.inf  # of the best one, rad
        self._likely: Sequence[tuple[ErrorSizes, DriftFit]] = ()  # the fits of the place now

    def take(self, one: Explanation, o: Observation) -> None:
        """Replace the hypotheses by those of an explanation."""
        self.cause, self.readings = one.cause, one.readings
        self.drifts = [one.best] if one.cause.drift_m else []
        self.x, self._damping, self.pose_error = one.x, np.full(len(one.x), 0.01), min(one.pose_error, 1.0)
        self.weigh(o, _ROUNDS)

    def add(self, one: Explanation) -> None:
        """Put the best fit of an explanation before the others."""
        self.x, self.drifts = np.concatenate([one.x[:1], self.x]), [one.best, *self.drifts]
        self.share = np.append(0.0, self.share)  # until it is weighed

    @property
    def places(self) -> NDArray[np.float64]:
        """The places (K, 3) of the hypotheses in the frame reported now."""
        return np.array([one.now for one in self.drifts]) if self.drifts else self.x[:, :3]

    @property
    def settled(self) -> Found:
        """The average of the hypotheses, without the drift."""
        place, covariance = self.share @ self.places, self.covariance
        if self.drifts:
            best = self.drifts[0]  # its mean place, not the one reported now
            place, covariance = best.x[:3], best.covariance[:2, :2]
        (nn, ne), (_, ee) = covariance.tolist()
        north, east, down = place.tolist()
        return Found(north, east, down, (nn, ne, ee))

    def found(self, time_s: float) -> Found:
        """Return the place with that in the frame reported at a time, and the yaw of the receiver."""
        far = abs(self.x[0, 6]) > max(_TURNED, _TURNED_SIGMAS * self._yaw_sigma)
        self._likely = ()
        return self.now(self.settled, time_s)._replace(turned_deg=math.degrees(self.x[0, 6]) if far else None)

    def now(self, found: Found, time_s: float) -> Found:
        """Return a place found with that in the frame reported at a time."""
        readings, lag_s = self._evidence.readings(self.cause), self.cause.lag_s
        velocity, ahead_s = self._evidence.velocity(readings.time_s - lag_s), time_s - self._evidence.newest_s + lag_s
        place, (nn, ne, ee), misfit, self._likely = place_now(
            self.x, readings, self.drifts, ahead_s, velocity, self._likely
        )
        drift_m, error_m = self.cause.drift_m, self.pose_error
        times = _DRIFT_CAUTION if drift_m or error_m > _ODD_M else 1.0
        more = _FARTHER_M**2 if drift_m == max(DRIFTS_M) or error_m > _WANDERS_M or misfit > _UNEXPLAINED else 0.0
        return found._replace(now=place, now_covariance=(times * nn + more, times * ne, times * ee + more))

    def seed(self, o: Observation) -> None:
        """Add hypotheses that agree with a reading."""
        new = dipole.seeds(o.position, o.bearing, o.d_m, o.ground)
        self.x = np.concatenate([self.x, new])
        self._damping = np.append(self._damping, np.full(len(new), 0.01))
        self.age = 0

    def seed_drifting(self, o: Observation) -> None:
        """Add fits under the drift that begin beside the best hypothesis, without the drift followed so far."""
        new = fitted_beside(self.x[0], self.readings, self.cause.drift_m)
        self.drifts = sorted([*self.drifts, *new], key=lambda fit: fit.cost)
        self.x = np.array([fit.x for fit in self.drifts])
        self.weigh(o, _ROUNDS)

    def weigh(self, o: Observation, rounds: int) -> None:
        """Fit the hypotheses, and drop unlikely and equal ones."""
        if self.cause.drift_m:
            self._weigh_drifting()
            return
        fit, damping = dipole.refine(self.x, self._damping, self.readings, self.pose_error, rounds)
        order = np.argsort(fit.cost, kind="stable")
        x, cost = fit.x[order], fit.cost[order] - fit.cost[order[0]]
        x[:, 3:6] *= np.where(x[:, 3:6] @ x[0, 3:6] < 0, -1, 1)[:, None]  # m and −m give equal readings
        scale = _SAME * ([1 + math.dist(x[0, :3], o.position)] * 3 + [1] * 4)
        apart = (np.abs(x[:, None] - x) > scale).any(axis=2)
        kept = np.flatnonzero((cost < dipole.FORGET) & (apart | ~np.tri(len(x), k=-1, dtype=bool)).all(axis=1))[:_MANY]
        order = order[kept]
        self.x, self._damping, self.share = x[kept], damping[order], np.exp(-cost[kept])
        self.share /= self.share.sum()
        self.pose_error = float(dipole.likely_pose_errors(fit, order[:1], self.readings, dipole.POSE_ERRORS)[0][0])
        each = _CAUTION * np.linalg.inv(fit.information[order])
        self._yaw_sigma = math.sqrt(each[0, 6, 6])
        self._spread(each[:, :2, :2])

    def _weigh_drifting(self) -> None:
        """Weigh the hypotheses under a drift, at their places in the frame reported now."""
        self.readings = self._evidence.readings(self.cause)
        self.drifts = fitted_again(self.x, self.drifts, self.readings, self.cause.drift_m)
        self.x = np.array([one.x for one in self.drifts])
        self._damping = np.full(len(self.x), 0.01)
        self.share = np.exp([self.drifts[0].cost - d.cost for d in self.drifts])
        self.share /= self.share.sum()
        self.pose_error, self._yaw_sigma = WHITE_M, math.sqrt(self.drifts[0].covariance[6, 6])
        self._spread(np.array([d.now_covariance[:2, :2] for d in self.drifts]))

    def _spread(self, each: NDArray[Any]) -> None:
        """Update the covariance of the average of the hypotheses, from that of each."""
        off = self.places[:, :2] - self.share @ self.places[:, :2]
        each = each + off[:, :, None] * off[:, None]
        self.covariance = np.einsum("k,kij->ij", self.share, each)

    @property
    def sure(self) -> bool:
        """True if the covariance is small, and the readings agree or are many."""
        misfit = self.pose_error >= _MISFIT_M
        sigma = _SURE_M + _DRIFT * (self.pose_error if misfit else self.cause.drift_m)
        near = len(self.x) > 0 and np.linalg.eigvalsh(self.covariance)[1] < sigma**2
        return bool(near) and (not misfit or len(self.readings.said) == dipole.MOST)

    @property
    def place(self) -> tuple[float, float]:
        """The average of the hypotheses."""
        north, east, _ = (self.share @ self.places).tolist()
        return north, east


class Course:
    """Remembers the heading, and the turns of the spiral that is flown for more readings.

    `strongest`: the strongest reading. `goal`: north, east [m]; None before the first reading. `newest_s`: time of the
    newest reading since the first signal.
    """

    def __init__(self) -> None:
        self.strongest: Observation | None = None
        self.goal: tuple[float, float] | None = None
        self.newest_s = -math.inf
        self._heading = np.zeros(2)
        self._silent = self._turns = 0

    def add(self, o: Observation) -> None:
        """Add a reading."""
        if o.heard and (self.strongest is None or o.d_cm < self.strongest.d_cm):
            self.strongest = o
        if self.strongest:
            self.newest_s = o.time_s

    def steer(self, o: Observation, strongest: Observation, dipoles: Hypotheses) -> None:
        """Fly to the hypotheses; without a signal to the best place, and there in a spiral."""
        here = np.array(o.position[:2])
        self._silent = 0 if o.heard else self._silent + 1
        if self.goal is None:
            self._heading = np.array([math.cos(o.bearing), math.sin(o.bearing)])
        if dipoles.sure:
            self._turns = 0
        elif self.goal and math.dist(here, self.goal) < _HERE_M:
            self._turns += 1
        angle, radius = 2.4 * self._turns, _TURN_M * math.sqrt(self._turns)
        aside = np.array([radius * math.cos(angle), radius * math.sin(angle)])
        goal = strongest.position[:2] + aside
        if self._silent <= _LOST:
            to = dipoles.places[:, :2] + aside - here
            distance = np.maximum(np.hypot(to[:, 0], to[:, 1]), 1e-9)
            mean = dipoles.share @ (to / distance[:, None])
            # Keep the heading as far as the hypotheses disagree.
            heading = mean + 0.5 * (1 - math.hypot(*mean)) * self._heading
            self._heading = heading / max(math.hypot(*heading), 1e-9)
            goal = here + self._heading * (dipoles.share @ distance)
        self.goal = (float(goal[0]), float(goal[1]))


class Estimate:
    """Remembers the readings, the hypotheses that are left, and the path that separates them."""

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._found: Found | None = None
        self.track: Track = ()  # of a transmitter that moves
        self._evidence = Evidence()
        self._dipoles = Hypotheses(self._evidence)
        self._unexplained = 0  # readings since causes were compared
        self._circle: Circle | None = None
        self._candidate: Found | None = None  # it circles about this place until it reports it
        self._doubtful_s = math.inf  # start of the disagreement of readings and place
        self._above_s = math.inf  # start of the first hover above a place
        self._course = Course()

    @property
    def found(self) -> Found | None:
        return self._found

    @property
    def belief(self) -> Belief:
        """The hypotheses, the covariance of their average, and the goal."""
        (nn, ne), (_, ee) = self._dipoles.covariance.tolist()
        every = np.column_stack([self._dipoles.places[:, :2], self._dipoles.share]).tolist()
        return Belief(tuple(map(tuple, every)), (nn, ne, ee) if every else None, self._course.goal)

    def velocity(self, time_s: float, position: Position) -> Velocity:
        if self._circle:
            return self._circle.velocity(position, self._speed)
        goal = self._course.goal
        return towards(position, goal, self._speed, gain=_GAIN) if goal else STILL

    def observe(self, observation: Observation) -> None:
        o = observation
        if self._found or not self._evidence.add(o):
            return
        step_s = _DRIFTING_S if self._dipoles.drifts else max(_STEP_S, _STEP_M / self._speed)
        if 0 <= o.time_s - self._course.newest_s < (_REPORT_S if self._candidate else step_s):
            return
        if self._candidate:
            self._course.newest_s = o.time_s
            self._report(self._dipoles.now(self._candidate, o.time_s), o)
            return
        self._course.add(o)
        strongest = self._course.strongest
        if strongest is None:
            return
        self._dipoles.age += 1
        at, rotation = self._evidence.at(o.time_s - o.age_s - self._dipoles.cause.lag_s)
        for measured in o.measurements:
            self._dipoles.readings.add(at, rotation, *measured, o.time_s, o.ground)
        if not len(self._dipoles.x):
            self._dipoles.seed(o)
        elif self._dipoles.pose_error > _MISFIT_M and self._dipoles.age > _AFRESH:
            self._dipoles.seed(strongest)
        self._dipoles.weigh(o, _ROUNDS)
        self._unexplained += 1
        odd = bool(self._dipoles.cause.drift_m) or self._dipoles.pose_error > _ODD_M
        later = _EXPLAIN_EVERY if odd else _EXPLAIN_LATER
        later = _EXPLAIN_DRIFTING if self._dipoles.drifts else later
        if self._unexplained > later:
            self._explain(o)
        self._listen(o)
        self._course.steer(o, strongest, self._dipoles)

    def _report(self, candidate: Found, o: Observation) -> None:
        """Report the place once two readings in a row beside it tell well where it is now; until then, circle about it.

        A single one would be the one of many whose sigma is too small by chance. So would one of few, unless it is
        exact: the errors of the readings are not known before another circle.
        """
        before, self._candidate, self._course.goal = self._candidate, candidate, candidate.goal
        near, after_s = math.dist(o.position[:2], candidate.goal) < _NEAR_M, o.time_s - self._above_s
        sigma = max(sigma_of(one and one.now_covariance) or math.inf for one in (before, candidate))
        checked = sigma < _AT_ONCE_M or (self._circle is not None and self._circle.done)
        known = checked and sigma < _KNOWN_M * max(1.0, after_s / _PATIENCE_S)
        if (near and known) or after_s > _LONGEST_S + _REACH_S:
            self._found, self._circle = _one_of_many(candidate) if after_s > _PATIENCE_S else candidate, None
            return
        if self._circle is None:
            self._circle = Circle(candidate.goal, o.position)
        elif self._circle.done:
            self._candidate = None  # check the place again
        self._circle.observe(candidate.goal)

    def _listen(self, o: Observation) -> None:
        """Circle about the place before it is reported. Causes may change, but the circle ends in bounded time."""
        near, checked = self._near(o, _NEAR_M), False
        if near:
            self._above_s = min(self._above_s, o.time_s)
        if o.time_s - self._doubtful_s > _DOUBTFUL_S or o.time_s - self._above_s > _LONGEST_S:
            checked = True
        elif self._circle is None:
            if near:
                self._doubt(o)
            if near and self._near(o, _NEAR_M):
                self._circle = Circle(self._dipoles.place, o.position)
        elif math.dist(o.position[:2], self._dipoles.place) > _ASTRAY_M or not (
            self._dipoles.sure or self._dipoles.drifts
        ):
            self._circle = None
        elif self._circle.done:
            self._doubt(o)
            checked = self._certain(o)
        if checked:
            self._circle = None
            self._report(self._dipoles.found(o.time_s), o)
        elif self._circle:
            self._circle.observe(self._dipoles.place)

    def _certain(self, o: Observation) -> bool:
        """Return True if the readings agree with the place. If not, sample again for another cause or hypothesis."""
        north, east, *_ = self._dipoles.settled
        every = self._evidence.explanations(beginning((north, east), self._evidence), self._dipoles.cause)
        judgement = judged((north, east), every)
        agrees = judgement is not None and judgement.agrees(-o.position[2])
        if not agrees:
            self.track = self._evidence.track(self._dipoles.x[:3], every)
            self._doubtful_s = min(self._doubtful_s, o.time_s)
            self._circle = None
        if self._believe(every, _LIKELIER, o, drift=_LIKELY):
            return False
        if self._may_drift(every, o.time_s):
            self._circle = None
            return False
        return agrees

    def _may_drift(self, every: Sequence[Explanation], time_s: float) -> bool:
        """Return True if the readings of another circle are needed to distinguish a usual drift from none."""
        least = min(one.cost for one in every)
        drifts = any(one.cause.drift_m >= DRIFTS_M[0] and one.cost < least + _UNLIKELY for one in every)
        return drifts and self._dipoles.cause.drift_m < DRIFTS_M[0] and time_s - self._above_s < _TELL_S

    def _explain(self, o: Observation) -> None:
        """Find the delay of the readings, the drift of their places, and the antennas that fail."""
        every = self._evidence.explanations(self._dipoles.x[:3], self._dipoles.cause)
        self.track = self._evidence.track(self._dipoles.x[:3], every)
        self._believe(every, _EVIDENT, o)

    def _believe(
        self, every: Sequence[Explanation], evident: float, o: Observation, *, drift: float = _EVIDENT
    ) -> bool:
        """Take the best explanation if it is more likely by e^`evident` than the present one, which is the first.

        Return True if further explanations may be better: not after a smaller drift. `drift`: the limit for a first
        drift, which takes long to average out.
        """
        self._unexplained, before, present = 0, self._dipoles.cause, every[0]
        new = 0.0 if before.drift_m else min(drift, _LIKELIER)
        best = min(every, key=lambda one: one.cost + (new if one.cause.drift_m else 0.0))
        lower = 0 < best.cause.drift_m < before.drift_m
        if lower or best.cause.drift_m > before.drift_m:
            evident = _EVIDENT if lower else drift
        if self._dipoles.drifts and present.best.cost < self._dipoles.drifts[0].cost:
            self._dipoles.add(present)
        if best.cause == before or present.cost - best.cost < evident:
            return False
        if best.cause.lag_s > before.lag_s + _LATE_S:
            self._circle = None  # its centre was another place
        self._dipoles.take(best, o)
        return not lower

    def _doubt(self, o: Observation) -> None:
        """Sample other hypotheses once more."""
        if self._dipoles.cause.drift_m:
            self._dipoles.seed_drifting(o)
        elif strongest := self._course.strongest:
            self._dipoles.seed(strongest)
            for rounds in _DOUBTS:
                self._dipoles.weigh(o, rounds)

    def _near(self, o: Observation, near_m: float) -> bool:
        return self._dipoles.sure and math.dist(o.position[:2], self._dipoles.place) < near_m


def _one_of_many(found: Found) -> Found:
    """Return a place that is reported after many tries, of which its sigma may be the smallest by chance."""
    if found.now_covariance is None:
        return found
    nn, ne, ee = found.now_covariance
    return found._replace(now_covariance=(_TRIES * nn, _TRIES * ne, _TRIES * ee))
