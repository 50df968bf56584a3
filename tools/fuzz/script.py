"""The bytes of an input as operations: mutations change the story, not only its spelling. Any MAVLink packets."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

from fastcrc import crc16

from arva_hil.mavlink.codec import dialect

ROOT: Final = Path(__file__).parents[2]
PAUSES_S: Final = (0.0, 0.001, 0.02, 0.06, 0.099, 0.101, 1.0, 100.0)


class Script:
    """Numbers and bytes off the front of the input; zeros and nothing behind its end."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def __bool__(self) -> bool:
        return self._at < len(self._data)

    def take(self, count: int) -> bytes:
        self._at += count
        return self._data[self._at - count : self._at]

    def number(self, layout: str = "B") -> Any:
        size = struct.calcsize("<" + layout)
        return struct.unpack("<" + layout, self.take(size).ljust(size, b"\0"))[0]

    def chunks(self) -> Iterator[tuple[float, bytes]]:
        """The rest as chunks with their times: how long the pause before each is, how many bytes it has, and they."""
        now = 0.0
        while self:
            now += PAUSES_S[self.number() % len(PAUSES_S)]
            yield now, self.take(self.number())


def scripted(chunks: Iterable[bytes], pause: int = 0) -> bytes:
    """What `Script.chunks` makes these chunks of; `pause` counts in PAUSES_S."""
    return b"".join(bytes([pause, len(chunk)]) + chunk for chunk in chunks)


def fed(whole: Any, piecemeal: Any, chunk: bytes, now: float) -> list[Any]:
    """What a decoder makes of a chunk. A second one gets it byte by byte, and has to make the same of it."""
    got: list[Any] = whole.feed(chunk, now)
    parts = [chunk[k : k + 1] for k in range(len(chunk))] or [chunk]
    assert got == [one for part in parts for one in piecemeal.feed(part, now)], "chunking matters"
    return got


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
