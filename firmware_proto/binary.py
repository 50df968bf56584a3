"""The binary frame: A4 57, version, length, payload, CRC. Layout and rules: PROTOCOL.md."""

from __future__ import annotations

import re
import struct
from typing import Final

from fastcrc import crc16

from firmware_proto.commands import BINARY_HOST
from firmware_proto.frame import MARKED, MAX_CHANNELS, Channel, Frame, FrameDecoder, Pending, check
from firmware_proto.wire_format import Format

VERSION: Final = 1
MAX_FRAME_BYTES: Final = 9 + 6 * MAX_CHANNELS

_NO_ID: Final = 255
_HEAD: Final = struct.Struct("<HBBBBB")  # sync, version, length, sequence, status, n
_CHANNEL: Final = struct.Struct("<BBhh")  # id, zone, d, δ
_SYNC: Final = 0x57A4

_LENGTHS: Final = re.escape(bytes(3 + 6 * n for n in range(1, MAX_CHANNELS + 1)))
# A head up to the length, or the beginning of one at the end of the bytes.
_CANDIDATE: Final = re.compile(rb"\xa4(?:\Z|\x57(?:\Z|\x01(?:\Z|[" + _LENGTHS + rb"])))")


def encode(frame: Frame) -> bytes:
    """Return the 9 + 6·n bytes of a frame. Raises ValueError with the field that does not fit."""
    check(frame)
    n = len(frame.channels)
    raw = _HEAD.pack(_SYNC, VERSION, 3 + 6 * n, frame.sequence, frame.status, n)
    for id, zone, d, delta, marked in frame.channels:
        raw += _CHANNEL.pack(_NO_ID if id is None else id, zone | MARKED if marked else zone, d, delta)
    return raw + crc16.mcrf4xx(raw[2:]).to_bytes(2, "little")


class Decoder(FrameDecoder):
    """Incremental decoder of binary frames. Remembers the incomplete candidate.

    It delivers every frame without a pause at once, except inside a longer false candidate: then when that candidate is
    complete or 100 ms old. On a silent line, call `feed` without bytes.
    """

    def __init__(self) -> None:
        super().__init__()
        self._pending = Pending()

    def feed(self, chunk: bytes, now: float) -> list[Frame]:
        """Return the frames completed by `chunk`, or by the end of a false candidate's 100 ms. See FrameDecoder."""
        frames: list[Frame] = []
        if not chunk and not self._pending:
            return frames
        given_up = self._pending.feed(chunk, now, lambda data, at: self._scan(data, at, frames))
        self.dropped += given_up  # after the scan, which counts too
        return frames

    def _scan(self, data: bytes, at: int, frames: list[Frame]) -> int:
        """Append the frames in `data[at:]`. Returns the start of the incomplete candidate, or the end of the data."""
        end = len(data)
        while found := _CANDIDATE.search(data, at):
            self.dropped += found.start() - at
            at = found.start()
            if end - at < _HEAD.size:
                return at
            size = data[at + 3] + 6
            if data[at + 6] * 6 + 9 == size:
                if end - at < size:
                    return at
                stop = at + size - 2
                if crc16.mcrf4xx(data[at + 2 : stop]) == data[stop] | data[stop + 1] << 8:
                    frames.append(self._frame(data, at, stop))
                    at += size
                    continue
                self.bad_crc += 1
            self.dropped += 1
            at += 1
        self.dropped += end - at
        return end

    def _frame(self, data: bytes, at: int, stop: int) -> Frame:
        self._count(data[at + 4])
        return frame_at(data, at, stop)


def frame_at(data: bytes, at: int, stop: int) -> Frame:
    """Return the good frame at `at`, whose CRC is at `stop`."""
    channels = tuple(
        [
            Channel(None if id == _NO_ID else id, zone & ~MARKED, d, delta, zone >= MARKED)
            for id, zone, d, delta in _CHANNEL.iter_unpack(data[at + _HEAD.size : stop])
        ]
    )
    return Frame(data[at + 4], data[at + 5], channels)


def size_at(data: bytes, at: int) -> int:
    """Return the size of the candidate at `at` by its head; 0 for a false one. It may exceed the data."""
    there = len(data) - at
    if not _CANDIDATE.match(data[at : at + 4]):
        return 0
    if there < _HEAD.size:
        return _HEAD.size
    return data[at + 3] + 6 if data[at + 6] * 6 + 3 == data[at + 3] else 0


BINARY: Final = Format(encode, Decoder, numbered=True, host=BINARY_HOST, ids=True)
