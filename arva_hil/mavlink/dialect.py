"""pymavlink's dialect with the one message that it lacks: CURRENT_MODE, by which PX4 says each change of its mode.

https://mavlink.io/en/messages/common.html#CURRENT_MODE
"""

from __future__ import annotations

import struct
from typing import Any, ClassVar, Final, cast

from pymavlink.dialects.v20 import ardupilotmega

MAVLINK_MSG_ID_CURRENT_MODE: Final = 436


class CurrentMode(ardupilotmega.MAVLink_message):  # type: ignore[misc]
    """What a vehicle's mode is, and which one is meant; shaped as pymavlink's own classes are."""

    id = MAVLINK_MSG_ID_CURRENT_MODE
    msgname = name = "CURRENT_MODE"
    fieldnames: ClassVar[list[str]] = ["standard_mode", "custom_mode", "intended_custom_mode"]
    ordered_fieldnames: ClassVar[list[str]] = ["custom_mode", "intended_custom_mode", "standard_mode"]
    fieldtypes: ClassVar[list[str]] = ["uint8_t", "uint32_t", "uint32_t"]
    fielddisplays_by_name: ClassVar[dict[str, str]] = {}
    fieldenums_by_name: ClassVar[dict[str, str]] = {}
    fieldunits_by_name: ClassVar[dict[str, str]] = {}
    native_format: ClassVar[bytearray] = bytearray(b"<IIB")
    orders: ClassVar[list[int]] = [2, 0, 1]
    lengths: ClassVar[list[int]] = [1, 1, 1]
    array_lengths: ClassVar[list[int]] = [0, 0, 0]
    crc_extra = 193
    unpacker = struct.Struct("<IIB")
    instance_field = None
    instance_offset = -1

    def __init__(self, standard_mode: int, custom_mode: int, intended_custom_mode: int) -> None:
        super().__init__(self.id, self.msgname)
        self._fieldnames = self.fieldnames
        self._instance_field = self.instance_field
        self._instance_offset = self.instance_offset
        self.standard_mode = standard_mode
        self.custom_mode = custom_mode
        self.intended_custom_mode = intended_custom_mode

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        payload = self.unpacker.pack(self.custom_mode, self.intended_custom_mode, self.standard_mode)
        return cast(bytes, self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1))


ardupilotmega.mavlink_map.setdefault(MAVLINK_MSG_ID_CURRENT_MODE, CurrentMode)
