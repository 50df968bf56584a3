"""The formats `vector` and `rssi`: a message with measurements before each frame. See PROTOCOL.md."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, Final, NamedTuple, TypeVar

from firmware_proto.binary import encode, frame_at, size_at
from firmware_proto.commands import BINARY_HOST
from firmware_proto.frame import MARKED, MAX_CHANNELS, Frame, FrameDecoder, LevelChannel, Measured, VectorChannel
from firmware_proto.messages import Kind, MessageDecoder, seal
from firmware_proto.wire_format import Format

C = TypeVar("C", VectorChannel, LevelChannel)

VECTOR_KIND: Final = 1
LEVEL_KIND: Final = 2
LONGEST_AGE_MS: Final = 65534  # this or more; 65535 on the wire: no pulse
NO_CARRIER: Final = -0x8000  # on the wire
NO_LEVEL: Final = -0x8000
MAX_EXPONENT: Final = 16

_NO_ID: Final = 255
_NO_AGE: Final = 65535
_HEAD: Final = struct.Struct("<BBBI")  # sequence, status, n, time
_VECTOR: Final = struct.Struct("<BBBhhhHhH")  # id, zone, exponent, x, y, z, period, carrier, age
_LEVEL: Final = struct.Struct("<BBhH")  # id, zone, level, age
_MESSAGE_BYTES: Final = 8 + _HEAD.size  # without channels
_FINEST: Final = 100.0  # of the amplitudes, in 1 nA/m


class MeasuredMessage(NamedTuple):
    """The content of a message: `sequence` and `status` are those of the frame that follows it."""

    sequence: int
    status: int
    measured: Measured


def vector_channel(
    id: int | None,
    zone: int,
    marked: bool,
    signal_na_m: Iterable[float],
    period_s: float | None,
    carrier_hz: float | None,
    age_s: float,
) -> VectorChannel:
    """Return a pulse for the wire: rounded and limited."""
    x, y, z = exponent_of(*(_limited(_FINEST * one, 2**31 - 2**16) for one in signal_na_m))[1]
    period = 0 if period_s is None else _limited(1e4 * period_s, 65535, 0)
    carrier = None if carrier_hz is None else _limited(10 * carrier_hz, 0x7FFF)
    return VectorChannel(id, zone, marked, x, y, z, period, carrier, _age(age_s))


def level_channel(id: int | None, zone: int, marked: bool, level_db: float, age_s: float) -> LevelChannel:
    """Return the strength of a pulse for the wire."""
    return LevelChannel(id, zone, marked, _limited(100 * level_db, 0x7FFF), _age(age_s))


def exponent_of(*amplitudes: int) -> tuple[int, list[int]]:
    """Return the exponent of amplitudes on the wire, and the decoded amplitudes: mantissa · 2^exponent.

    The exponent is the lowest with which all mantissas fit in 16 bits; mantissas are rounded half away from 0.
    Raises ValueError for an amplitude that does not fit with the highest exponent.
    """
    peak = max(map(abs, amplitudes))
    for exponent in range(MAX_EXPONENT + 1):
        half = 1 << exponent >> 1
        if peak + half >> exponent <= 0x7FFF:
            return exponent, [int(math.copysign(abs(one) + half >> exponent << exponent, one)) for one in amplitudes]
    raise ValueError(f"an amplitude is {peak}, expected {0x7FFF << MAX_EXPONENT} at most")


def encode_vector(frame: Frame) -> bytes:
    """Return a frame with the message before it. Raises ValueError with the field that does not fit."""
    return _message(frame, VECTOR_KIND, VectorChannel, _pack_vector) + encode(frame)


def encode_rssi(frame: Frame) -> bytes:
    """Return the same for levels."""
    return _message(frame, LEVEL_KIND, LevelChannel, _pack_level) + encode(frame)


def _message(frame: Frame, kind: int, channel: type[C], pack: Callable[[C], bytes]) -> bytes:
    """Return the message before a frame; empty channels without measurements."""
    measured = frame.measured or Measured(0, tuple(channel(c.id, c.zone, c.marked) for c in frame.channels))
    if len(measured.channels) != len(frame.channels) or len(frame.channels) > MAX_CHANNELS:
        raise ValueError(f"measured has {len(measured.channels)} channels, expected {len(frame.channels)}")
    channels = [one for one in measured.channels if isinstance(one, channel)]
    if len(channels) < len(measured.channels):
        raise ValueError("measured is of another format")
    try:
        head = _HEAD.pack(frame.sequence, frame.status, len(frame.channels), measured.time_ms)
        return seal(kind, head + b"".join(map(pack, channels)))
    except struct.error as error:
        raise ValueError(f"measured does not fit: {error}") from None


def _pack_vector(c: VectorChannel) -> bytes:
    exponent, _ = exponent_of(c.x, c.y, c.z)
    half = 1 << exponent >> 1
    mantissas = [(abs(one) + half >> exponent) * (1 if one > 0 else -1) for one in (c.x, c.y, c.z)]
    carrier = NO_CARRIER if c.carrier is None else c.carrier
    return _VECTOR.pack(*_who(c), exponent, *mantissas, c.period, carrier, _age_on_wire(c.age_ms))


def _pack_level(c: LevelChannel) -> bytes:
    return _LEVEL.pack(*_who(c), NO_LEVEL if c.level is None else c.level, _age_on_wire(c.age_ms))


def _who(c: VectorChannel | LevelChannel) -> tuple[int, int]:
    return _NO_ID if c.id is None else c.id, c.zone | (MARKED if c.marked else 0)


def _age_on_wire(age_ms: int | None) -> int:
    return _NO_AGE if age_ms is None else min(age_ms, LONGEST_AGE_MS)


def _age(age_s: float) -> int:
    return _limited(1e3 * age_s, LONGEST_AGE_MS, 0)


def _limited(value: float, most: int, least: int | None = None) -> int:
    """Return a rounded value, limited to ±`most`, or from `least` to `most`."""
    return round(min(max(value, -most if least is None else least), most))


def _parse(body: bytes, layout: struct.Struct, channel: Callable[..., Any]) -> MeasuredMessage | None:
    sequence, status, n, time_ms = _HEAD.unpack_from(body)
    if len(body) != _HEAD.size + n * layout.size:
        return None
    channels = []
    for id, zone, *values in layout.iter_unpack(body[_HEAD.size :]):
        if (made := channel(None if id == _NO_ID else id, zone & ~MARKED, zone >= MARKED, *values)) is None:
            return None
        channels.append(made)
    return MeasuredMessage(sequence, status, Measured(time_ms, tuple(channels)))


def _vector(id: int | None, zone: int, marked: bool, exponent: int, *values: int) -> VectorChannel | None:
    x, y, z, period, carrier, age_ms = values
    if exponent > MAX_EXPONENT:
        return None
    scale = 1 << exponent
    offset = None if carrier == NO_CARRIER else carrier
    return VectorChannel(id, zone, marked, x * scale, y * scale, z * scale, period, offset, _age_of(age_ms))


def _level(id: int | None, zone: int, marked: bool, level: int, age_ms: int) -> LevelChannel:
    return LevelChannel(id, zone, marked, None if level == NO_LEVEL else level, _age_of(age_ms))


def _age_of(age_ms: int) -> int | None:
    return None if age_ms == _NO_AGE else age_ms


def _lengths(layout: struct.Struct) -> frozenset[int]:
    return frozenset(_HEAD.size + layout.size * n for n in range(1, MAX_CHANNELS + 1))


VECTORS: Final[Kind[MeasuredMessage | Frame]] = Kind(
    _lengths(_VECTOR), partial(_parse, layout=_VECTOR, channel=_vector)
)
LEVELS: Final[Kind[MeasuredMessage | Frame]] = Kind(_lengths(_LEVEL), partial(_parse, layout=_LEVEL, channel=_level))


class MixedDecoder(MessageDecoder[MeasuredMessage | Frame]):
    """Decoder of messages of some kinds and frames of version 1, in their order."""

    def _size(self, data: bytes, at: int) -> int:
        return size_at(data, at) if data[at + 2 : at + 3] == b"\1" else super()._size(data, at)

    def _content(self, data: bytes, at: int, stop: int) -> MeasuredMessage | Frame | None:
        return frame_at(data, at, stop) if data[at + 2] == 1 else super()._content(data, at, stop)


class MeasuredDecoder(FrameDecoder):
    """Decoder of frames, each with the measurements if the message right before it has its sequence number.

    A message without its frame counts as dropped bytes.
    """

    def __init__(self, kind: int, messages: Kind[MeasuredMessage | Frame]) -> None:
        super().__init__()
        self._mixed = MixedDecoder({kind: messages})
        self._channel_bytes = _VECTOR.size if kind == VECTOR_KIND else _LEVEL.size
        self._message: MeasuredMessage | None = None  # the newest, without its frame yet
        self._alone = 0  # bytes of messages without their frame

    def feed(self, chunk: bytes, now: float) -> list[Frame]:
        """Return the frames completed by `chunk`. See FrameDecoder."""
        frames = []
        for one in self._mixed.feed(chunk, now):
            if isinstance(one, MeasuredMessage):
                self._drop_message()
                self._message = one
            else:
                self._count(one.sequence)
                frames.append(self._with_measured(one))
        self.bad_crc = self._mixed.bad_crc
        self.dropped = self._mixed.dropped + self._alone
        return frames

    def _with_measured(self, frame: Frame) -> Frame:
        message = self._message
        if message and (message.sequence, len(message.measured.channels)) == (frame.sequence, len(frame.channels)):
            self._message = None
            return frame._replace(measured=message.measured)
        self._drop_message()
        return frame

    def _drop_message(self) -> None:
        if self._message:
            self._alone += _MESSAGE_BYTES + self._channel_bytes * len(self._message.measured.channels)
            self._message = None


VECTOR: Final = Format(
    encode_vector,
    partial(MeasuredDecoder, VECTOR_KIND, VECTORS),
    numbered=True,
    host=BINARY_HOST,
    measured="vector",
)
RSSI: Final = Format(
    encode_rssi, partial(MeasuredDecoder, LEVEL_KIND, LEVELS), numbered=True, host=BINARY_HOST, measured="level"
)
