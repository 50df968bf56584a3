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

__all__ = ["Encoder", "Packet", "Parser", "dialect"]

Message = Any  # pymavlink's generated classes carry no types

_MAGIC_V1: Final = 0xFE
_MAGIC_V2: Final = 0xFD
_MAGIC: Final = re.compile(b"[\xfd\xfe]")
_SIGNED: Final = 0x01  # the one incompatibility flag there is; a packet with another must be dropped
_SIGNATURE_BYTES: Final = 13
_CRC_EXTRA: Final[dict[int, bytes]] = {k: bytes([m.crc_extra]) for k, m in dialect.mavlink_map.items()}


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
        self._buffer = bytearray()
        self._codec = dialect.MAVLink(None)

    def feed(self, chunk: bytes) -> list[Packet]:
        """The packets completed by `chunk`, which may be cut anywhere. Never raises."""
        buffer = self._buffer
        buffer += chunk
        packets: list[Packet] = []
        at, end = 0, len(buffer)
        while at < end:
            magic = buffer[at]
            if magic == _MAGIC_V2:
                if at + 10 > end:
                    break
                flags = buffer[at + 2]
                size = buffer[at + 1] + (12 + _SIGNATURE_BYTES if flags & _SIGNED else 12)
                if flags & ~_SIGNED:
                    size = 0
            elif magic == _MAGIC_V1:
                if at + 6 > end:
                    break
                flags = 0
                size = buffer[at + 1] + 8
            else:
                size = 0
            if size and at + size > end:
                break
            following = buffer[at + size] if size and at + size < end else None
            packet = self._packet(bytes(buffer[at : at + size]), flags, following) if size else None
            if packet is not None:
                packets.append(packet)
                at += size
                continue
            found = _MAGIC.search(buffer, at + 1)
            next_at = found.start() if found else end
            self.skipped += next_at - at
            at = next_at
        del buffer[:at]
        self.packets += len(packets)
        return packets

    def _packet(self, raw: bytes, flags: int, following: int | None) -> Packet | None:
        """The candidate as a packet, or None when it is a false one.

        The checksum of an unknown id cannot be verified: such a candidate counts only when the next byte,
        if there is one, starts a packet.
        """
        if raw[0] == _MAGIC_V2:
            version, header = 2, 10
            system, component = raw[5], raw[6]
            msgid = raw[7] | raw[8] << 8 | raw[9] << 16
        else:
            version, header = 1, 6
            system, component, msgid = raw[3], raw[4], raw[5]
        crc_at = header + raw[1]
        extra = _CRC_EXTRA.get(msgid)
        if extra is None:
            if following not in (None, _MAGIC_V1, _MAGIC_V2):
                return None
            return Packet(raw, version, bool(flags), system, component, msgid, False)
        if crc16.mcrf4xx(raw[1:crc_at] + extra) != raw[crc_at] | raw[crc_at + 1] << 8:
            self.bad_crc += 1
            return None
        return Packet(raw, version, bool(flags), system, component, msgid, True)

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
        """The bytes of one packet. Raises ValueError when a number or an array does not fit; longer texts are cut."""
        try:
            raw = message.pack(self._codec, force_mavlink1=self.version == 1 and message.id <= 255)
        except (struct.error, OverflowError, IndexError, dialect.MAVError) as error:
            raise ValueError(f"{message.get_type()}: {error}") from error
        self._codec.seq = (self._codec.seq + 1) % 256
        return bytes(raw)


@functools.cache
def _layout(msgid: int) -> tuple[Any, Any, list[int | slice]] | None:
    """The class of a message of numbers alone, how it is packed, and where each field lies among the numbers."""
    kind = dialect.mavlink_map[msgid]
    if "char" in kind.fieldtypes:
        return None
    ends = list(itertools.accumulate(kind.lengths))
    places = [slice(end - n, end) if n > 1 else end - 1 for end, n in zip(ends, kind.lengths, strict=True)]
    return kind, kind.unpacker, [places[at] for at in kind.orders]
