"""The codec of frames in C, with the methods of firmware_proto.Decoder and encode."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

from firmware_proto import MAX_CHANNELS, MAX_FRAME_BYTES, Channel, Frame
from tools.codecs.c_code import I16, NEVER, SOURCE, U8, U32, Decoding, fields, library, written


class _Channel(ctypes.Structure):
    _fields_ = fields(id=U8, zone=U8, marked=U8, d_cm=I16, delta_deg=I16)


class _Frame(ctypes.Structure):
    _fields_ = fields(sequence=U8, status=U8, n=U8, channels=_Channel * MAX_CHANNELS)


ON_FRAME = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.POINTER(_Frame))


class State(ctypes.Structure):
    _fields_ = [
        *fields(good=U32, bad_crc=U32, dropped=U32, lost=U32, on_frame=ON_FRAME, context=ctypes.c_void_p),
        *fields(now_ms=U32, frame_ms=U32, held=U8 * MAX_FRAME_BYTES, came=U8 * MAX_FRAME_BYTES),
        *fields(count=U8, heard=U8, counting=U8, sequence=U8),
    ]


class Codec:
    """The compiled codec, built in `folder` if it is not there."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.library = library(folder, "arva_frame", *options, SOURCE)
        decoder = ctypes.POINTER(State)
        signatures: dict[str, tuple[Any, ...]] = {
            "arva_decoder_init": (None, decoder, ON_FRAME, ctypes.c_void_p),
            "arva_decoder_push": (ctypes.c_size_t, decoder, ctypes.c_uint8, ctypes.c_uint32),
            "arva_decoder_feed": (ctypes.c_size_t, decoder, ctypes.c_char_p, ctypes.c_size_t, ctypes.c_uint32),
            "arva_decoder_age_ms": (ctypes.c_uint32, decoder, ctypes.c_uint32),
            "arva_encode": (ctypes.c_size_t, ctypes.POINTER(_Frame), ctypes.c_char_p, ctypes.c_size_t),
            "arva_crc": (ctypes.c_uint16, ctypes.c_char_p, ctypes.c_size_t),
        }
        for name, (result, *arguments) in signatures.items():
            function = getattr(self.library, name)
            function.restype, function.argtypes = result, arguments

    def encode(self, frame: Frame, capacity: int = MAX_FRAME_BYTES) -> bytes:
        """Empty when the frame is refused."""
        raw = _Frame(frame.sequence, frame.status, len(frame.channels))
        for to, c in zip(raw.channels, frame.channels, strict=False):
            to.id, to.zone, to.marked = 255 if c.id is None else c.id, c.zone, c.marked
            to.d_cm, to.delta_deg = c.d, c.delta
        return written(self.library.arva_encode, raw, capacity)

    def crc(self, data: bytes) -> int:
        return int(self.library.arva_crc(data, len(data)))


class CDecoder(Decoding):
    """A firmware_proto.Decoder that is the C one."""

    def __init__(self, codec: Codec, epoch_ms: int = 0) -> None:
        super().__init__(codec.library, State(), epoch_ms)
        self._handler = ON_FRAME(self._on_frame)
        self._library.arva_decoder_init(self._at, self._handler, None)

    def age_ms(self, now: float) -> int:
        return int(self._library.arva_decoder_age_ms(self._at, (round(1000 * now) + self._epoch_ms) & NEVER))

    def _push(self, chunk: bytes, now_ms: int) -> int:
        if len(chunk) == 1:
            return int(self._library.arva_decoder_push(self._at, chunk[0], now_ms))
        return int(self._library.arva_decoder_feed(self._at, chunk or None, len(chunk), now_ms))

    def _on_frame(self, _: int | None, frame: Any) -> None:
        raw = frame.contents
        channels = [
            Channel(None if c.id == 255 else c.id, c.zone, c.d_cm, c.delta_deg, bool(c.marked)) for c in raw.channels
        ]
        assert set(channels[raw.n :]) <= {Channel()}
        self._came.append(Frame(raw.sequence, raw.status, tuple(channels[: raw.n])))

    lost = property(lambda self: self._state.lost)
