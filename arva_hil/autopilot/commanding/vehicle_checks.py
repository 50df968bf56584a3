"""Questions to a vehicle before a search: the parameters of its failsafes and fence, and whether it is simulated.

The failsafes determine what the vehicle does after the last set-point. With default parameters the vehicle hovers,
armed.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from arva_hil.autopilot.following.discovery import Vehicle
from arva_hil.autopilot.following.navigation import offset_m
from arva_hil.autopilot.following.session import Received, Session
from arva_hil.events.searches import Doubt
from arva_hil.mavlink.codec import command, dialect

_AGAIN_S: Final = 0.5
_TRIES: Final = 4
_ARDUPILOT: Final = (
    *("FS_THR_ENABLE", "FS_THR_VALUE", "FS_GCS_ENABLE", "FS_OPTIONS", "GUID_TIMEOUT", "RCMAP_THROTTLE"),
    *("RSSI_TYPE", "RSSI_CHANNEL"),
)
_PX4: Final = (
    *("COM_OBL_RC_ACT", "COM_OF_LOSS_T", "NAV_RCL_ACT", "NAV_DLL_ACT", "COM_RC_OVERRIDE"),
    "RC_RSSI_PWM_CHAN",
)
_BY_CHANNEL: Final = 2  # RSSI_TYPE: the quality of the radio is the pulse of a channel
_FENCE: Final = {  # by: the autopilot is PX4
    False: (
        *("FENCE_ENABLE", "FENCE_AUTOENABLE", "FENCE_TYPE"),
        *("FENCE_ALT_MAX", "FENCE_RADIUS", "FENCE_TOTAL", "FENCE_ALT_MIN"),
    ),
    True: ("GF_ACTION", "GF_MAX_HOR_DIST", "GF_MAX_VER_DIST"),
}
_HEIGHT, _CIRCLE, _POLYGONS, _LOWEST = 1, 2, 4, 8  # bits of FENCE_TYPE
_SET_POINTS_S: Final = {"GUID_TIMEOUT": (0.5, 5.0), "COM_OF_LOSS_T": (0.5, 5.0)}  # set-points come every 0.2 s
_IN_AUTO: Final = 1  # of COM_RC_OVERRIDE: in the auto modes PX4 follows a stick that moves
_INTEGERS: Final = {  # MAV_PARAM_TYPE → struct: PX4 copies the bytes of an integer into the float
    dialect.MAV_PARAM_TYPE_UINT8: "<Bxxx",
    dialect.MAV_PARAM_TYPE_INT8: "<bxxx",
    dialect.MAV_PARAM_TYPE_UINT16: "<Hxx",
    dialect.MAV_PARAM_TYPE_INT16: "<hxx",
    dialect.MAV_PARAM_TYPE_UINT32: "<I",
    dialect.MAV_PARAM_TYPE_INT32: "<i",
}


class Failsafes:
    """Remembers the answers of one vehicle. `values`: value by parameter, as far as known; `px4`: it is a PX4.

    `reported`: a person knows them.
    """

    def __init__(self) -> None:
        self.values: dict[str, float] = {}
        self.px4 = self.reported = False
        self._names: tuple[str, ...] = ()
        self._tries = 0
        self._next = -math.inf

    def poll(self, now: float, vehicle: Vehicle) -> list[Any]:
        """Return the requests to send now."""
        self.px4 = vehicle.autopilot == dialect.MAV_AUTOPILOT_PX4
        self._names = (_PX4 if self.px4 else _ARDUPILOT) + _FENCE[self.px4]
        if now < self._next:
            return []
        self._next = now + _AGAIN_S
        if self.done:
            return []
        self._tries += 1
        to = vehicle.system, vehicle.component
        lacking = [name for name in self._names if name not in self.values] if self._tries <= _TRIES else []
        return [dialect.MAVLink_param_request_read_message(*to, name.encode(), -1) for name in lacking]

    def on_parameter(self, message: Any) -> None:
        """Use a PARAM_VALUE of the vehicle."""
        layout = _INTEGERS.get(message.param_type) if self.px4 else None
        raw = struct.pack("<f", message.param_value)
        value = struct.unpack(layout, raw)[0] if layout else message.param_value
        if message.param_id in self._names and math.isfinite(value):
            self.values[message.param_id] = value

    @property
    def done(self) -> bool:
        """True if all parameters are known, or were requested often enough."""
        return self._tries > _TRIES or (bool(self._names) and all(name in self.values for name in self._names))

    def doubts(self) -> list[tuple[str, float | None, Doubt]]:
        """Return the parameters that break a promise of the search: name, value (None: not reported), and how."""
        found: list[tuple[str, float | None, Doubt]] = []
        for name, (low, high) in _SET_POINTS_S.items():
            value = self.values.get(name, low)
            if not low <= value <= high:
                found.append((name, value, "flies on" if value > high else "set-points too rare"))
        sticks = self.values.get("COM_RC_OVERRIDE")
        if self.px4 and not int(sticks or 0) & _IN_AUTO:
            found.append(("COM_RC_OVERRIDE", sticks, "sticks ignored"))
        return found


def quality_channel(values: Mapping[str, float]) -> int:
    """Return the channel with the quality of the radio by the parameters that the autopilot reported; 0: none."""
    ardupilot = values.get("RSSI_CHANNEL", 0) if values.get("RSSI_TYPE") == _BY_CHANNEL else 0
    return int(values.get("RC_RSSI_PWM_CHAN", ardupilot))


class FenceLimit(NamedTuple):
    """One limit of a fence: its parameter, and the value [m]."""

    parameter: str
    metres: float


class Fence(NamedTuple):
    """The limits of a fence, None where there is none."""

    radius: FenceLimit | None = None
    """Horizontally, from home."""
    height: FenceLimit | None = None
    """Above home."""
    points: int = 0
    """The number of the points of polygons and other circles, whose places are not known."""
    lowest: FenceLimit | None = None
    """The least height above home."""


def fence_of(values: Mapping[str, float], *, px4: bool) -> Fence:
    """Return the fence by the parameters that the autopilot reported."""
    if px4:
        on = int(values.get("GF_ACTION", 0))
        return Fence(_limit(values, "GF_MAX_HOR_DIST", on), _limit(values, "GF_MAX_VER_DIST", on))
    on = int(values.get("FENCE_ENABLE") or values.get("FENCE_AUTOENABLE") or 0)  # the latter: from arming or later on
    kinds = int(values.get("FENCE_TYPE", 0)) if on else 0
    points = int(values.get("FENCE_TOTAL", 0)) if kinds & _POLYGONS else 0
    circle, height = _limit(values, "FENCE_RADIUS", kinds & _CIRCLE), _limit(values, "FENCE_ALT_MAX", kinds & _HEIGHT)
    return Fence(circle, height, points, _limit(values, "FENCE_ALT_MIN", kinds & _LOWEST))


def _limit(values: Mapping[str, float], name: str, on: int) -> FenceLimit | None:
    metres = values.get(name, 0.0) if on else 0.0
    return FenceLimit(name, metres) if metres > 0 else None


_ASK_S: Final = 1.0
_NEAR_M: Final = 200.0  # horizontal distance from estimate to truth; farther away it is another vehicle
_ASKED: Final = {  # by MAV_AUTOPILOT
    dialect.MAV_AUTOPILOT_ARDUPILOTMEGA: dialect.MAVLINK_MSG_ID_SIMSTATE,
    dialect.MAV_AUTOPILOT_PX4: dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION,
}
_PLACES: Final = {  # the fields of latitude and longitude, degrees · 1e7
    dialect.MAVLINK_MSG_ID_SIMSTATE: ("lat", "lng"),
    dialect.MAVLINK_MSG_ID_SIM_STATE: ("lat_int", "lon_int"),
    dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: ("lat", "lon"),
}


class SimulatorCheck:
    """Requests the true pose of the session's vehicle once a second. `answer`: the message that it answered with.

    ArduPilot's simulator has SIMSTATE, PX4's HIL_STATE_QUATERNION. On a flight controller ArduPilot denies the request,
    and PX4 has nothing to send. Only the vehicle's own packets count, and only a place near its reported position.
    """

    def __init__(self, session: Session) -> None:
        self.answer = ""  # the name of the message
        self._session = session
        self._next = 0.0

    def forget(self) -> None:
        """Forget the answer: it may be another vehicle now."""
        self.answer = ""

    def on_packets(self, received: Received) -> None:
        """Use what the session received."""
        if self.answer:
            return
        for msgid, message in received.messages(_PLACES):
            lat, lon = (getattr(message, name) * 1e-7 for name in _PLACES[msgid])
            if self._is_near(lat, lon):
                self.answer = message.get_type()

    def poll(self, now: float) -> bytes:
        """Return the request, if it is due."""
        vehicle = self._session.vehicle
        if vehicle is None or self.answer or now < self._next or vehicle.autopilot not in _ASKED:
            return b""
        self._next = now + _ASK_S
        ask = command(vehicle.system, vehicle.component, dialect.MAV_CMD_REQUEST_MESSAGE, _ASKED[vehicle.autopilot])
        return self._session.encoder.pack(ask)

    def _is_near(self, lat: float, lon: float) -> bool:
        last = self._session.navigation.track.last_position
        return last is not None and math.hypot(*offset_m(last.place, (lat, lon, last.alt))) < _NEAR_M
