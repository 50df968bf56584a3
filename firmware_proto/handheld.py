"""The format `handheld`: a rescuer's display as a camera reads it, five lights and two digits. See PROTOCOL.md."""

from __future__ import annotations

import re
from typing import Final

from firmware_proto.frame import INNER, MID, Channel, Frame, check
from firmware_proto.text import TextDecoder
from firmware_proto.wire_format import Format

_LINE: Final = re.compile(rb"([.*]{5}) (--|\d\.\d|\d\d)\r?")
_LIGHTS: Final = 5
_WIDTH_DEG: Final = 180 / _LIGHTS


def encode_handheld(frame: Frame) -> bytes:
    """The display of the nearest channel with a signal. Raises ValueError as `encode`."""
    check(frame)
    nearest = min((c for c in frame.channels if c.valid), key=lambda c: c.d, default=None)
    if nearest is None:
        return b"..... --\r\n"
    lit = min(max(int((nearest.delta + 90) // _WIDTH_DEG), 0), _LIGHTS - 1)
    lights = "." * _LIGHTS if nearest.zone == INNER else "." * lit + "*" + "." * (_LIGHTS - 1 - lit)
    tenths, metres = (nearest.d + 5) // 10, min((nearest.d + 50) // 100, 99)
    digits = f"{tenths / 10:.1f}" if tenths < 100 else f"{metres:02}"
    return f"{lights} {digits}\r\n".encode()


class HandheldDecoder(TextDecoder):
    """Incremental decoder of displays. δ is the middle of a light's class, 0 without a light."""

    def _channel(self, line: bytes) -> Channel | None:
        fields = _LINE.fullmatch(line)
        if not fields or fields[1].count(b"*") > (fields[2] != b"--"):
            return None
        if fields[2] == b"--":
            return Channel()
        lit = fields[1].find(b"*")
        zone, delta = (INNER, 0) if lit < 0 else (MID, round((lit + 0.5) * _WIDTH_DEG - 90))
        return Channel(zone=zone, d=round(100 * float(fields[2])), delta=delta)


HANDHELD: Final = Format(encode_handheld, HandheldDecoder)
