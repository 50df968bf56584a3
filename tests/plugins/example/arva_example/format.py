"""A wire format: the binary frame as one line of hexadecimal digits."""

from __future__ import annotations

from arva_hil import Format, FrameDecoder
from firmware_proto import Decoder, Frame, encode


def encode_hex(frame: Frame) -> bytes:
    return encode(frame).hex().encode() + b"\n"


class HexDecoder(FrameDecoder):
    """Remembers the line that is not whole yet, 256 bytes of it at most."""

    def __init__(self) -> None:
        super().__init__()
        self._part = b""

    def feed(self, chunk: bytes, now: float) -> list[Frame]:
        *lines, part = (self._part + chunk).split(b"\n")
        self._part = part[-256:]
        return [frame for line in lines for frame in self._frames(line)]

    def _frames(self, line: bytes) -> list[Frame]:
        try:
            frames = Decoder().feed(bytes.fromhex(line.decode()), 0.0)
        except ValueError:
            frames = []
        self.dropped += 0 if frames else len(line) + 1
        for frame in frames:
            self._count(frame.sequence)
        return frames


HEX = Format(encode_hex, HexDecoder, numbered=True, ids=True)
