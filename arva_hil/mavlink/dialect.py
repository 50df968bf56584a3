"""Packets; pymavlink's dialect with CURRENT_MODE and ESC_STATUS, which it lacks; the layout of messages in packets.

https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable
from itertools import chain
from typing import Any, Final, Literal, NamedTuple, cast

from fastcrc import crc16
from pymavlink.dialects.v20 import ardupilotmega

Message = Any  # pymavlink's generated classes carry no types

MAVLINK_MSG_ID_CURRENT_MODE: Final = 436
MAVLINK_MSG_ID_ESC_STATUS: Final = 291

_BYTES: Final = {f"{u}int{8 * n}_t": n for u in ("", "u") for n in (1, 2, 4, 8)} | {"char": 1, "float": 4, "double": 8}
_CODES: Final = {"uint8_t": "B", "uint32_t": "I", "uint64_t": "Q", "int32_t": "i", "float": "f"}


def _lacking(msgid: int, name: str, crc_extra: int, fields: str) -> Any:
    """Return a class of messages, shaped as pymavlink's own are.

    `fields`: "type name" or "type name[length]" of each.
    """
    rows = [(kind, *field.rstrip("]").partition("[")[::2]) for kind, field in map(str.split, fields.split(","))]
    ordered = sorted(rows, key=lambda row: -_BYTES[row[0]])
    names = [field for _, field, _ in rows]

    def init(self: Any, *values: Any) -> None:
        ardupilotmega.MAVLink_message.__init__(self, msgid, name)
        self._fieldnames, self._instance_field, self._instance_offset = names, None, -1
        vars(self).update(zip(names, values, strict=True))

    def pack(self: Any, mav: Any, force_mavlink1: bool = False) -> bytes:
        values = (getattr(self, field) for _, field, _ in ordered)
        numbers = chain.from_iterable(value if isinstance(value, list) else [value] for value in values)
        return cast(bytes, self._pack(mav, crc_extra, self.unpacker.pack(*numbers), force_mavlink1=force_mavlink1))

    body = {"id": msgid, "msgname": name, "name": name, "crc_extra": crc_extra, "__init__": init, "pack": pack}
    body |= {key: {} for key in ("fielddisplays_by_name", "fieldenums_by_name", "fieldunits_by_name")}
    body |= {
        "fieldnames": names,
        "ordered_fieldnames": [field for _, field, _ in ordered],
        "fieldtypes": [kind for kind, _, _ in rows],
        "native_format": bytearray(f"<{''.join(_CODES[kind] for kind, _, _ in ordered)}".encode()),
        "orders": [ordered.index(row) for row in rows],
        "lengths": [int(length or 1) for _, _, length in ordered],
        "array_lengths": [int(length or 0) for _, _, length in ordered],
        "unpacker": struct.Struct("<" + "".join(length + _CODES[kind] for kind, _, length in ordered)),
        "instance_field": None,
        "instance_offset": -1,
    }
    return ardupilotmega.mavlink_map.setdefault(msgid, type(name, (ardupilotmega.MAVLink_message,), body))


CurrentMode: Final = _lacking(
    MAVLINK_MSG_ID_CURRENT_MODE,
    "CURRENT_MODE",
    193,
    "uint8_t standard_mode, uint32_t custom_mode, uint32_t intended_custom_mode",
)
EscStatus: Final = _lacking(
    MAVLINK_MSG_ID_ESC_STATUS,
    "ESC_STATUS",
    10,
    "uint8_t index, uint64_t time_usec, int32_t rpm[4], float voltage[4], float current[4]",
)


def command(system: int, component: int, number: int, *params: float) -> Any:
    """Return the COMMAND_LONG `number` for a component. Missing parameters are 0."""
    message = ardupilotmega.MAVLink_command_long_message
    return message(system, component, number, 0, *params, *[0.0] * (7 - len(params)))


def tunnel(kind: int, payload: bytes, system: int = 0, component: int = 0) -> Any:
    """Return the TUNNEL with a payload of at most 128 bytes, of the type `kind`. Without a target: to all systems."""
    return ardupilotmega.MAVLink_tunnel_message(system, component, kind, len(payload), [*payload.ljust(128, b"\0")])


def untunnel(message: Any) -> bytes:
    """Return the payload of a TUNNEL."""
    return bytes(message.payload[: message.payload_length])


@functools.cache
def length_v1(msgid: int) -> int:
    """Return the number of bytes of a message's payload without extension fields, which are not part of its CRC_EXTRA.

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
def reader_of(msgid: int) -> Callable[[bytes], Message] | None:
    """Return the function that makes a message of a payload; None for a kind of message with text.

    Messages are of a subclass of pymavlink's class. All share one header and ten more values, which pymavlink's
    constructor makes for each message and which are not used: so a message takes half of the time.
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
    made = type(kind.__name__, (kind,), shared)
    names, unpack, size = kind.ordered_fieldnames, kind.unpacker.unpack, kind.unpacker.size
    arrays = [(at, n) for at, n in enumerate(kind.lengths) if n > 1]

    def read(payload: bytes) -> Message:
        whole = payload if len(payload) == size else payload[:size].ljust(size, b"\0")  # zeros at the end are left out
        values = unpack(whole)
        if arrays:
            values = list(values)
            for at, n in arrays:
                values[at : at + n] = [values[at : at + n]]
        message: Message = object.__new__(made)
        message.__dict__ = dict(zip(names, values, strict=True))
        return message

    return read


CRC_EXTRA: Final[dict[int, bytes]] = {k: bytes([m.crc_extra]) for k, m in ardupilotmega.mavlink_map.items()}
Verdict = Literal["", "unsigned", "forged", "replayed"]


class Packet(NamedTuple):
    """One complete packet as it was received. Its checksum is verified if the dialect knows the message id."""

    raw: bytes
    system: int
    component: int
    msgid: int
    refused: Verdict = ""  # the reason why its signature is not valid; "" also on a link without a key

    @property
    def version(self) -> int:
        """Of MAVLink: 1 or 2."""
        return 2 if self.raw[0] == 0xFD else 1

    @property
    def signed(self) -> bool:
        """True if it has a signature."""
        return self.version == 2 and self.raw[2] == 1

    @property
    def known(self) -> bool:
        """True if the dialect can decode it."""
        return self.msgid in CRC_EXTRA


_CODEC: Final = ardupilotmega.MAVLink(None)  # for messages with text; without a key it has no state


def decode(packet: Packet) -> Message | None:
    """Return the message in a packet; None if the dialect cannot decode it."""
    raw, msgid = packet.raw, packet.msgid
    later = raw[0] == 0xFD
    if msgid not in CRC_EXTRA or (not later and raw[1] < length_v1(msgid)):
        return None
    if read := reader_of(msgid):  # pymavlink would verify the checksum again
        header = 10 if later else 6
        return read(raw[header : header + raw[1]])
    try:
        return _CODEC.decode(bytearray(raw))
    except ardupilotmega.MAVError:
        return None
