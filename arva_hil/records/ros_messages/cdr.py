"""CDR: the bytes of ROS 2 messages, little endian, each value aligned to its size from the end of the header.

Neighbouring numbers are packed by one `struct`. There is one for each start position modulo 8.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from itertools import groupby
from operator import attrgetter
from typing import Any, Final, NamedTuple

from arva_hil.records.ros_messages.message import FieldType, Message, field_types

_HEADER: Final = b"\x00\x01\x00\x00"  # encapsulation: CDR, little endian, no options
_CODES: Final = {
    "bool": "?",
    "byte": "B",
    "int8": "b",
    "uint8": "B",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "float32": "f",
    "float64": "d",
}
_LONGEST: Final = 8  # bytes of a number
_Step = Callable[[Any, bytearray], None]
_STEPS: Final[dict[type[Message], list[_Step]]] = {}


def encode(message: Message) -> bytes:
    """Return the bytes of a message. Raises struct.error for a number that its field cannot hold."""
    data = bytearray(_HEADER)
    for step in _steps(type(message)):
        step(message, data)
    return bytes(data)


class _Leaf(NamedTuple):
    path: str  # from the message, with dots
    of: FieldType

    @property
    def is_number(self) -> bool:
        return not self.of.message and not self.of.sequence and self.of.name != "string"


def _steps(cls: type[Message]) -> list[_Step]:
    """Return the functions that write a message; made once for each class."""
    if cls in _STEPS:
        return _STEPS[cls]
    steps = _STEPS[cls] = []
    for is_number, neighbours in groupby(_leaves(cls), lambda leaf: leaf.is_number):
        leaves = list(neighbours)
        steps += [_numbers(leaves)] if is_number else map(_step, leaves)
    return steps


def _leaves(cls: type[Message], prefix: str = "") -> list[_Leaf]:
    """Return the fields of a message and of the messages in it, in their order."""
    leaves = []
    for name, of in field_types(cls).items():
        if of.message and not of.sequence:
            leaves += _leaves(of.message, f"{prefix}{name}.")
        else:
            leaves.append(_Leaf(prefix + name, of))
    return leaves


def _numbers(leaves: Sequence[_Leaf]) -> _Step:
    codes = "".join(_CODES[leaf.of.name] * (leaf.of.length or 1) for leaf in leaves)
    structs = [_packed(codes, length - len(_HEADER)) for length in range(_LONGEST)]
    gets = [(attrgetter(leaf.path), bool(leaf.of.length)) for leaf in leaves]
    if not any(many for _, many in gets) and len(leaves) > 1:
        every = attrgetter(*(leaf.path for leaf in leaves))

        def step(message: Any, data: bytearray) -> None:
            data += structs[len(data) % _LONGEST].pack(*every(message))

        return step

    def step_of_arrays(message: Any, data: bytearray) -> None:
        values: list[Any] = []
        for get, many in gets:
            values += get(message) if many else [get(message)]
        data += structs[len(data) % _LONGEST].pack(*values)

    return step_of_arrays


def _packed(codes: str, at: int) -> struct.Struct:
    """Return the struct of numbers with these codes, from the position `at` on."""
    text = "<"
    for code in codes:
        size = struct.calcsize(code)
        text += "x" * (-at % size) + code
        at += -at % size + size
    return struct.Struct(text)


def _step(leaf: _Leaf) -> _Step:
    get = attrgetter(leaf.path)
    if leaf.of.message:
        steps = _steps(leaf.of.message)

        def of_messages(message: Any, data: bytearray) -> None:
            every = get(message)
            _count(len(every), data)
            for one in every:
                for step in steps:
                    step(one, data)

        return of_messages

    def of_bytes(message: Any, data: bytearray) -> None:
        value = get(message)
        _count(len(value), data)
        data += value

    def of_text(message: Any, data: bytearray) -> None:
        value = get(message).replace("\0", "\ufffd").encode("utf-8", "replace") + b"\0"
        _count(len(value), data)
        data += value

    return of_bytes if leaf.of.sequence else of_text


def _count(count: int, data: bytearray) -> None:
    data += bytes(-len(data) % 4) + struct.pack("<I", count)
