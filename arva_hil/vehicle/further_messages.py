"""What a vehicle sends on request besides its pose: the true pose of a simulated one, the load of its motors.

ArduPilot's simulator has SIM_STATE (its older SIMSTATE has no altitude), PX4's HIL_STATE_QUATERNION; neither has a
usable time stamp. https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from arva_hil.mavlink.codec import dialect
from arva_hil.vehicle.pose_track import AttitudeSample, PoseTrack, PositionSample
from arva_hil.vehicle.reasons import NoPose
from arva_hil.vehicle.session import Session

Vector = tuple[float, float, float]

_LATER_S: Final = 1e-6  # between messages of one chunk, to keep their order
_ALTITUDES_M: Final = (-1_000.0, 100_000.0)
_FASTEST: Final = 1_000.0  # m/s, and rad/s
_ASKED: Final = {  # by MAV_AUTOPILOT
    dialect.MAV_AUTOPILOT_ARDUPILOTMEGA: dialect.MAVLINK_MSG_ID_SIM_STATE,
    dialect.MAV_AUTOPILOT_PX4: dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION,
}


class _Told(NamedTuple):
    """Degrees, degrees, metres AMSL; NED, m/s; body FRD → NED (w, x, y, z); about the body axes, rad/s."""

    place: Vector
    velocity: Vector
    quaternion: tuple[float, float, float, float]
    rates: Vector


class SimulatorTruth:
    """Remembers the last seconds of the true pose of the session's vehicle, and makes the session request it.

    A message gets the vehicle's time at its arrival, which is some milliseconds late. `refused`: the number of values
    that are no valid pose.
    """

    def __init__(self, session: Session) -> None:
        self.track = PoseTrack()
        self.refused = 0
        self._session = session
        self._asked: int | None = None
        self._reboots = 0
        self._newest = -math.inf

    def hear(self, now: float) -> None:
        """Use the packets that the session was fed last."""
        session = self._session
        vehicle, reboots = session.vehicle, session.navigation.reboots
        if self._asked is None and vehicle is not None and vehicle.autopilot in _ASKED:
            self._asked = _ASKED[vehicle.autopilot]
            session.want({self._asked: session.rate_hz})
        if reboots != self._reboots:
            self._reboots, self._newest, self.track = reboots, -math.inf, PoseTrack()
        for packet in session.own:
            if packet.msgid in _READERS and (message := session.parser.decode(packet)) is not None:
                self._take(_READERS[packet.msgid](message), now)

    def lacking(self) -> NoPose:
        """Why there is no true pose."""
        return NoPose("no truth", message=dialect.mavlink_map[self._asked].msgname if self._asked else "")

    def _take(self, told: _Told, now: float) -> None:
        boot = self._session.clock.boot(now)
        if boot is None:
            return
        if not _is_pose(told):
            self.refused += 1
            return
        self._newest = stamp = max(boot, self._newest + _LATER_S)
        self.track.add_position(PositionSample(stamp, *told.place, told.velocity))
        self.track.add_attitude(AttitudeSample(stamp, told.quaternion, told.rates))


def _sim_state(m: Any) -> _Told:
    """The pose in a SIM_STATE. Its `lat` and `lon` are not used: they are floats, which is too coarse."""
    place = m.lat_int * 1e-7, m.lon_int * 1e-7, m.alt
    return _Told(place, (m.vn, m.ve, m.vd), (m.q1, m.q2, m.q3, m.q4), (m.xgyro, m.ygyro, m.zgyro))


def _hil_state_quaternion(m: Any) -> _Told:
    """The pose in a HIL_STATE_QUATERNION. The sign of the quaternion has no meaning."""
    velocity = m.vx * 1e-2, m.vy * 1e-2, m.vz * 1e-2
    w, x, y, z = m.attitude_quaternion
    place = m.lat * 1e-7, m.lon * 1e-7, m.alt * 1e-3
    return _Told(place, velocity, (w, x, y, z), (m.rollspeed, m.pitchspeed, m.yawspeed))


_READERS: Final[dict[int, Callable[[Any], _Told]]] = {
    dialect.MAVLINK_MSG_ID_SIM_STATE: _sim_state,
    dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: _hil_state_quaternion,
}


def _is_pose(told: _Told) -> bool:
    """Whether all values are valid. Comparisons with NaN are false."""
    lat, lon, alt = told.place
    somewhere = (lat, lon) != (0, 0) and abs(lat) <= 90 and abs(lon) <= 180
    possible = _ALTITUDES_M[0] <= alt <= _ALTITUDES_M[1] and 0.9 < math.hypot(*told.quaternion) < 1.1
    return somewhere and possible and math.hypot(*told.velocity) < _FASTEST and math.hypot(*told.rates) < _FASTEST


_VFR_HUD: Final = dialect.MAVLINK_MSG_ID_VFR_HUD
_SERVO_OUTPUT_RAW: Final = dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW
_ASKED_HZ: Final = 4.0
_LOWEST_US, _HIGHEST_US = 1000, 2000


class MotorLoad:
    """Remembers the load of a session's vehicle, 0…1: its throttle in VFR_HUD, or else the mean of the first four
    outputs in SERVO_OUTPUT_RAW. Asks for VFR_HUD; 0 before either comes.
    """

    def __init__(self, session: Session) -> None:
        self.load = 0.0
        self._session = session
        self._has_throttle = False
        session.want({_VFR_HUD: _ASKED_HZ})

    def hear(self) -> None:
        """The session has been fed."""
        for packet in self._session.own:
            if packet.msgid == _VFR_HUD and (message := self._session.parser.decode(packet)) is not None:
                self._has_throttle = True
                self.load = min(1.0, message.throttle / 100)
            elif packet.msgid == _SERVO_OUTPUT_RAW and not self._has_throttle:
                self._take_outputs(self._session.parser.decode(packet))

    def _take_outputs(self, message: object) -> None:
        if message is None or getattr(message, "port", 0) != 0:
            return
        pulses = [getattr(message, f"servo{n}_raw") for n in range(1, 5)]
        shares = [(us - _LOWEST_US) / (_HIGHEST_US - _LOWEST_US) for us in pulses if us]
        if shares:
            self.load = max(0.0, min(1.0, sum(shares) / len(shares)))
