"""The codec for MAVLink 1 and 2: packets to messages and back.

Field layouts, CRC_EXTRA and encoding are pymavlink's. `packet_reader` splits bytes into packets.
Protocol: https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

import struct
from typing import Final

from fastcrc import crc16
from pymavlink.dialects.v20 import ardupilotmega as dialect

from arva_hil.mavlink.dialect import (
    CRC_EXTRA,
    Message,
    Packet,
    command,
    decode,
    layout_of,
    length_v1,
    tunnel,
    untunnel,
)
from arva_hil.mavlink.packet_reader import Parser
from arva_hil.mavlink.signing import Signing

__all__ = ["RESULTS", "Encoder", "Message", "Packet", "Parser", "command", "decode", "dialect", "tunnel", "untunnel"]

_COVERED_V2: Final = struct.Struct("<BBBBBBHB")  # without magic: length, two flags, sequence number, ids, message id
_U16: Final = struct.Struct("<H")

RESULTS: Final[dict[int, str]] = {value: entry.name for value, entry in dialect.enums["MAV_RESULT"].items()}


class Encoder:
    """Encodes messages of one MAVLink component. Remembers the sequence number.

    `system` may be set, and `version` to 1 for a vehicle with MAVLink 1; messages that exist only in MAVLink 2 (id
    above 255) are sent as MAVLink 2 anyway. `signing`: MAVLink 2 packets are signed with it.
    """

    def __init__(self, system: int, component: int, version: int = 2, signing: Signing | None = None) -> None:
        self.version = version
        self.system = system
        self.component = component
        self._codec = dialect.MAVLink(None, system, component)
        self._signing = signing
        if signing:
            self._codec.signing.secret_key, self._codec.signing.link_id = signing.key, signing.link

    def pack(self, message: Message) -> bytes:
        """Return the bytes of one packet. Raises ValueError if a value does not fit; long text is cut."""
        msgid = type(message).id  # some messages have a field `id`
        first = self.version == 1 and msgid <= 255
        layout = None if first or self._signing else layout_of(msgid)
        codec = self._codec
        try:
            if layout:  # MAVLink 2 leaves out zeros at the end, but keeps one byte
                payload = layout.payload(message).rstrip(b"\0") or b"\0"
                low, high, source = msgid & 0xFFFF, msgid >> 16, self.component
                covered = _COVERED_V2.pack(len(payload), 0, 0, codec.seq, self.system, source, low, high) + payload
                raw = b"\xfd" + covered + _U16.pack(crc16.mcrf4xx(covered + CRC_EXTRA[msgid]))
            else:
                raw = self._packed(message, first=first)
        except (struct.error, OverflowError, IndexError, dialect.MAVError) as error:
            raise ValueError(f"{message.get_type()}: {error}") from error
        codec.seq = (codec.seq + 1) % 256
        return _without_extensions(raw, msgid) if first else raw

    def _packed(self, message: Message, *, first: bool) -> bytes:
        """Return a packet by pymavlink, in three times the time: as MAVLink 1 (`first`), signed, or with text."""
        signing, self._codec.srcSystem = self._codec.signing, self.system
        if self._signing and not first:
            signing.timestamp = self._signing.stamp()
        signing.sign_outgoing = self._signing is not None and not first
        return bytes(message.pack(self._codec, force_mavlink1=first))


def _without_extensions(raw: bytes, msgid: int) -> bytes:
    """Return a MAVLink 1 packet without the extension fields of MAVLink 2, which pymavlink leaves in."""
    length = length_v1(msgid)
    if raw[1] == length:
        return raw
    body = bytes([length]) + raw[2 : 6 + length]
    return raw[:1] + body + _U16.pack(crc16.mcrf4xx(body + CRC_EXTRA[msgid]))
