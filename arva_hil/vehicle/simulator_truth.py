"""What a simulated vehicle sends on request: its true pose.

ArduPilot's simulator has SIM_STATE (its older SIMSTATE has no altitude), PX4's HIL_STATE_QUATERNION; neither has a
usable time stamp. https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from arva_hil.mavlink.codec import dialect
from arva_hil.vehicle.navigation import is_place
from arva_hil.vehicle.pose_track import AttitudeSample, PoseTrack, PositionSample
from arva_hil.vehicle.reasons import NoPose
from arva_hil.vehicle.session import Session

_Pose = tuple[PositionSample, AttitudeSample]

_LATER_S: Final = 1e-6  # between messages of one chunk, to keep their order
_FASTEST: Final = 1_000.0  # m/s, and rad/s
_ASKED: Final = {  # by MAV_AUTOPILOT
    dialect.MAV_AUTOPILOT_ARDUPILOTMEGA: dialect.MAVLINK_MSG_ID_SIM_STATE,
    dialect.MAV_AUTOPILOT_PX4: dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION,
}


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
        for msgid, message in session.messages(_READERS):
            self._take(message, _READERS[msgid], now)

    def lacking(self) -> NoPose:
        """Why there is no true pose."""
        return NoPose("no truth", message=dialect.mavlink_map[self._asked].msgname if self._asked else "")

    def _take(self, message: Any, read: Callable[[Any, float], _Pose], now: float) -> None:
        boot = self._session.clock.boot(now)
        if boot is None:
            return
        stamp = max(boot, self._newest + _LATER_S)
        position, attitude = read(message, stamp)
        if not _is_pose(position, attitude):
            self.refused += 1
            return
        self._newest = stamp
        self.track.add_position(position)
        self.track.add_attitude(attitude)


def _sim_state(m: Any, boot: float) -> _Pose:
    """The pose in a SIM_STATE. Its `lat` and `lon` are not used: they are floats, which is too coarse."""
    position = PositionSample(boot, m.lat_int * 1e-7, m.lon_int * 1e-7, m.alt, (m.vn, m.ve, m.vd))
    return position, AttitudeSample(boot, (m.q1, m.q2, m.q3, m.q4), (m.xgyro, m.ygyro, m.zgyro))


def _hil_state_quaternion(m: Any, boot: float) -> _Pose:
    """The pose in a HIL_STATE_QUATERNION. The sign of the quaternion has no meaning."""
    velocity = m.vx * 1e-2, m.vy * 1e-2, m.vz * 1e-2
    position = PositionSample(boot, m.lat * 1e-7, m.lon * 1e-7, m.alt * 1e-3, velocity)
    return position, AttitudeSample(boot, tuple(m.attitude_quaternion), (m.rollspeed, m.pitchspeed, m.yawspeed))


_READERS: Final[dict[int, Callable[[Any, float], _Pose]]] = {
    dialect.MAVLINK_MSG_ID_SIM_STATE: _sim_state,
    dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: _hil_state_quaternion,
}


def _is_pose(position: PositionSample, attitude: AttitudeSample) -> bool:
    """Whether all values are valid. Comparisons with NaN are false."""
    _, lat, lon, alt, velocity = position
    somewhere = (lat, lon) != (0, 0) and is_place((lat, lon, alt)) and math.hypot(*velocity) < _FASTEST
    return somewhere and 0.9 < math.hypot(*attitude.angles) < 1.1 and math.hypot(*attitude.rates) < _FASTEST
