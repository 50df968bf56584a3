"""The base class of message declarations. It gives the fields, the `ros2msg` text and, with `cdr`, the bytes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple, dataclass_transform, get_args, get_origin, get_type_hints

Bool = Annotated[bool, "bool"]
Byte = Annotated[int, "byte"]
Int8 = Annotated[int, "int8"]
UInt8 = Annotated[int, "uint8"]
UInt16 = Annotated[int, "uint16"]
Int32 = Annotated[int, "int32"]
UInt32 = Annotated[int, "uint32"]
Float32 = Annotated[float, "float32"]
Float64 = Annotated[float, "float64"]
Text = Annotated[str, "string"]
Bytes = Annotated[bytes, "uint8[]"]
Covariance = Annotated[Sequence[float], "float64[9]"]  # 3 × 3, row by row

_RULE = "=" * 80


@dataclass_transform(frozen_default=True)
class Message:
    """A ROS 2 message of `package`. Its fields have the types above, or are messages or sequences of them."""

    package = ""

    def __init_subclass__(cls, package: str) -> None:
        cls.package = package
        dataclass(frozen=True)(cls)

    @classmethod
    def ros_name(cls) -> str:
        """Return the name, e.g. `geometry_msgs/msg/Point`."""
        return f"{cls.package}/msg/{cls.__name__}"


class FieldType(NamedTuple):
    """The type of a field: the `name` of a primitive type, or the class of a `message`.

    `sequence`: it is a sequence of any length; `length`: of an array, 0 if it is none.
    """

    name: str
    message: type[Message] | None = None
    sequence: bool = False
    length: int = 0


def field_types(cls: type[Message]) -> dict[str, FieldType]:
    """Return the types of a message's fields by name. Raises TypeError for a type that messages cannot have."""
    hints = get_type_hints(cls, include_extras=True)
    return {name: _field_type(hint) for name, hint in hints.items() if get_origin(hint) is not ClassVar}


def definition(cls: type[Message]) -> str:
    """Return the text of the message's .msg file."""
    return "".join(f"{_written(of)} {name}\n" for name, of in field_types(cls).items())


def schema(cls: type[Message]) -> str:
    """Return the `ros2msg` text: the message's definition, and that of each message in it."""
    parts = [f"{_RULE}\nMSG: {part.package}/{part.__name__}\n{definition(part)}" for part in dict.fromkeys(_parts(cls))]
    return definition(cls) + "".join(parts)


def _parts(cls: type[Message]) -> Iterator[type[Message]]:
    for of in field_types(cls).values():
        if of.message is not None:
            yield of.message
            yield from _parts(of.message)


def _written(of: FieldType) -> str:
    name = f"{of.message.package}/{of.message.__name__}" if of.message else of.name
    length = f"[{of.length}]" if of.length else ""
    return name + ("[]" if of.sequence else length)


def _field_type(hint: object) -> FieldType:
    if get_origin(hint) is Annotated:
        name, bracket, length = get_args(hint)[1].partition("[")
        length = length.removesuffix("]")
        return FieldType(name, None, bool(bracket) and not length, int(length or 0))
    if get_origin(hint) is Sequence:
        return _field_type(get_args(hint)[0])._replace(sequence=True)
    if isinstance(hint, type) and issubclass(hint, Message):
        return FieldType("", hint)
    raise TypeError(f"{hint}: messages cannot have a field of this type")
