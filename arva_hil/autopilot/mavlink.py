"""MAVLink 1 and 2 as a codec: bytes in, packets out; messages in, bytes out.

Splitting the stream is done here, because it must find the next whole packet behind any garbage; field
layouts, checksum seeds and encoding are pymavlink's. Protocol: https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

import functools
import itertools
import re
import struct
from typing import Any, Final, NamedTuple

from fastcrc import crc16
from pymavlink.dialects.v20 import ardupilotmega as dialect

__all__ = ["RESULTS", "Encoder", "Packet", "Parser", "command", "dialect"]

Message = Any  # pymavlink's generated classes carry no types

_MAGIC_V1: Final = 0xFE
_MAGIC_V2: Final = 0xFD
_MAGIC: Final = re.compile(b"[\xfd\xfe]")
_SIGNED: Final = 0x01  # the one incompatibility flag there is; a packet with another must be dropped
_SIGNATURE_BYTES: Final = 13
_CRC_EXTRA: Final[dict[int, bytes]] = {k: bytes([m.crc_extra]) for k, m in dialect.mavlink_map.items()}


RESULTS: Final[dict[int, str]] = {value: entry.name for value, entry in dialect.enums["MAV_RESULT"].items()}


class Packet(NamedTuple):
    """One whole packet as it came, its checksum verified when the dialect knows the message id."""

    raw: bytes
    version: int  # 1 or 2
    signed: bool
    system: int
    component: int
    msgid: int
    known: bool  # the dialect can decode it


class Parser:
    """Incremental MAVLink splitter; remembers the bytes of the packet that is not whole yet.

    Counters: `packets`, `bad_crc` (candidates whose checksum failed) and `skipped` (bytes in no packet).
    """

    def __init__(self) -> None:
        self.packets = 0
        self.bad_crc = 0
        self.skipped = 0
        self._rest = b""
        self._codec = dialect.MAVLink(None)

    def feed(self, chunk: bytes) -> list[Packet]:
        """The packets completed by `chunk`, which may be cut anywhere. Never raises."""
        data = self._rest + chunk if self._rest else chunk
        packets: list[Packet] = []
        at, end = 0, len(data)
        while at < end:
            size = _size(data, at)
            if at + size > end:
                break
            packet = self._packet(data, at, size) if size else None
            if packet is not None:
                packets.append(packet)
                at += size
                continue
            found = _MAGIC.search(data, at + 1)
            following = found.start() if found else end
            self.skipped += following - at
            at = following
        self._rest = data[at:]
        self.packets += len(packets)
        return packets

    def cut(self) -> None:
        """The stream breaks off: the packet that is not whole yet never will be."""
        self.skipped += len(self._rest)
        self._rest = b""

    def _packet(self, data: bytes, at: int, size: int) -> Packet | None:
        """The candidate at `at` as a packet, or None when it is a false one.

        The checksum of an unknown id cannot be verified: such a candidate counts only when the next byte,
        if there is one, starts a packet.
        """
        raw = data[at : at + size]
        if raw[0] == _MAGIC_V2:
            version, signed, crc_at = 2, bool(raw[2]), 10 + raw[1]
            system, component = raw[5], raw[6]
            msgid = raw[7] | raw[8] << 8 | raw[9] << 16
        else:
            version, signed, crc_at = 1, False, 6 + raw[1]
            system, component, msgid = raw[3], raw[4], raw[5]
        extra = _CRC_EXTRA.get(msgid)
        if extra is None:
            if data[at + size : at + size + 1] not in (b"", b"\xfd", b"\xfe"):
                return None
        elif crc16.mcrf4xx(raw[1:crc_at] + extra) != raw[crc_at] | raw[crc_at + 1] << 8:
            self.bad_crc += 1
            return None
        return Packet(raw, version, signed, system, component, msgid, extra is not None)

    def decode(self, packet: Packet) -> Message | None:
        """The message in a packet; None when the dialect cannot read it."""
        if not packet.known:
            return None
        if numbers := _layout(packet.msgid):  # without pymavlink's second look at the checksum, most of its time
            kind, packing, places = numbers
            header = 10 if packet.version == 2 else 6
            payload = packet.raw[header : header + packet.raw[1]]
            values = packing.unpack(payload[: packing.size].ljust(packing.size, b"\0"))
            return kind(*[list(values[at]) if type(at) is slice else values[at] for at in places])
        try:
            return self._codec.decode(bytearray(packet.raw))
        except dialect.MAVError:
            return None


class Encoder:
    """Packs messages as one MAVLink component; remembers its sequence number.

    `version` may be set to 1 for a vehicle that speaks MAVLink 1; messages that exist in MAVLink 2 only
    (id above 255) are sent as MAVLink 2 all the same.
    """

    def __init__(self, system: int, component: int, version: int = 2) -> None:
        self.version = version
        self._codec = dialect.MAVLink(None, system, component)

    @property
    def system(self) -> int:
        return int(self._codec.srcSystem)

    @system.setter
    def system(self, system: int) -> None:
        self._codec.srcSystem = system

    def pack(self, message: Message) -> bytes:
        """The bytes of one packet. Raises ValueError when a value does not fit; text too long is cut."""
        try:
            raw = message.pack(self._codec, force_mavlink1=self.version == 1 and message.id <= 255)
        except (struct.error, OverflowError, IndexError, dialect.MAVError) as error:
            raise ValueError(f"{message.get_type()}: {error}") from error
        self._codec.seq = (self._codec.seq + 1) % 256
        return bytes(raw)


def command(system: int, component: int, number: int, *params: float) -> Message:
    """COMMAND_LONG `number` to a component; parameters left out are 0."""
    return dialect.MAVLink_command_long_message(system, component, number, 0, *params, *[0.0] * (7 - len(params)))


def _size(data: bytes, at: int) -> int:
    """Bytes of the packet that starts at `at`, 0 when none does; a header's worth while that is not whole."""
    magic = data[at]
    if magic == _MAGIC_V2:
        if at + 3 > len(data):
            return 12
        flags = data[at + 2]
        if flags & ~_SIGNED:
            return 0
        return data[at + 1] + (12 + _SIGNATURE_BYTES if flags else 12)
    if magic == _MAGIC_V1:
        return data[at + 1] + 8 if at + 2 <= len(data) else 8
    return 0


@functools.cache
def _layout(msgid: int) -> tuple[Any, Any, list[int | slice]] | None:
    """The class of a message of numbers alone, how it is packed, and where each field lies among the numbers."""
    kind = dialect.mavlink_map[msgid]
    if "char" in kind.fieldtypes:
        return None
    ends = list(itertools.accumulate(kind.lengths))
    places = [slice(end - n, end) if n > 1 else end - 1 for end, n in zip(ends, kind.lengths, strict=True)]
    return kind, kind.unpacker, [places[at] for at in kind.orders]
