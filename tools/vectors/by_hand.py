"""The common parts of all bytes on the wire, without a codec."""

from __future__ import annotations

from typing import Any

Wire = dict[str, Any]


def crc(data: bytes) -> int:
    """CRC-16/MCRF4XX, one bit at a time."""
    register = 0xFFFF
    for byte in data:
        for bit in range(8):
            carry = (register ^ byte >> bit) & 1
            register = register >> 1 ^ 0x8408 * carry
    return register


def seal(body: bytes) -> bytes:
    """Return any bytes with sync and a right CRC, well formed or not."""
    return b"\xa4\x57" + body + crc(body).to_bytes(2, "little")


def sentence(*fields: object) -> str:
    """Return a line of NMEA."""
    text = ",".join(map(str, fields))
    checksum = 0
    for letter in text:
        checksum ^= ord(letter)
    return f"${text}*{checksum:02X}\r\n"


def number(value: int, size: int, *, signed: bool = True) -> bytes:
    return value.to_bytes(size, "little", signed=signed)
