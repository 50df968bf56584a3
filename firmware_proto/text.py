"""The plain text form: `<d>,<δ>` of the nearest channel, a line a reading. Layout and rules: PROTOCOL.md."""

from __future__ import annotations

import re
from typing import Final

from firmware_proto.command_lines import LINE_HOST
from firmware_proto.frame import PAUSE_S, Channel, Format, Frame, FrameDecoder, check

_LINE: Final = re.compile(rb"(-?\d{1,5}),(-?\d{1,5})\r?")
_KEPT: Final = len(b"-32768,-32768\r") + 1  # one more than a good line: cut to it, a line stays a bad one


def encode_text(frame: Frame) -> bytes:
    """The line of the nearest channel that hears, else of channel 1. Raises ValueError like `encode`."""
    check(frame)
    nearest = min((c for c in frame.channels if c.valid), key=lambda c: c.d, default=frame.channels[0])
    return f"{nearest.d},{nearest.delta}\r\n".encode()


class TextDecoder(FrameDecoder):
    """Incremental decoder of text lines; remembers the line that is not whole yet and when it began.

    A frame has one channel, whose transmitter is unknown (id None, zone OUTER, not marked), status 0, and
    the sequence is counted here: `lost` and `bad_crc` stay 0. Nothing on the wire protects a line, so one
    that took 100 ms or more to arrive may be two torn ones and is dropped whole.
    """

    def __init__(self) -> None:
        super().__init__()
        self._part = b""
        self._since = 0.0

    def feed(self, chunk: bytes, now: float) -> list[Frame]:
        """The frames completed by `chunk`. See FrameDecoder."""
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
        fields = _LINE.fullmatch(line)
        if not fields:
            return None
        d, delta = int(fields[1]), int(fields[2])
        if min(d, delta) < -0x8000 or max(d, delta) > 0x7FFF:
            return None
        sequence = self.good % 256
        self._count(sequence)
        return Frame(sequence, 0, (Channel(d=d, delta=delta),))


TEXT: Final = Format(encode_text, TextDecoder, host=LINE_HOST)
