"""The parameters of a vehicle's failsafes, which are read before it is armed.

They say what the vehicle does if a search ends without orders. With default parameters it hovers, armed.
"""

from __future__ import annotations

import math
import struct
from typing import Any, Final

from arva_hil.mavlink.codec import dialect
from arva_hil.vehicle.discovery import Vehicle

_AGAIN_S: Final = 0.5
_TRIES: Final = 4
_ARDUPILOT: Final = ("FS_THR_ENABLE", "FS_GCS_ENABLE", "FS_OPTIONS", "GUID_TIMEOUT", "RCMAP_THROTTLE")
_PX4: Final = ("COM_OBL_RC_ACT", "COM_OF_LOSS_T", "NAV_RCL_ACT", "NAV_DLL_ACT")
_INTEGERS: Final = {  # MAV_PARAM_TYPE → struct: PX4 copies the bytes of an integer into the float
    dialect.MAV_PARAM_TYPE_UINT8: "<Bxxx",
    dialect.MAV_PARAM_TYPE_INT8: "<bxxx",
    dialect.MAV_PARAM_TYPE_UINT16: "<Hxx",
    dialect.MAV_PARAM_TYPE_INT16: "<hxx",
    dialect.MAV_PARAM_TYPE_UINT32: "<I",
    dialect.MAV_PARAM_TYPE_INT32: "<i",
}


class Failsafes:
    """Remembers the answers of one vehicle. `values`: value by parameter, as far as known; `px4`: it is a PX4."""

    def __init__(self) -> None:
        self.values: dict[str, float] = {}
        self.px4 = False
        self._names: tuple[str, ...] = ()
        self._tries = 0
        self._next = -math.inf

    def poll(self, now: float, vehicle: Vehicle) -> list[Any]:
        """The requests to send now."""
        self.px4 = vehicle.autopilot == dialect.MAV_AUTOPILOT_PX4
        self._names = _PX4 if self.px4 else _ARDUPILOT
        if now < self._next:
            return []
        self._next = now + _AGAIN_S
        if self.done:
            return []
        self._tries += 1
        to = vehicle.system, vehicle.component
        lacking = [name for name in self._names if name not in self.values] if self._tries <= _TRIES else []
        return [dialect.MAVLink_param_request_read_message(*to, name.encode(), -1) for name in lacking]

    def hear(self, message: Any) -> None:
        """The vehicle sent a PARAM_VALUE."""
        layout = _INTEGERS.get(message.param_type) if self.px4 else None
        raw = struct.pack("<f", message.param_value)
        value = struct.unpack(layout, raw)[0] if layout else message.param_value
        if message.param_id in self._names and math.isfinite(value):
            self.values[message.param_id] = value

    @property
    def done(self) -> bool:
        """Whether all parameters are known, or were requested often enough."""
        return self._tries > _TRIES or (bool(self._names) and all(name in self.values for name in self._names))
