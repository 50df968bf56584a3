"""ArduCopter's part of the built-in vehicle: commands for flying, failsafes by name with their texts and modes.

Also some parameters. https://ardupilot.org/copter/docs/failsafe-landing-page.html
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from arva_hil.mavlink.codec import dialect
from arva_hil.simulated.autopilot import Mode, SimulatedAutopilot


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

_FENCE: Final = {
    "FENCE_ENABLE": 0,
    "FENCE_AUTOENABLE": 0,
    "FENCE_TYPE": 7,
    "FENCE_ALT_MAX": 100,
    "FENCE_RADIUS": 150,
    "FENCE_TOTAL": 0,
    "FENCE_ALT_MIN": -10,
}
_VALUES: Final = {
    "FS_THR_ENABLE": 1,
    "FS_THR_VALUE": 975,
    "FS_GCS_ENABLE": 0,
    "FS_OPTIONS": 16,
    "GUID_TIMEOUT": 3,
    "RCMAP_THROTTLE": 3,
    "RSSI_TYPE": 0,
    "RSSI_CHANNEL": 0,
    **_FENCE,
}
_NAMES: Final = list(_VALUES)


def values_requested(message: Any) -> list[Any]:
    """Return the answers to PARAM_REQUEST_LIST, or PARAM_REQUEST_READ by name or index; none if there are none."""
    if type(message).id == dialect.MAVLINK_MSG_ID_PARAM_REQUEST_LIST:
        return [_value(index) for index in range(len(_NAMES))]
    if message.param_index == -1 and message.param_id in _VALUES:
        return [_value(_NAMES.index(message.param_id))]
    return [_value(message.param_index)] if 0 <= message.param_index < len(_NAMES) else []


def _value(index: int) -> Any:
    name, kind = _NAMES[index], dialect.MAV_PARAM_TYPE_REAL32
    return dialect.MAVLink_param_value_message(name.encode(), _VALUES[name], kind, len(_NAMES), index)


Params = tuple[float, ...]  # of a command, seven

ACCEPTED: Final[int] = dialect.MAV_RESULT_ACCEPTED
DENIED: Final[int] = dialect.MAV_RESULT_DENIED
UNSUPPORTED: Final[int] = dialect.MAV_RESULT_UNSUPPORTED
FAILED: Final[int] = dialect.MAV_RESULT_FAILED
_BY_FORCE: Final = 21196  # MAV_CMD_COMPONENT_ARM_DISARM, param 2


def integer(value: float) -> int:
    """Return a parameter as an integer; -2, which is never valid, for NaN and infinity."""
    return int(value) if math.isfinite(value) else -2


def set_mode(pilot: SimulatedAutopilot, params: Params, _: int) -> int:
    """Set the mode. The first two parameters are `base_mode` and `custom_mode`."""
    if not integer(params[0]) & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        return DENIED
    return ACCEPTED if pilot.set_mode(integer(params[1])) else FAILED


def _arm(pilot: SimulatedAutopilot, params: Params, _: int) -> int:
    if (wanted := integer(params[0])) not in (0, 1):
        return DENIED
    by_force = integer(params[1]) == _BY_FORCE
    done = pilot.arm() if wanted else pilot.disarm(by_force)
    return ACCEPTED if done else FAILED


def _take_off(pilot: SimulatedAutopilot, params: Params, frame: int) -> int:
    if frame not in (dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT):
        return DENIED
    return ACCEPTED if pilot.take_off(params[6]) else FAILED


def _land(pilot: SimulatedAutopilot, _: Params, __: int) -> int:
    return ACCEPTED if pilot.set_mode(Mode.LAND) else FAILED


# MAV_CMD → (pilot, its parameters, the MAV_FRAME of its place) → MAV_RESULT
ORDERS: Final[dict[int, Callable[[SimulatedAutopilot, Params, int], int]]] = {
    dialect.MAV_CMD_COMPONENT_ARM_DISARM: _arm,
    dialect.MAV_CMD_DO_SET_MODE: set_mode,
    dialect.MAV_CMD_NAV_TAKEOFF: _take_off,
    dialect.MAV_CMD_NAV_LAND: _land,
}
