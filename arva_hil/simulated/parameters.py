"""The parameters of the built-in vehicle: some of ArduCopter's, with their default values."""

from __future__ import annotations

from typing import Any, Final

from arva_hil.mavlink.codec import dialect

Message = Any  # pymavlink's generated classes carry no types

_VALUES: Final = {"FS_THR_ENABLE": 1, "FS_GCS_ENABLE": 0, "FS_OPTIONS": 16, "GUID_TIMEOUT": 3, "RCMAP_THROTTLE": 3}
_NAMES: Final = list(_VALUES)


def values_requested(message: Message) -> list[Message]:
    """The answers to a PARAM_REQUEST_LIST, or to a PARAM_REQUEST_READ by name or index; none if it does not exist."""
    if type(message).id == dialect.MAVLINK_MSG_ID_PARAM_REQUEST_LIST:
        return [_value(index) for index in range(len(_NAMES))]
    if message.param_index == -1 and message.param_id in _VALUES:
        return [_value(_NAMES.index(message.param_id))]
    return [_value(message.param_index)] if 0 <= message.param_index < len(_NAMES) else []


def _value(index: int) -> Message:
    name, kind = _NAMES[index], dialect.MAV_PARAM_TYPE_REAL32
    return dialect.MAVLink_param_value_message(name.encode(), _VALUES[name], kind, len(_NAMES), index)
