"""pymavlink's dialect with the message CURRENT_MODE, which it lacks; the layout of messages in their packets.

https://mavlink.io/en/messages/common.html#CURRENT_MODE
"""

from __future__ import annotations

import functools
import itertools
import struct
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Final, cast

from fastcrc import crc16
from pymavlink.dialects.v20 import ardupilotmega

MAVLINK_MSG_ID_CURRENT_MODE: Final = 436


class CurrentMode(ardupilotmega.MAVLink_message):  # type: ignore[misc]
    """A vehicle's present and intended mode. The class has the form of pymavlink's own."""

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


_BYTES: Final = {"char": 1, "float": 4, "double": 8} | {
    f"{u}int{n}_t": n // 8 for u in ("", "u") for n in (8, 16, 32, 64)
}


@functools.cache
def length_v1(msgid: int) -> int:
    """Bytes of a message's payload without extension fields, which are not part of its CRC_EXTRA.

    https://mavlink.io/en/guide/serialization.html#crc_extra
    """
    kind = ardupilotmega.mavlink_map[msgid]
    types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
    crc, size, whole = crc16.mcrf4xx(f"{kind.msgname} ".encode()), 0, 0
    for name, length in zip(kind.ordered_fieldnames, kind.array_lengths, strict=True):
        crc = crc16.mcrf4xx(f"{types[name]} {name} ".encode() + bytes([length] if length else []), crc)
        size += _BYTES[types[name]] * (length or 1)
        if (crc & 0xFF) ^ (crc >> 8) == kind.crc_extra:
            whole = size
    return whole


@functools.cache
def message_maker(msgid: int) -> tuple[Callable[[Sequence[Any]], Any], Any] | None:
    """A function that makes a message of pymavlink's class from the numbers of its payload, and the struct to unpack
    them. None for a message with text.

    The class's own constructor takes five times as long, because it makes a header and ten more values that are not
    used. Here all messages of a class share them. The code is generated from pymavlink's table, like a namedtuple's.
    """
    kind = ardupilotmega.mavlink_map[msgid]
    if "char" in kind.fieldtypes:
        return None
    shared = {
        **vars(ardupilotmega.MAVLink_message(msgid, kind.msgname)),
        "_fieldnames": kind.fieldnames,
        "_instance_field": kind.instance_field,
        "_instance_offset": kind.instance_offset,
    }
    names: dict[str, Any] = {"new": object.__new__, "kind": type(kind.__name__, (kind,), shared)}
    spans = zip(itertools.accumulate(kind.lengths), kind.lengths, strict=True)
    parts = [f"list(v[{end - n}:{end}])" if n > 1 else f"v[{end - 1}]" for end, n in spans]
    fields = [f"m.{name}" for name in kind.ordered_fieldnames]
    lines = [f" {field} = {part}" for field, part in zip(fields, parts, strict=True)]
    if max(kind.lengths) == 1:
        lines = [f" {', '.join(fields)}, = v"]  # all at once
    exec("\n".join(["def make(v):", " m = new(kind)", *lines, " return m"]), names)
    return names["make"], kind.unpacker


@functools.cache
def payload_writer(msgid: int) -> Callable[[Any], bytes] | None:
    """A function that encodes the complete payload of a message with several numbers; None for other messages.

    It raises struct.error for a number that does not fit, and for an array that is too short.
    """
    kind = ardupilotmega.mavlink_map[msgid]
    if "char" in kind.fieldtypes or len(kind.fieldnames) < 2:
        return None
    fields = zip(kind.ordered_fieldnames, kind.lengths, strict=True)
    values = ", ".join(f"*m.{name}[:{n}]" if n > 1 else f"m.{name}" for name, n in fields)
    write: Callable[[Any], bytes] = eval(f"lambda m: pack({values})", {"pack": kind.unpacker.pack})
    return write
