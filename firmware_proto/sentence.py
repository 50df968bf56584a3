"""Sentences of NMEA 0183: `$`, fields with commas, `*` and a checksum, a line each."""

from __future__ import annotations

import re
from functools import reduce
from operator import xor
from typing import Final

MAX_SENTENCE: Final = 82  # bytes from `$` to the line feed, as in NMEA 0183

_SENTENCE: Final = re.compile(rb"\$([^$*]{0,76})\*([0-9A-Fa-f]{2})\r?")


class ChecksumError(ValueError):
    """A sentence with a wrong checksum."""


def sentence(body: bytes) -> bytes:
    """Return the complete line of a body."""
    return b"$%b*%02X\r\n" % (body, reduce(xor, body))


def body_of(line: bytes) -> bytes | None:
    """Return the body of a line without its line feed; None if it is no sentence. Raises ChecksumError."""
    found = _SENTENCE.fullmatch(line)
    if not found:
        return None
    body, checksum = found.groups()
    if reduce(xor, body, 0) != int(checksum, 16):
        raise ChecksumError
    return bytes(body)


def begun(part: bytes) -> bytes:
    """Return the incomplete sentence at the end of the bytes after the last line feed."""
    start = part.rfind(b"$")
    return part[start:] if start >= 0 and len(part) - start <= MAX_SENTENCE else b""
