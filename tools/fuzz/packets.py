"""MAVLink packets that no encoder makes: any message, payload and flags, under a right checksum."""

from __future__ import annotations

from typing import Final

from fastcrc import crc16

from arva_hil.mavlink.codec import dialect

_EXTRA: Final = {msgid: bytes([kind.crc_extra]) for msgid, kind in dialect.mavlink_map.items()}


def packet(
    msgid: int, payload: bytes, source: tuple[int, int], *, flags: int = 0, version: int = 2, sequence: int = 7
) -> bytes:
    """Without the signature that `flags` may announce. The checksum is right if the dialect knows the message."""
    if version == 1:
        body = bytes((len(payload), sequence, *source, msgid & 0xFF)) + payload
    else:
        body = bytes((len(payload), flags, 0, sequence, *source)) + msgid.to_bytes(3, "little") + payload
    crc = crc16.mcrf4xx(body + _EXTRA.get(msgid, b"\0"))
    return (b"\xfe" if version == 1 else b"\xfd") + body + crc.to_bytes(2, "little")
