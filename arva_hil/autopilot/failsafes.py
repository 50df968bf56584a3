"""What a vehicle does when nobody orders anything, by its own parameters: asked for before it is armed.

A search that breaks off leaves the vehicle to these. With default parameters it hovers, armed.
"""

from __future__ import annotations

import math
import struct
from typing import Any, Final

from arva_hil.autopilot.finder import Vehicle
from arva_hil.autopilot.mavlink import dialect

_AGAIN_S: Final = 0.5
_TRIES: Final = 4
_ARDUPILOT: Final = ("FS_THR_ENABLE", "FS_GCS_ENABLE", "FS_OPTIONS", "GUID_TIMEOUT", "RCMAP_THROTTLE")
_PX4: Final = ("COM_OBL_RC_ACT", "COM_OF_LOSS_T", "NAV_RCL_ACT", "NAV_DLL_ACT")
_FS: Final = {
    0: "nothing",
    1: "RTL",
    2: "RTL",
    3: "SmartRTL or RTL",
    4: "SmartRTL or LAND",
    5: "LAND",
    6: "the mission's landing or RTL",
    7: "BRAKE or LAND",
}
_FS_THR: Final = _FS | {3: "LAND", 4: "SmartRTL or RTL", 5: "SmartRTL or LAND"}
_IN_GUIDED: Final = 4  # of FS_OPTIONS: without a radio it goes on in GUIDED
_OFFBOARD_LOST: Final = {
    0: "goes to Position mode",
    1: "goes to Altitude mode",
    2: "goes to Stabilized mode",
    3: "returns",
    4: "lands",
    5: "holds",
    6: "terminates",
    7: "disarms",
}
_PX4_LOST: Final = {0: "nothing", 1: "Hold", 2: "Return", 3: "Land", 5: "termination", 6: "disarming"}
_INTEGERS: Final = {  # MAV_PARAM_TYPE → struct: PX4 copies the bytes of an integer into the float
    dialect.MAV_PARAM_TYPE_UINT8: "<Bxxx",
    dialect.MAV_PARAM_TYPE_INT8: "<bxxx",
    dialect.MAV_PARAM_TYPE_UINT16: "<Hxx",
    dialect.MAV_PARAM_TYPE_INT16: "<hxx",
    dialect.MAV_PARAM_TYPE_UINT32: "<I",
    dialect.MAV_PARAM_TYPE_INT32: "<i",
}


class Failsafes:
    """Remembers what one vehicle answered. `values`: parameter → value, of those that it told."""

    def __init__(self) -> None:
        self.values: dict[str, float] = {}
        self._px4 = False
        self._names: tuple[str, ...] = ()
        self._tries = 0
        self._next = -math.inf

    def poll(self, now: float, vehicle: Vehicle) -> list[Any]:
        """What to ask it now."""
        self._px4 = vehicle.autopilot == dialect.MAV_AUTOPILOT_PX4
        self._names = _PX4 if self._px4 else _ARDUPILOT
        if now < self._next or self.done:
            return []
        self._next = now + _AGAIN_S
        self._tries += 1
        to = vehicle.system, vehicle.component
        lacking = [name for name in self._names if name not in self.values] if self._tries <= _TRIES else []
        return [dialect.MAVLink_param_request_read_message(*to, name.encode(), -1) for name in lacking]

    def hear(self, message: Any) -> None:
        """A PARAM_VALUE of the vehicle."""
        layout = _INTEGERS.get(message.param_type) if self._px4 else None
        raw = struct.pack("<f", message.param_value)
        value = struct.unpack(layout, raw)[0] if layout else message.param_value
        if message.param_id in self._names and math.isfinite(value):
            self.values[message.param_id] = value

    @property
    def done(self) -> bool:
        """All is answered, or has been asked for often enough."""
        return self._tries > _TRIES or (bool(self._names) and all(name in self.values for name in self._names))

    @property
    def left_alone(self) -> str:
        """What it does in the mode that follows set-points when none come, for a person."""
        if not self._px4:
            return f"it stops{self._after('GUID_TIMEOUT', 's')}, and hovers in GUIDED, armed, until somebody takes it"
        act = self._word("COM_OBL_RC_ACT", _OFFBOARD_LOST)
        after = self._after("COM_OF_LOSS_T", "s")
        return f"it {act}{after}" if act else f"what it does is unknown{after}: it did not tell COM_OBL_RC_ACT"

    def __str__(self) -> str:
        """All of it, for a person."""
        radio, station, table = ("NAV_RCL_ACT", "NAV_DLL_ACT", _PX4_LOST) if self._px4 else (*_ARDUPILOT[:2], _FS)
        without = self._word(radio, table if self._px4 else _FS_THR) or f"unknown ({radio})"
        if int(self.values.get("FS_OPTIONS", 0)) & _IN_GUIDED:
            without = f"nothing in GUIDED (FS_OPTIONS {self.values['FS_OPTIONS']:g})"
        ground = self._word(station, table) or f"unknown ({station})"
        alone = f"left alone by the search, {self.left_alone}"
        return f"{alone}; without a radio: {without}; without a ground station: {ground}"

    def _word(self, name: str, words: dict[int, str]) -> str:
        """What a value means, and the parameter; "" when it is not known."""
        value = self.values.get(name)
        if value is None:
            return ""
        return f"{words.get(int(value), 'does what that means')} ({name} {value:g})"

    def _after(self, name: str, unit: str) -> str:
        value = self.values.get(name)
        return f" after an unknown time ({name})" if value is None else f" after {value:g} {unit} ({name})"
