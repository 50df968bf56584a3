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
    length_v1,
    tunnel,
    untunnel,
)
from arva_hil.mavlink.packet_reader import Parser
from arva_hil.mavlink.signing import Signing

__all__ = ["RESULTS", "Encoder", "Message", "Packet", "Parser", "command", "decode", "dialect", "tunnel", "untunnel"]

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
        codec = self._codec
        codec.srcSystem = self.system
        codec.signing.sign_outgoing = self._signing is not None and not first
        if self._signing and not first:
            codec.signing.timestamp = self._signing.stamp()
        try:
            raw = message.pack(codec, force_mavlink1=first)
        except (struct.error, OverflowError, IndexError, dialect.MAVError) as error:
            raise ValueError(f"{message.get_type()}: {error}") from error
        codec.seq = (codec.seq + 1) % 256
        return _without_extensions(raw, msgid) if first else bytes(raw)


def _without_extensions(raw: bytes, msgid: int) -> bytes:
    """Return a MAVLink 1 packet without the extension fields of MAVLink 2, which pymavlink leaves in."""
    length = length_v1(msgid)
    if raw[1] == length:
        return raw
    body = bytes([length]) + raw[2 : 6 + length]
    return raw[:1] + body + _U16.pack(crc16.mcrf4xx(body + CRC_EXTRA[msgid]))
