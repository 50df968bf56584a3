"""Where an emulated vehicle truly is: where it reports to be, or that and an error, or where its simulator says."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

from arva_hil.config import NavigationError, Scenario
from arva_hil.emulator.navigation_error import PoseError
from arva_hil.field import LocalFrame
from arva_hil.vehicle.pose_track import VehicleState
from arva_hil.vehicle.reasons import NoPose
from arva_hil.vehicle.session import Session
from arva_hil.vehicle.simulator_truth import SimulatorTruth


class TrueState(Protocol):
    """Times are seconds on the driver's clock."""

    def hear(self, now: float) -> None:
        """The session has been fed."""

    def at(self, t: float, frame: LocalFrame, reported: VehicleState | None) -> VehicleState | None:
        """The true state at `t` in the NED frame `frame`; `reported`: what the vehicle reports for that instant."""

    def known_at(self, t: float) -> bool:
        """What there is to know of it at `t` is known."""

    def lacking(self) -> NoPose | None:
        """Why there is none; None when that is because the vehicle reports none."""


def true_state(scenario: Scenario, session: Session, start: float) -> TrueState:
    """As the scenario has it. `start`: of the run."""
    if scenario.pose == "truth":
        return _BySimulator(session)
    error = scenario.navigation_error
    return _WithError(error, scenario.seed, session, start) if error else _AsReported(session)


class _AsReported:
    """The report counts as the truth."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def hear(self, now: float) -> None: ...

    def at(self, t: float, frame: LocalFrame, reported: VehicleState | None) -> VehicleState | None:
        return reported

    def known_at(self, t: float) -> bool:
        boot, newest = self._session.clock.boot(t), self._session.track.newest
        return boot is None or newest is None or newest >= boot

    def lacking(self) -> NoPose | None:
        return None


class _WithError(_AsReported):
    """The truth is the report and an error. What is reported is `latency_s` old: the truth is what will be reported."""

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


class _BySimulator:
    """A simulator tells the truth."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._truth = SimulatorTruth(session)

    def hear(self, now: float) -> None:
        self._truth.hear(now)

    def at(self, t: float, frame: LocalFrame, reported: VehicleState | None) -> VehicleState | None:
        boot = self._session.clock.boot(t)
        return None if boot is None else self._truth.track.at(boot, frame)

    def known_at(self, t: float) -> bool:
        boot, newest = self._session.clock.boot(t), self._truth.track.newest
        return boot is None or newest is None or newest >= boot

    def lacking(self) -> NoPose | None:
        return None if self._session.track.newest is None else self._truth.lacking()
