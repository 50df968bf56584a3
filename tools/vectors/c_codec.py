"""firmware_proto/c: compiled, and called from Python, with the methods of the decoders in Python."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

from firmware_proto import (
    MAX_CHANNELS,
    MAX_FRAME_BYTES,
    Channel,
    Command,
    CommandAnswer,
    Frame,
    LevelChannel,
    Measured,
    VectorChannel,
)
from firmware_proto.commands import ANSWER, ANSWER_KIND, COMMAND, COMMAND_KIND, NAMES, RESULTS
from firmware_proto.measured import LEVEL_KIND, LEVELS, VECTOR_KIND, VECTORS, MeasuredMessage
from firmware_proto.messages import Kind, MessageDecoder

FOLDER = Path(__file__).parents[2] / "firmware_proto" / "c"
SOURCE = FOLDER / "arva_frame.c"
MESSAGES = FOLDER / "arva_message.c"  # needs SOURCE
STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
NEVER = 2**32 - 1
U8, U16, U32, I16, I32 = ctypes.c_uint8, ctypes.c_uint16, ctypes.c_uint32, ctypes.c_int16, ctypes.c_int32


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


def library(folder: Path, name: str, *options: str | Path) -> ctypes.CDLL:
    """Flags and sources as a library, built in `folder` if it is not there."""
    target = folder / f"lib{name}.so"
    if not target.exists():
        compile_c(compiler(), target, "-std=c99", "-O2", "-shared", "-fPIC", *options)
    return ctypes.CDLL(str(target))


def fields(**types: Any) -> list[tuple[str, Any]]:
    """Of a ctypes.Structure, in their order."""
    return list(types.items())


def written(function: Any, raw: ctypes.Structure, capacity: int) -> bytes:
    """Return the output of an encoder; empty if it refuses. Raises AssertionError for a wrong number of bytes."""
    out = ctypes.create_string_buffer(b"\xee" * (capacity + 8))
    size: int = function(ctypes.byref(raw), out, ctypes.c_size_t(capacity))
    assert out.raw[size:-1] == b"\xee" * (capacity + 8 - size)
    return out.raw[:size]


class Decoding:
    """A C decoder with the methods of those in Python: `now` in seconds is rounded to milliseconds after `epoch_ms`."""

    def __init__(self, library: ctypes.CDLL, state: Any, epoch_ms: int) -> None:
        self._library = library
        self._state = state
        self._at = ctypes.byref(state)
        self._epoch_ms = epoch_ms
        self._came: list[Any] = []

    def feed(self, chunk: bytes, now: float) -> list[Any]:
        return self.feed_ms(chunk, round(1000 * now))

    def feed_ms(self, chunk: bytes, now_ms: int) -> list[Any]:
        self._came = []
        count = self._push(bytes(chunk), (now_ms + self._epoch_ms) & NEVER)
        assert count == len(self._came)
        return self._came

    def _push(self, chunk: bytes, now_ms: int) -> int:
        raise NotImplementedError

    good = property(lambda self: self._state.good)
    bad_crc = property(lambda self: self._state.bad_crc)
    dropped = property(lambda self: self._state.dropped)


class _Channel(ctypes.Structure):
    _fields_ = fields(id=U8, zone=U8, marked=U8, d_cm=I16, delta_deg=I16)


class _Frame(ctypes.Structure):
    _fields_ = fields(sequence=U8, status=U8, n=U8, channels=_Channel * MAX_CHANNELS)


ON_FRAME = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.POINTER(_Frame))


class FrameState(ctypes.Structure):
    _fields_ = [
        *fields(good=U32, bad_crc=U32, dropped=U32, lost=U32, on_frame=ON_FRAME, context=ctypes.c_void_p),
        *fields(now_ms=U32, frame_ms=U32, held=U8 * MAX_FRAME_BYTES, came=U8 * MAX_FRAME_BYTES),
        *fields(count=U8, heard=U8, counting=U8, sequence=U8),
    ]


class Codec:
    """The compiled codec, built in `folder` if it is not there."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.library = library(folder, "arva_frame", *options, SOURCE)
        decoder = ctypes.POINTER(FrameState)
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
        super().__init__(codec.library, FrameState(), epoch_ms)
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


KINDS: dict[int, Kind[Any]] = {VECTOR_KIND: VECTORS, LEVEL_KIND: LEVELS, COMMAND_KIND: COMMAND, ANSWER_KIND: ANSWER}
WANT_ALL = 15


def python_decoder() -> MessageDecoder[Any]:
    """The one that C's and Lua's are compared with: all kinds."""
    return MessageDecoder(KINDS)


class _Message(ctypes.Structure):
    _fields_ = fields(kind=U8, size=U8, body=ctypes.c_void_p)


class _Command(ctypes.Structure):
    _fields_ = fields(number=U8, code=U8, count=U8, values=I32 * 4)


class _Answer(ctypes.Structure):
    _fields_ = fields(number=U8, code=U8, result=U8, count=U8, values=I32 * 4, text=ctypes.c_char * 33)


class _Pulse(ctypes.Structure):
    _fields_ = [
        *fields(id=U8, zone=U8, marked=U8, x=I32, y=I32, z=I32),
        *fields(period=U16, carrier=I16, level=I16, age_ms=U16),
    ]


class _Measured(ctypes.Structure):
    _fields_ = fields(sequence=U8, status=U8, n=U8, time_ms=U32)


ON_MESSAGE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.POINTER(_Message))


class MessageState(ctypes.Structure):
    _fields_ = [
        *fields(good=U32, bad_crc=U32, dropped=U32, on_message=ON_MESSAGE, context=ctypes.c_void_p),
        *fields(now_ms=U32, held=U8 * 255, came=U8 * 255, count=U8, want=U8),
    ]


class Request(ctypes.Structure):
    _fields_ = fields(command=_Command, sent_ms=U32, waiting=U8)


class CMessages:
    """The compiled code, built in `folder` if it is not there."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.library = library(folder, "arva_message", *options, MESSAGES, SOURCE)
        for name in ("send", "again", "encode"):
            getattr(self.library, f"arva_command_{name}").restype = ctypes.c_size_t
        self.library.arva_answer_encode.restype = ctypes.c_size_t
        self.library.arva_message_decoder_feed.restype = ctypes.c_size_t

    def encode(self, message: Command | CommandAnswer, capacity: int = 255) -> bytes:
        """Empty when it is refused."""
        raw: Any
        if isinstance(message, CommandAnswer):
            raw = _Answer(message.number, code_of(message.name), RESULTS.index(message.result), len(message.values))
            raw.text = message.text.encode()
            function = self.library.arva_answer_encode
        else:
            raw = _Command(message.number, code_of(message.name), len(message.values))
            function = self.library.arva_command_encode
        for k, value in enumerate(message.values[:4]):
            raw.values[k] = value
        return written(function, raw, capacity)


class CMessageDecoder(Decoding):
    """A firmware_proto.messages.MessageDecoder that is the C one; `want`: the kinds, as bits."""

    def __init__(self, code: CMessages, epoch_ms: int = 0, want: int = WANT_ALL) -> None:
        super().__init__(code.library, MessageState(), epoch_ms)
        self._handler = ON_MESSAGE(self._on_message)
        self._library.arva_message_decoder_init(self._at, U8(want), self._handler, None)

    def _push(self, chunk: bytes, now_ms: int) -> int:
        size = ctypes.c_size_t(len(chunk))
        return int(self._library.arva_message_decoder_feed(self._at, chunk or None, size, U32(now_ms)))

    def _on_message(self, _: int | None, message: Any) -> None:
        library = self._library
        command, answer, measured = _Command(), _Answer(), _Measured()
        got = [
            library.arva_command_get(message, ctypes.byref(command)),
            library.arva_answer_get(message, ctypes.byref(answer)),
            library.arva_measured_get(message, ctypes.byref(measured)),
        ]
        assert sum(got) == 1
        if got[0]:
            values = tuple(command.values[: command.count])
            self._came.append(Command(command.number, name_of(command.code), values))
        elif got[1]:
            values, result = tuple(answer.values[: answer.count]), RESULTS[answer.result]
            text = answer.text.decode()
            self._came.append(CommandAnswer(answer.number, name_of(answer.code), result, values, text))
        else:
            channels = tuple(self._pulse(message, k) for k in range(measured.n))
            assert not library.arva_pulse_get(message, ctypes.c_size_t(measured.n), ctypes.byref(_Pulse()))
            said = Measured(measured.time_ms, channels)
            self._came.append(MeasuredMessage(measured.sequence, measured.status, said))

    def _pulse(self, message: Any, k: int) -> Any:
        pulse = _Pulse()
        assert self._library.arva_pulse_get(message, ctypes.c_size_t(k), ctypes.byref(pulse))
        who = None if pulse.id == 255 else pulse.id, pulse.zone, bool(pulse.marked)
        age_ms = None if pulse.age_ms == 65535 else pulse.age_ms
        if message.contents.kind == LEVEL_KIND:
            return LevelChannel(*who, None if pulse.level == -0x8000 else pulse.level, age_ms)
        carrier = None if pulse.carrier == -0x8000 else pulse.carrier
        return VectorChannel(*who, pulse.x, pulse.y, pulse.z, pulse.period, carrier, age_ms)


def name_of(code: int) -> str:
    return NAMES[code - 1] if 1 <= code <= len(NAMES) else f"command-{code}"


def code_of(name: str) -> int:
    return NAMES.index(name) + 1 if name in NAMES else int(name.removeprefix("command-"))
