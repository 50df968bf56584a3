"""pymavlink's dialect with the messages CURRENT_MODE and ESC_STATUS, which it lacks; the layout of messages in packets.

https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable, Sequence
from typing import Any, Final, cast

from fastcrc import crc16
from pymavlink.dialects.v20 import ardupilotmega

MAVLINK_MSG_ID_CURRENT_MODE: Final = 436
MAVLINK_MSG_ID_ESC_STATUS: Final = 291

_BYTES: Final = {f"{u}int{8 * n}_t": n for u in ("", "u") for n in (1, 2, 4, 8)} | {"char": 1, "float": 4, "double": 8}
_CODES: Final = {"uint8_t": "B", "uint32_t": "I", "uint64_t": "Q", "int32_t": "i", "float": "f"}


def _lacking(msgid: int, name: str, crc_extra: int, fields: str) -> Any:
    """A class of messages, shaped as pymavlink's own are. `fields`: "type name" or "type name[length]" of each."""
    rows = [(kind, *field.rstrip("]").partition("[")[::2]) for kind, field in map(str.split, fields.split(","))]
    ordered = sorted(rows, key=lambda row: -_BYTES[row[0]])
    names = [field for _, field, _ in rows]

    def init(self: Any, *values: Any) -> None:
        ardupilotmega.MAVLink_message.__init__(self, msgid, name)
        self._fieldnames, self._instance_field, self._instance_offset = names, None, -1
        vars(self).update(zip(names, values, strict=True))

    def pack(self: Any, mav: Any, force_mavlink1: bool = False) -> bytes:
        write = payload_writer(msgid)
        assert write is not None
        return cast(bytes, self._pack(mav, crc_extra, write(self), force_mavlink1=force_mavlink1))

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
    """The COMMAND_LONG `number` for a component. Missing parameters are 0."""
    message = ardupilotmega.MAVLink_command_long_message
    return message(system, component, number, 0, *params, *[0.0] * (7 - len(params)))


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
def _light_class(msgid: int) -> Any:
    """A subclass of pymavlink's class. The header and ten more values that its constructor makes for each message, and
    that are not used, are shared by all: this takes a fifth of the time.
    """
    kind = ardupilotmega.mavlink_map[msgid]
    shared = {
        **vars(ardupilotmega.MAVLink_message(msgid, kind.msgname)),
        "_fieldnames": kind.fieldnames,
        "_instance_field": kind.instance_field,
        "_instance_offset": kind.instance_offset,
    }
    return type(kind.__name__, (kind,), shared)


@functools.cache
def message_maker(msgid: int) -> tuple[Callable[[Sequence[Any]], Any], Any] | None:
    """A function that makes a message of a light class from the numbers of its payload, and the struct to unpack them.
    None for a message with text.

    The code is generated from pymavlink's table, like a namedtuple's.
    """
    kind = ardupilotmega.mavlink_map[msgid]
    if "char" in kind.fieldtypes:
        return None
    names: dict[str, Any] = {"new": object.__new__, "kind": _light_class(msgid)}
    numbers, lists = list[str](), list[str]()
    for name, n in zip(kind.ordered_fieldnames, kind.lengths, strict=True):
        places = [f"m.{name}"] if n == 1 else [f"{name}_{i}" for i in range(n)]
        numbers += places
        lists += [] if n == 1 else [f" m.{name} = [{', '.join(places)}]"]
    exec("\n".join(["def make(v):", " m = new(kind)", f" {', '.join(numbers)}, = v", *lists, " return m"]), names)
    return names["make"], kind.unpacker


@functools.cache
def constructor(msgid: int) -> Callable[..., Any]:
    """As the constructor of pymavlink's class, with the fields by place, but the message is of a light class. Not for
    messages with text.
    """
    kind = ardupilotmega.mavlink_map[msgid]
    names: dict[str, Any] = {"new": object.__new__, "kind": _light_class(msgid)}
    fields = ", ".join(f"m.{name}" for name in kind.fieldnames)
    values = ", ".join(kind.fieldnames)
    exec(f"def make({values}):\n m = new(kind)\n {fields}, = {values},\n return m", names)
    make = names["make"]
    make.__defaults__ = kind.__init__.__defaults__
    return cast(Callable[..., Any], make)


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
