"""firmware_proto/c/arva_message.c, compiled and called from Python: the same messages as Python's decoders give."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

from firmware_proto import Answer, Command, LevelChannel, Measured, VectorChannel
from firmware_proto.commands import ANSWER, ANSWER_KIND, COMMAND, COMMAND_KIND, NAMES, RESULTS
from firmware_proto.measured import LEVEL_KIND, LEVELS, VECTOR_KIND, VECTORS, MeasuredMessage
from firmware_proto.messages import Kind, MessageDecoder
from tools.c_codec import FOLDER, SOURCE, compile_c, compiler

MESSAGES = FOLDER / "arva_message.c"
KINDS: dict[int, Kind[Any]] = {VECTOR_KIND: VECTORS, LEVEL_KIND: LEVELS, COMMAND_KIND: COMMAND, ANSWER_KIND: ANSWER}
WANT_ALL = 15
NEVER = 2**32 - 1


def python_decoder() -> MessageDecoder[Any]:
    """The one that C's and Lua's are compared with: all kinds."""
    return MessageDecoder(KINDS)


class _Message(ctypes.Structure):
    _fields_ = (("kind", ctypes.c_uint8), ("size", ctypes.c_uint8), ("body", ctypes.c_void_p))


class _Command(ctypes.Structure):
    _fields_ = (
        ("number", ctypes.c_uint8),
        ("code", ctypes.c_uint8),
        ("count", ctypes.c_uint8),
        ("values", ctypes.c_int32 * 4),
    )


class _Answer(ctypes.Structure):
    _fields_ = (
        ("number", ctypes.c_uint8),
        ("code", ctypes.c_uint8),
        ("result", ctypes.c_uint8),
        ("count", ctypes.c_uint8),
        ("values", ctypes.c_int32 * 4),
        ("text", ctypes.c_char * 33),
    )


class _Pulse(ctypes.Structure):
    _fields_ = (
        ("id", ctypes.c_uint8),
        ("zone", ctypes.c_uint8),
        ("marked", ctypes.c_uint8),
        ("x", ctypes.c_int32),
        ("y", ctypes.c_int32),
        ("z", ctypes.c_int32),
        ("period", ctypes.c_uint16),
        ("carrier", ctypes.c_int16),
        ("level", ctypes.c_int16),
        ("age_ms", ctypes.c_uint16),
    )


class _Measured(ctypes.Structure):
    _fields_ = (
        ("sequence", ctypes.c_uint8),
        ("status", ctypes.c_uint8),
        ("n", ctypes.c_uint8),
        ("time_ms", ctypes.c_uint32),
    )


ON_MESSAGE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.POINTER(_Message))


class State(ctypes.Structure):
    _fields_ = (
        ("good", ctypes.c_uint32),
        ("bad_crc", ctypes.c_uint32),
        ("dropped", ctypes.c_uint32),
        ("on_message", ON_MESSAGE),
        ("context", ctypes.c_void_p),
        ("now_ms", ctypes.c_uint32),
        ("held", ctypes.c_uint8 * 255),
        ("came", ctypes.c_uint8 * 255),
        ("count", ctypes.c_uint8),
        ("want", ctypes.c_uint8),
    )


class Request(ctypes.Structure):
    _fields_ = (("command", _Command), ("sent_ms", ctypes.c_uint32), ("waiting", ctypes.c_uint8))


class CMessages:
    """The compiled code, built in `folder` if it is not there."""

    def __init__(self, folder: Path, *options: str) -> None:
        target = folder / "libarva_message.so"
        if not target.exists():
            compile_c(compiler(), target, "-std=c99", "-O2", "-shared", "-fPIC", *options, MESSAGES, SOURCE)
        self.library = ctypes.CDLL(str(target))
        for name in ("send", "again", "encode"):
            getattr(self.library, f"arva_command_{name}").restype = ctypes.c_size_t
        self.library.arva_answer_encode.restype = ctypes.c_size_t
        self.library.arva_message_decoder_feed.restype = ctypes.c_size_t

    def encode(self, message: Command | Answer, capacity: int = 255) -> bytes:
        """Empty when it is refused. Raises AssertionError when more or less than it says was written."""
        raw: Any
        if isinstance(message, Answer):
            raw = _Answer(message.number, code_of(message.name), RESULTS.index(message.result), len(message.values))
            raw.text = message.text.encode()
            function = self.library.arva_answer_encode
        else:
            raw = _Command(message.number, code_of(message.name), len(message.values))
            function = self.library.arva_command_encode
        for k, value in enumerate(message.values[:4]):
            raw.values[k] = value
        out = ctypes.create_string_buffer(b"\xee" * (capacity + 8))
        size: int = function(ctypes.byref(raw), out, ctypes.c_size_t(capacity))
        assert out.raw[size:-1] == b"\xee" * (capacity + 8 - size)
        return out.raw[:size]


class CMessageDecoder:
    """`now` in seconds is rounded to milliseconds after `epoch_ms`."""

    def __init__(self, code: CMessages, epoch_ms: int = 0, want: int = WANT_ALL) -> None:
        self._library = code.library
        self._epoch_ms = epoch_ms
        self._messages: list[Any] = []
        self._handler = ON_MESSAGE(self._on_message)
        self._state = State()
        self._at = ctypes.byref(self._state)
        self._library.arva_message_decoder_init(self._at, ctypes.c_uint8(want), self._handler, None)

    def feed(self, chunk: bytes, now: float) -> list[Any]:
        return self.feed_ms(chunk, round(1000 * now))

    def feed_ms(self, chunk: bytes, now_ms: int) -> list[Any]:
        self._messages = []
        now = ctypes.c_uint32((now_ms + self._epoch_ms) & NEVER)
        size = ctypes.c_size_t(len(chunk))
        count = self._library.arva_message_decoder_feed(self._at, bytes(chunk) or None, size, now)
        assert count == len(self._messages)
        return self._messages

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
            self._messages.append(Command(command.number, name_of(command.code), values))
        elif got[1]:
            values, result = tuple(answer.values[: answer.count]), RESULTS[answer.result]
            text = answer.text.decode()
            self._messages.append(Answer(answer.number, name_of(answer.code), result, values, text))
        else:
            channels = tuple(self._pulse(message, k) for k in range(measured.n))
            assert not library.arva_pulse_get(message, ctypes.c_size_t(measured.n), ctypes.byref(_Pulse()))
            said = Measured(measured.time_ms, channels)
            self._messages.append(MeasuredMessage(measured.sequence, measured.status, said))

    def _pulse(self, message: Any, k: int) -> Any:
        pulse = _Pulse()
        assert self._library.arva_pulse_get(message, ctypes.c_size_t(k), ctypes.byref(pulse))
        who = None if pulse.id == 255 else pulse.id, pulse.zone, bool(pulse.marked)
        age_ms = None if pulse.age_ms == 65535 else pulse.age_ms
        if message.contents.kind == LEVEL_KIND:
            return LevelChannel(*who, None if pulse.level == -0x8000 else pulse.level, age_ms)
        carrier = None if pulse.carrier == -0x8000 else pulse.carrier
        return VectorChannel(*who, pulse.x, pulse.y, pulse.z, pulse.period, carrier, age_ms)

    good = property(lambda self: self._state.good)
    bad_crc = property(lambda self: self._state.bad_crc)
    dropped = property(lambda self: self._state.dropped)


def name_of(code: int) -> str:
    return NAMES[code - 1] if 1 <= code <= len(NAMES) else f"command-{code}"


def code_of(name: str) -> int:
    return NAMES.index(name) + 1 if name in NAMES else int(name.removeprefix("command-"))
