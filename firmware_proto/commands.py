"""Commands of a host to its receiver, and the answers: values and binary format. See PROTOCOL.md."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from functools import partial
from typing import Final, NamedTuple

from firmware_proto.messages import Kind, MessageDecoder, StreamDecoder, seal

IDENTIFY: Final = "identify"
MARK: Final = "mark"
UNMARK: Final = "unmark"
SELECT: Final = "select"
RESTART: Final = "restart"
CHANNELS: Final = "channels"
SCAN: Final = "scan"
SEARCH: Final = "search"
NAMES: Final = (IDENTIFY, MARK, UNMARK, SELECT, RESTART, CHANNELS, SCAN, SEARCH)  # codes 1…8

DONE: Final = "done"
REFUSED: Final = "refused"
UNKNOWN: Final = "unknown"
BUSY: Final = "busy"
RESULTS: Final = (DONE, REFUSED, UNKNOWN, BUSY)  # 0…3

MAX_VALUES: Final = 4
MAX_TEXT: Final = 32
COMMAND_KIND: Final = 16
ANSWER_KIND: Final = 17

_NAME: Final = re.compile(r"[a-z][a-z0-9-]{0,15}")
_TEXT: Final = re.compile(rf"[ -#%-)+\x2d-~]{{0,{MAX_TEXT}}}")  # printable ASCII without `$`, `*` and `,`
_CODES: Final = {name: code for code, name in enumerate(NAMES, 1)}
_OTHER: Final = "command-"  # and its code: a command without a name in NAMES


class Command(NamedTuple):
    """A command. `number`: 0…255, repeated in the answer; `name`: one of NAMES, or another; `values`: at most 4, int32.

    A command of the binary format without a name in NAMES is `command-` and its code, 0…255.
    """

    number: int
    name: str
    values: tuple[int, ...] = ()


class CommandAnswer(NamedTuple):
    """The answer to a command. `result`: one of RESULTS. `text`: printable ASCII, 32 at most, without `$*,`."""

    number: int
    name: str
    result: str
    values: tuple[int, ...] = ()
    text: str = ""


class HostForm(NamedTuple):
    """The format of commands (from the host) and answers (from the receiver) on a port.

    The encoders raise ValueError with the field that does not fit. Each decoder is for one stream of bytes.
    """

    command: Callable[[Command], bytes]
    commands: Callable[[], StreamDecoder[Command]]
    answer: Callable[[CommandAnswer], bytes]
    answers: Callable[[], StreamDecoder[CommandAnswer]]


def check_command(command: Command | CommandAnswer) -> None:
    """Raise ValueError with the field and its range if number, name or values cannot be encoded."""
    if not isinstance(command.number, int) or not 0 <= command.number <= 255:
        raise ValueError(f"number is {command.number!r}, expected an integer 0…255")
    if not _NAME.fullmatch(command.name):
        raise ValueError(f"name is {command.name!r}, expected 1…16 lower-case letters, digits and hyphens")
    if len(command.values) > MAX_VALUES:
        raise ValueError(f"{len(command.values)} values, expected {MAX_VALUES} at most")
    for k, value in enumerate(command.values):
        if not isinstance(value, int) or not -(2**31) <= value < 2**31:
            raise ValueError(f"values[{k}] is {value!r}, expected an integer of 32 bits")


def check_answer(answer: CommandAnswer) -> None:
    """Raise ValueError like `check_command`, for an answer."""
    check_command(answer)
    if answer.result not in RESULTS:
        raise ValueError(f"result is {answer.result!r}, expected one of {', '.join(RESULTS)}")
    if not _TEXT.fullmatch(answer.text):
        raise ValueError(f"text is {answer.text!r}, expected {MAX_TEXT} printable ASCII characters at most, no $*,")


def encode_command(command: Command) -> bytes:
    """Return the 10 + 4·values bytes of a command. Raises ValueError with the field that does not fit."""
    check_command(command)
    return seal(COMMAND_KIND, bytes([command.number, _code(command.name)]) + _pack(command.values))


def encode_answer(answer: CommandAnswer) -> bytes:
    """Return the 12 + 4·values + text bytes of an answer. Raises ValueError with the field that does not fit."""
    check_answer(answer)
    head = bytes([answer.number, _code(answer.name), RESULTS.index(answer.result), len(answer.values)])
    return seal(ANSWER_KIND, head + _pack(answer.values) + answer.text.encode())


def _code(name: str) -> int:
    if name in _CODES:
        return _CODES[name]
    code = name.removeprefix(_OTHER)
    if name != code and code.isdecimal() and int(code) < 256 and _name(int(code)) == name:
        return int(code)
    raise ValueError(f"name is {name!r}, expected one of {', '.join(NAMES)}, or {_OTHER} and a code without a name")


def _name(code: int) -> str:
    return NAMES[code - 1] if 1 <= code <= len(NAMES) else f"{_OTHER}{code}"


def _pack(values: tuple[int, ...]) -> bytes:
    return struct.pack(f"<{len(values)}i", *values)


def _command(body: bytes) -> Command:
    return Command(body[0], _name(body[1]), struct.unpack(f"<{len(body) // 4}i", body[2:]))


def _answer(body: bytes) -> CommandAnswer | None:
    number, code, result, n = body[:4]
    end = 4 + 4 * n
    text = body[end:].decode("latin-1")
    if result >= len(RESULTS) or n > MAX_VALUES or end > len(body) or not _TEXT.fullmatch(text):
        return None
    return CommandAnswer(number, _name(code), RESULTS[result], struct.unpack(f"<{n}i", body[4:end]), text)


COMMAND: Final = Kind(frozenset(2 + 4 * n for n in range(MAX_VALUES + 1)), _command)
ANSWER: Final = Kind(frozenset(range(4, 4 + 4 * MAX_VALUES + MAX_TEXT + 1)), _answer)

BINARY_HOST: Final = HostForm(
    encode_command,
    partial(MessageDecoder[Command], {COMMAND_KIND: COMMAND}),
    encode_answer,
    partial(MessageDecoder[CommandAnswer], {ANSWER_KIND: ANSWER}),
)
