"""What the built-in vehicle has of ArduCopter: failsafes by name, with their texts and modes; some parameters.

https://ardupilot.org/copter/docs/failsafe-landing-page.html
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

from arva_hil.mavlink.codec import dialect
from arva_hil.simulated.autopilot import Mode


class Failsafe(NamedTuple):
    """The STATUSTEXT of the vehicle, and its mode afterwards if it is armed. `empty`: its battery is empty."""

    severity: int
    text: bytes
    mode: Mode
    empty: bool = False


FAILSAFES: Final = {
    "geofence": Failsafe(dialect.MAV_SEVERITY_NOTICE, b"Circle fence breached", Mode.RTL),
    "battery": Failsafe(dialect.MAV_SEVERITY_WARNING, b"Battery 1 is low 14.00V used 4000 mAh", Mode.RTL, empty=True),
    "ekf": Failsafe(dialect.MAV_SEVERITY_CRITICAL, b"EKF Failsafe: changed to LAND Mode", Mode.LAND),
    "radio": Failsafe(dialect.MAV_SEVERITY_WARNING, b"Radio Failsafe - RTL", Mode.RTL),
}

_VALUES: Final = {"FS_THR_ENABLE": 1, "FS_GCS_ENABLE": 0, "FS_OPTIONS": 16, "GUID_TIMEOUT": 3, "RCMAP_THROTTLE": 3}
_NAMES: Final = list(_VALUES)


def values_requested(message: Any) -> list[Any]:
    """The answers to a PARAM_REQUEST_LIST, or to a PARAM_REQUEST_READ by name or index; none if it does not exist."""
    if type(message).id == dialect.MAVLINK_MSG_ID_PARAM_REQUEST_LIST:
        return [_value(index) for index in range(len(_NAMES))]
    if message.param_index == -1 and message.param_id in _VALUES:
        return [_value(_NAMES.index(message.param_id))]
    return [_value(message.param_index)] if 0 <= message.param_index < len(_NAMES) else []


def _value(index: int) -> Any:
    name, kind = _NAMES[index], dialect.MAV_PARAM_TYPE_REAL32
    return dialect.MAVLink_param_value_message(name.encode(), _VALUES[name], kind, len(_NAMES), index)
