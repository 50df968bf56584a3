"""The plain text format: `<d>,<δ>` of the nearest channel, one line for each reading. See PROTOCOL.md."""

from __future__ import annotations

import re
from typing import Final

from firmware_proto.command_lines import LINE_HOST
from firmware_proto.frame import PAUSE_S, Channel, Frame, FrameDecoder, check
from firmware_proto.wire_format import Format

_LINE: Final = re.compile(rb"(-?\d{1,5}),(-?\d{1,5})\r?")
_KEPT: Final = len(b"-32768,-32768\r") + 1  # one more than a valid line: what is cut to this length stays invalid


def encode_text(frame: Frame) -> bytes:
    """Return the line of the nearest channel with a signal, otherwise of channel 1. Raises ValueError as `encode`."""
    check(frame)
    nearest = min((c for c in frame.channels if c.valid), key=lambda c: c.d, default=frame.channels[0])
    return f"{nearest.d},{nearest.delta}\r\n".encode()


class TextDecoder(FrameDecoder):
    """Incremental decoder of text lines. Remembers the incomplete line and when it began.

    A frame has one channel with an unknown transmitter (id None, zone OUTER, not marked) and status 0. The sequence
    numbers are counted here, so `lost` and `bad_crc` stay 0. A line has no checksum: one that took 100 ms or more to
    arrive may be made of two incomplete ones, and is dropped.
    """

    def __init__(self) -> None:
        super().__init__()
        self._part = b""
        self._since = 0.0

    def feed(self, chunk: bytes, now: float) -> list[Frame]:
        """Return the frames completed by `chunk`. See FrameDecoder."""
        frames: list[Frame] = []
        if not self._part:
            self._since = now
        *lines, part = (self._part + chunk).split(b"\n")
        for line in lines:
            frame = self._frame(line) if now - self._since < PAUSE_S else None
            if frame:
                frames.append(frame)
            else:
                self.dropped += len(line) + 1
            self._since = now  # the next line began in this chunk
        self._part = part[-_KEPT:]
        self.dropped += len(part) - len(self._part)
        return frames

    def _frame(self, line: bytes) -> Frame | None:
        channel = self._channel(line)
        if channel is None:
            return None
        sequence = self.good % 256
        self._count(sequence)
        return Frame(sequence, 0, (channel,))

    def _channel(self, line: bytes) -> Channel | None:
        fields = _LINE.fullmatch(line)
        if not fields:
            return None
        d, delta = int(fields[1]), int(fields[2])
        if min(d, delta) < -0x8000 or max(d, delta) > 0x7FFF:
            return None
        return Channel(d=d, delta=delta)


TEXT: Final = Format(encode_text, TextDecoder, host=LINE_HOST)
