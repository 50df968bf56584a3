"""The true state of an emulated vehicle: its report, its report and a seeded error, or its simulator's truth."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from arva_hil.config import NavigationError, Scenario
from arva_hil.field import LocalFrame, quaternion
from arva_hil.field.arrays import Array
from arva_hil.vehicle.pose_track import VehicleState
from arva_hil.vehicle.reasons import NoPose
from arva_hil.vehicle.session import Session
from arva_hil.vehicle.simulator_truth import SimulatorTruth

_STEP_S: Final = 0.1  # of the random walk; interpolated between two steps
_KEEP: Final = 600  # steps: for an earlier time the walk is calculated again from its start


class PoseError:
    """Remembers the last minute of a random walk. The true pose is the sum of the reported pose and this error.

    `bias_ned` (3,): metres. `walk_sigma_m`, `walk_tau_s`: standard deviation and correlation time of a Gauss-Markov
    process on each axis. `heading_deg`: true minus reported heading, clockwise. The same seed gives the same error at
    the same time, in any order of calls.
    """

    def __init__(
        self, bias_ned: ArrayLike, walk_sigma_m: float, walk_tau_s: float, heading_deg: float, *, seed: int
    ) -> None:
        self._bias = np.asarray(bias_ned, float)
        self._sigma = walk_sigma_m
        self._keep = math.exp(-_STEP_S / walk_tau_s)
        self._turn = quaternion.from_euler(0.0, 0.0, math.radians(heading_deg))
        self._seed = seed
        self._begin()

    def true_pose(self, time_s: float, position: Array, attitude: Array) -> tuple[Array, Array]:
        """True position (3,) NED [m] and attitude quaternion (4,), body → NED, from the reported ones.

        `time_s`: from the start of the run; before the start the error is that of the start.
        """
        there = position + self._bias
        if self._sigma:
            there += self._walked(max(0.0, time_s / _STEP_S))
        return there, np.array(quaternion.multiply(self._turn, quaternion.unit(*attitude.tolist())))

    def _begin(self) -> None:
        self._random = np.random.Generator(np.random.PCG64([self._seed, 0x57A4]))
        self._first = 0  # the number of the oldest step remembered
        self._steps = deque([self._sigma * self._random.standard_normal(3)])

    def _walked(self, steps: float) -> Array:
        number = math.floor(steps)
        if number < self._first:
            self._begin()
        spread = self._sigma * math.sqrt(1 - self._keep**2)
        while self._first + len(self._steps) <= number + 1:
            self._steps.append(self._keep * self._steps[-1] + spread * self._random.standard_normal(3))
            if len(self._steps) > _KEEP:
                self._steps.popleft()
                self._first += 1
        before, after = self._steps[number - self._first], self._steps[number + 1 - self._first]
        return before + (steps - number) * (after - before)


class TrueState:
    """The true state of a session's vehicle: what it reports. Times are seconds on the driver's clock."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def hear(self, now: float) -> None:
        """The session has been fed."""

    def at(self, t: float, frame: LocalFrame, reported: VehicleState | None) -> VehicleState | None:
        """The true state at `t` in the NED frame `frame`; `reported`: what the vehicle reports for that instant."""
        return reported

    def known_at(self, t: float) -> bool:
        """Whether no later message can change the state at `t`."""
        return self._session.track.is_known(self._session.clock.boot(t))

    def lacking(self) -> NoPose | None:
        """Why there is no true state; None if the reason is that the vehicle reports no state."""
        return None


class _WithError(TrueState):
    """The truth is the report and an error. Reports are `latency_s` old: the truth is the report at that time later."""

    def __init__(self, error: NavigationError, seed: int, session: Session, start: float) -> None:
        super().__init__(session)
        self._latency_s = error.latency_s
        self._error = PoseError(error.bias_ned, error.walk_sigma_m, error.walk_tau_s, error.heading_deg, seed=seed)
        self._start = start

    def at(self, t: float, frame: LocalFrame, reported: VehicleState | None) -> VehicleState | None:
        later = self._session.state_at(t + self._latency_s, frame) if self._latency_s else reported
        if later is None or reported is None:
            return None
        position, attitude = self._error.true_pose(t - self._start, later.position, later.attitude)
        return replace(reported, position=position, velocity=later.velocity, attitude=attitude)

    def known_at(self, t: float) -> bool:
        return super().known_at(t + self._latency_s)


class _BySimulator(TrueState):
    """The truth is what the vehicle's simulator says."""

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._truth = SimulatorTruth(session)

    def hear(self, now: float) -> None:
        self._truth.hear(now)

    def at(self, t: float, frame: LocalFrame, reported: VehicleState | None) -> VehicleState | None:
        return self._truth.track.at(self._session.clock.boot(t), frame)

    def known_at(self, t: float) -> bool:
        return self._truth.track.is_known(self._session.clock.boot(t))

    def lacking(self) -> NoPose | None:
        return None if self._session.track.newest is None else self._truth.lacking()


def true_state(scenario: Scenario, session: Session, start: float) -> TrueState:
    """The true state according to the scenario. `start`: of the run."""
    if scenario.pose == "truth":
        return _BySimulator(session)
    error = scenario.navigation_error
    return _WithError(error, scenario.seed, session, start) if error else TrueState(session)
