"""The messages of firmware_proto/c/arva_message.c: the same as Python's decoders give."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

from firmware_proto import Command, CommandAnswer, LevelChannel, Measured, VectorChannel
from firmware_proto.commands import ANSWER, ANSWER_KIND, COMMAND, COMMAND_KIND, NAMES, RESULTS
from firmware_proto.measured import LEVEL_KIND, LEVELS, VECTOR_KIND, VECTORS, MeasuredMessage
from firmware_proto.messages import Kind, MessageDecoder
from tools.codecs.c_code import I16, I32, MESSAGES, SOURCE, U8, U16, U32, Decoding, fields, library, written

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


class State(ctypes.Structure):
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
        super().__init__(code.library, State(), epoch_ms)
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
