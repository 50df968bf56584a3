"""firmware_proto/c, compiled and called from Python: the same face as firmware_proto.Decoder and encode."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

from firmware_proto import MAX_CHANNELS, MAX_FRAME_BYTES, Channel, Frame

FOLDER = Path(__file__).parent.parent / "firmware_proto" / "c"
SOURCE = FOLDER / "arva_frame.c"
STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
NEVER = 2**32 - 1


def compiler(*names: str) -> str:
    """The first of `names` that is installed; by default $CC or the system's."""
    names = names or (os.environ.get("CC", "cc"), "gcc", "clang")
    for name in names:
        if shutil.which(name):
            return name
    raise FileNotFoundError(f"no C compiler: none of {', '.join(names)} is installed; on Debian: apt-get install gcc")


def compile_c(command: str, target: Path, *options: str | Path) -> Path:
    """Run a compiler, `options` being flags and sources. Raises CalledProcessError; the errors go to stderr."""
    subprocess.run([command, *STRICT, f"-I{FOLDER}", *options, "-o", target], check=True)
    return target


class _Channel(ctypes.Structure):
    _fields_ = (
        ("id", ctypes.c_uint8),
        ("zone", ctypes.c_uint8),
        ("marked", ctypes.c_uint8),
        ("d_cm", ctypes.c_int16),
        ("delta_deg", ctypes.c_int16),
    )


class _Frame(ctypes.Structure):
    _fields_ = (
        ("sequence", ctypes.c_uint8),
        ("status", ctypes.c_uint8),
        ("n", ctypes.c_uint8),
        ("channels", _Channel * MAX_CHANNELS),
    )


ON_FRAME = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.POINTER(_Frame))


class State(ctypes.Structure):
    _fields_ = (
        ("good", ctypes.c_uint32),
        ("bad_crc", ctypes.c_uint32),
        ("dropped", ctypes.c_uint32),
        ("lost", ctypes.c_uint32),
        ("on_frame", ON_FRAME),
        ("context", ctypes.c_void_p),
        ("now_ms", ctypes.c_uint32),
        ("frame_ms", ctypes.c_uint32),
        ("held", ctypes.c_uint8 * MAX_FRAME_BYTES),
        ("came", ctypes.c_uint8 * MAX_FRAME_BYTES),
        ("count", ctypes.c_uint8),
        ("heard", ctypes.c_uint8),
        ("counting", ctypes.c_uint8),
        ("sequence", ctypes.c_uint8),
    )


class Codec:
    """The compiled codec, built in `folder` if it is not there."""

    def __init__(self, folder: Path, *options: str) -> None:
        target = folder / "libarva_frame.so"
        if not target.exists():
            compile_c(compiler(), target, "-std=c99", "-O2", "-shared", "-fPIC", *options, SOURCE)
        self.library = library = ctypes.CDLL(str(target))
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
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments

    def encode(self, frame: Frame, capacity: int = MAX_FRAME_BYTES) -> bytes:
        """Empty when the frame is refused. Raises AssertionError when more or less than it says was written."""
        raw = _Frame(frame.sequence, frame.status, len(frame.channels))
        for to, c in zip(raw.channels, frame.channels, strict=False):
            to.id, to.zone, to.marked = 255 if c.id is None else c.id, c.zone, c.marked
            to.d_cm, to.delta_deg = c.d, c.delta
        out = ctypes.create_string_buffer(b"\xee" * (capacity + 8))
        size: int = self.library.arva_encode(raw, out, capacity)
        assert out.raw[size:-1] == b"\xee" * (capacity + 8 - size)
        return out.raw[:size]

    def crc(self, data: bytes) -> int:
        return int(self.library.arva_crc(data, len(data)))


class CDecoder:
    """A firmware_proto.Decoder that is the C one: `now` in seconds is rounded to milliseconds after `epoch_ms`."""

    def __init__(self, codec: Codec, epoch_ms: int = 0) -> None:
        self._library = codec.library
        self._epoch_ms = epoch_ms
        self._frames: list[Frame] = []
        self._handler = ON_FRAME(self._on_frame)
        self._state = State()
        self._at = ctypes.byref(self._state)
        self._library.arva_decoder_init(self._at, self._handler, None)

    def feed(self, chunk: bytes, now: float) -> list[Frame]:
        return self.feed_ms(chunk, round(1000 * now))

    def feed_ms(self, chunk: bytes, now_ms: int) -> list[Frame]:
        self._frames = []
        now_ms = (now_ms + self._epoch_ms) & NEVER
        if len(chunk) == 1:
            count = self._library.arva_decoder_push(self._at, chunk[0], now_ms)
        else:
            count = self._library.arva_decoder_feed(self._at, bytes(chunk) or None, len(chunk), now_ms)
        assert count == len(self._frames)
        return self._frames

    def age_ms(self, now: float) -> int:
        return int(self._library.arva_decoder_age_ms(self._at, (round(1000 * now) + self._epoch_ms) & NEVER))

    def _on_frame(self, _: int | None, frame: Any) -> None:
        raw = frame.contents
        channels = [
            Channel(None if c.id == 255 else c.id, c.zone, c.d_cm, c.delta_deg, bool(c.marked)) for c in raw.channels
        ]
        assert set(channels[raw.n :]) <= {Channel()}
        self._frames.append(Frame(raw.sequence, raw.status, tuple(channels[: raw.n])))

    good = property(lambda self: self._state.good)
    bad_crc = property(lambda self: self._state.bad_crc)
    dropped = property(lambda self: self._state.dropped)
    lost = property(lambda self: self._state.lost)
