"""The NMEA 0183 format: one `$PARVA` sentence for each channel. See PROTOCOL.md."""

from __future__ import annotations

import re
from typing import Final

from firmware_proto.command_lines import LINE_HOST
from firmware_proto.frame import MARKED, MAX_CHANNELS, PAUSE_S, Channel, Frame, FrameDecoder, check
from firmware_proto.sentence import ChecksumError, begun, body_of, sentence
from firmware_proto.wire_format import Format

_BODY: Final = re.compile(rb"PARVA,(\d{1,3}),(\d{1,3}),(\d{1,2}),(\d{1,2}),(\d{0,3}),(\d{1,3}),(-?\d{1,5}),(-?\d{1,5})")


def encode_nmea(frame: Frame) -> bytes:
    """Return the sentences of a frame, one for each channel. Raises ValueError with the field that does not fit."""
    check(frame)
    n = len(frame.channels)
    sentences = []
    for slot, (id, zone, d, delta, marked) in enumerate(frame.channels, 1):
        who, where = "" if id is None else id, zone | (MARKED if marked else 0)
        body = f"PARVA,{frame.sequence},{frame.status},{n},{slot},{who},{where},{d},{delta}".encode()
        sentences.append(sentence(body))
    return b"".join(sentences)


class NmeaDecoder(FrameDecoder):
    """Incremental decoder of `$PARVA` sentences. Remembers the incomplete sentence and the incomplete frame.

    A frame is its sentences 1…n in order, with less than 100 ms between them; otherwise the sentences before are
    dropped. Other sentences on the line are dropped too.
    """

    def __init__(self) -> None:
        super().__init__()
        self._part = b""  # at most MAX_SENTENCE
        self._head = (0, 0, 0)  # sequence, status, n of the incomplete frame
        self._channels: list[Channel] = []
        self._bytes = 0  # of its sentences so far
        self._since = 0.0  # when the last sentence came

    def feed(self, chunk: bytes, now: float) -> list[Frame]:
        """Return the frames completed by `chunk`. See FrameDecoder."""
        if now - self._since >= PAUSE_S:
            self._give_up()
        *lines, part = (self._part + chunk).split(b"\n")
        frames = [frame for line in lines if (frame := self._line(line, now))]
        self._part = begun(part)
        self.dropped += len(part) - len(self._part)
        return frames

    def _line(self, line: bytes, now: float) -> Frame | None:
        start = max(line.rfind(b"$"), 0)
        size = len(line) - start + 1
        self.dropped += start
        values = self._values(line[start:])
        if values is None:
            self.dropped += size
            return None
        sequence, status, n, slot, channel = values
        if slot != len(self._channels) + 1 or (self._channels and (sequence, status, n) != self._head):
            self._give_up()
        if slot != len(self._channels) + 1:
            self.dropped += size
            return None
        self._head = sequence, status, n
        self._channels.append(channel)
        self._bytes += size
        self._since = now
        if slot < n:
            return None
        frame = Frame(sequence, status, tuple(self._channels))
        self._channels, self._bytes = [], 0
        self._count(sequence)
        return frame

    def _values(self, line: bytes) -> tuple[int, int, int, int, Channel] | None:
        """Return sequence, status, n, slot and channel of a valid sentence; None for anything else."""
        try:
            body = body_of(line)
        except ChecksumError:
            self.bad_crc += 1
            return None
        fields = _BODY.fullmatch(body or b"")
        if not fields:
            return None
        id = int(fields[5]) if fields[5] else None
        sequence, status, n, slot, zone, d, delta = (int(fields[k]) for k in (1, 2, 3, 4, 6, 7, 8))
        if max(sequence, status, zone) > 255 or not 1 <= slot <= n <= MAX_CHANNELS or (id or 0) > 254:
            return None
        if min(d, delta) < -0x8000 or max(d, delta) > 0x7FFF:
            return None
        return sequence, status, n, slot, Channel(id, zone & ~MARKED, d, delta, zone >= MARKED)

    def _give_up(self) -> None:
        self.dropped += self._bytes
        self._channels, self._bytes = [], 0


NMEA: Final = Format(encode_nmea, NmeaDecoder, numbered=True, host=LINE_HOST, ids=True)
