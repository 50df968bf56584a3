"""The true state of an emulated vehicle: its report, its report and a seeded error, or its simulator's truth."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from arva_hil.autopilot.following.navigation import AttitudeSample, PoseTrack, PositionSample, VehicleState, is_place
from arva_hil.autopilot.following.session import Received, Session
from arva_hil.config import NavigationError, Scenario
from arva_hil.events import Event
from arva_hil.events.reasons import NoPose
from arva_hil.mavlink.codec import dialect
from arva_hil.model.field import LocalFrame, rotation
from arva_hil.model.field.arrays import Array
from arva_hil.model.field.rotation import Quaternion

_STEP_S: Final = 0.1  # of the random walk; interpolated between two steps
_KEEP: Final = 600  # steps: for an earlier time the walk is calculated again from its start
_LATER_S: Final = 1e-6  # between messages of one chunk, to keep their order
_FASTEST: Final = 1_000.0  # m/s, and rad/s
_ASKED: Final = {  # by MAV_AUTOPILOT
    dialect.MAV_AUTOPILOT_ARDUPILOTMEGA: dialect.MAVLINK_MSG_ID_SIM_STATE,
    dialect.MAV_AUTOPILOT_PX4: dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION,
}

_Pose = tuple[PositionSample, AttitudeSample]


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
        self._turn = rotation.from_angles(0.0, 0.0, math.radians(heading_deg))
        self._seed = seed
        self._begin()

    def true_pose(self, time_s: float, position: Array, attitude: Quaternion) -> tuple[Array, Quaternion]:
        """Return true position (3,) NED [m] and attitude, body → NED, from the reported ones.

        `time_s`: from the start of the run; before the start the error is that of the start.
        """
        there = position + self._bias
        if self._sigma:
            there += self._walked(max(0.0, time_s / _STEP_S))
        return there, rotation.multiply(self._turn, rotation.unit(*attitude))

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


class ReportWithError:
    """The truth: the report plus an error. Reports are `latency_s` old: the truth is the report of that time later.

    Times are seconds on the driver's clock.
    """

    def __init__(self, error: NavigationError, seed: int, session: Session, start: float) -> None:
        self._session = session
        self._latency_s = error.latency_s
        self._error = PoseError(error.bias_ned, error.walk_sigma_m, error.walk_tau_s, error.heading_deg, seed=seed)
        self._start = start

    def at(self, t: float, frame: LocalFrame, reported: VehicleState | None) -> VehicleState | None:
        """Return the true state at `t` in the NED frame `frame`; `reported`: the reported one of that instant."""
        later = self._session.navigation.state_at(t + self._latency_s, frame) if self._latency_s else reported
        if later is None or reported is None:
            return None
        position, attitude = self._error.true_pose(t - self._start, later.position, later.attitude)
        return reported._replace(position=position, velocity=later.velocity, attitude=attitude)

    def known_at(self, t: float) -> bool:
        """Return True if no later message can change the state at `t`."""
        return self._session.navigation.is_known(t + self._latency_s)


class SimulatorTruth:
    """The truth by the vehicle's simulator. Remembers its last seconds, and makes the session request it.

    ArduPilot's simulator has SIM_STATE (its older SIMSTATE has no altitude), PX4's HIL_STATE_QUATERNION. Neither has a
    usable time stamp: a message gets the vehicle's time at its arrival, which is some milliseconds late. `refused`: the
    number of values that are no valid pose. https://mavlink.io/en/messages/common.html
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.track = PoseTrack()
        self.refused = 0
        self._asked: int | None = None
        self._reboots = 0
        self._newest = -math.inf

    def observe(self, received: Received, now: float) -> list[Event]:
        """Use what the session received at `now`."""
        session = self._session
        vehicle, reboots = session.vehicle, session.navigation.reboots
        wanted = _ASKED.get(vehicle.autopilot) if vehicle else None
        if wanted is not None and wanted != self._asked:  # also if another autopilot has replaced the first one
            self._asked = wanted
            session.streams.want({wanted: session.streams.rate_hz})
        if reboots != self._reboots:
            self._reboots, self._newest, self.track = reboots, -math.inf, PoseTrack()
        for msgid, message in received.messages(_READERS):
            self._take(message, _READERS[msgid], now)
        return []

    def at(self, t: float, frame: LocalFrame, reported: VehicleState | None) -> VehicleState | None:
        """Return the true state at `t` in the NED frame `frame`."""
        return self.track.at(self._session.navigation.clock.boot(t), frame)

    def known_at(self, t: float) -> bool:
        """Return True if no later message can change the state at `t`."""
        return self.track.is_known(self._session.navigation.clock.boot(t))

    def lacking(self) -> NoPose | None:
        """Return the reason why there is no true state; None if the vehicle reports no state."""
        if self._session.navigation.track.newest is None:
            return None
        return NoPose("no truth", message=dialect.mavlink_map[self._asked].msgname if self._asked else "")

    def _take(self, message: Any, read: Callable[[Any, float], _Pose], now: float) -> None:
        boot = self._session.navigation.clock.boot(now)
        if boot is None:
            return
        stamp = max(boot, self._newest + _LATER_S)
        position, attitude = read(message, stamp)
        if not _is_pose(position, attitude):
            self.refused += 1
            return
        self._newest = stamp
        self.track.positions.add(position)
        self.track.attitudes.add(attitude)


def _sim_state(m: Any, boot: float) -> _Pose:
    """Return the pose in a SIM_STATE. Its `lat` and `lon` are not used: they are floats, which is too coarse."""
    position = PositionSample(boot, m.lat_int * 1e-7, m.lon_int * 1e-7, m.alt, (m.vn, m.ve, m.vd))
    return position, AttitudeSample(boot, (m.q1, m.q2, m.q3, m.q4), (m.xgyro, m.ygyro, m.zgyro))


def _hil_state_quaternion(m: Any, boot: float) -> _Pose:
    """Return the pose in a HIL_STATE_QUATERNION. The sign of the quaternion has no meaning."""
    velocity = m.vx * 1e-2, m.vy * 1e-2, m.vz * 1e-2
    position = PositionSample(boot, m.lat * 1e-7, m.lon * 1e-7, m.alt * 1e-3, velocity)
    return position, AttitudeSample(boot, tuple(m.attitude_quaternion), (m.rollspeed, m.pitchspeed, m.yawspeed))


_READERS: Final[dict[int, Callable[[Any, float], _Pose]]] = {
    dialect.MAVLINK_MSG_ID_SIM_STATE: _sim_state,
    dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: _hil_state_quaternion,
}


def _is_pose(position: PositionSample, attitude: AttitudeSample) -> bool:
    """Return True if all values are valid. Comparisons with NaN are false."""
    _, lat, lon, alt, velocity = position
    somewhere = (lat, lon) != (0, 0) and is_place((lat, lon, alt)) and math.hypot(*velocity) < _FASTEST
    return somewhere and 0.9 < math.hypot(*attitude.angles) < 1.1 and math.hypot(*attitude.rates) < _FASTEST


def latency_s(scenario: Scenario) -> float:
    """Return the age [s] of the vehicle's reports according to the scenario."""
    return scenario.navigation_error.latency_s if scenario.navigation_error else 0.0


def true_state(scenario: Scenario, session: Session, start: float) -> ReportWithError | SimulatorTruth | None:
    """Return the true state according to the scenario; None if it is the reported state. `start`: of the run."""
    if scenario.pose == "truth":
        return SimulatorTruth(session)
    error = scenario.navigation_error
    return ReportWithError(error, scenario.seed, session, start) if error else None
