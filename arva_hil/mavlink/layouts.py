"""How messages lie in their packets, by pymavlink's tables."""

from __future__ import annotations

import functools
import itertools
import operator
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

from fastcrc import crc16
from pymavlink.dialects.v20 import ardupilotmega as dialect

_BYTES: Final = {"char": 1, "float": 4, "double": 8} | {
    f"{u}int{n}_t": n // 8 for u in ("", "u") for n in (8, 16, 32, 64)
}


@functools.cache
def length_v1(msgid: int) -> int:
    """Bytes of a message's payload without extension fields: they are the ones that its checksum seed leaves out.

    https://mavlink.io/en/guide/serialization.html#crc_extra
    """
    kind = dialect.mavlink_map[msgid]
    types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
    crc, size, whole = crc16.mcrf4xx(f"{kind.msgname} ".encode()), 0, 0
    for name, length in zip(kind.ordered_fieldnames, kind.array_lengths, strict=True):
        crc = crc16.mcrf4xx(f"{types[name]} {name} ".encode() + bytes([length] if length else []), crc)
        size += _BYTES[types[name]] * (length or 1)
        if (crc & 0xFF) ^ (crc >> 8) == kind.crc_extra:
            whole = size
    return whole


@functools.cache
def layout(msgid: int) -> tuple[Any, Any, Callable[[Sequence[Any]], Iterable[Any]]] | None:
    """The class of a message of numbers alone, how it is packed, and what puts the numbers into the fields' order."""
    kind = dialect.mavlink_map[msgid]
    if "char" in kind.fieldtypes:
        return None
    ends = list(itertools.accumulate(kind.lengths))
    places = [slice(end - n, end) if n > 1 else end - 1 for end, n in zip(ends, kind.lengths, strict=True)]
    ordered = [places[at] for at in kind.orders]
    if len(ordered) > 1 and all(isinstance(at, int) for at in ordered):
        return kind, kind.unpacker, operator.itemgetter(*ordered)
    return kind, kind.unpacker, lambda values: [list(values[at]) if type(at) is slice else values[at] for at in ordered]


@functools.cache
def payload_writer(msgid: int) -> Callable[[Any], bytes] | None:
    """What makes the payload, whole, out of a message of several numbers; None for other messages.

    It raises struct.error for a number that does not fit and for an array that is too short.
    """
    kind = dialect.mavlink_map[msgid]
    if "char" in kind.fieldtypes or len(kind.fieldnames) < 2:
        return None
    values, lengths = operator.attrgetter(*kind.ordered_fieldnames), kind.lengths
    pack: Callable[..., bytes] = kind.unpacker.pack
    if max(lengths) == 1:
        return lambda message: pack(*values(message))

    def write(message: Any) -> bytes:
        fields = zip(values(message), lengths, strict=True)
        return pack(*itertools.chain.from_iterable(value[:n] if n > 1 else (value,) for value, n in fields))

    return write
