"""ROS 2's messages as `rosbags` has them: a CDR reader, and the definitions of ROS 2 Jazzy, that others wrote."""

from __future__ import annotations

import dataclasses
import math
import struct
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from arva_hil.records.ros_messages.message import Message, schema
from arva_hil.records.ros_messages.types import PUBLISHED

JAZZY = get_typestore(Stores.ROS2_JAZZY)
OURS = get_typestore(Stores.EMPTY)
"""Made of our schemas alone."""

for published in PUBLISHED:
    OURS.register(get_types_from_msg(schema(published), published.ros_name()))


def read(data: bytes, name: str) -> Any:
    """The message of these bytes, as numbers, texts, lists and dictionaries."""
    return plain(OURS.deserialize_cdr(data, name))


def plain(value: Any) -> Any:
    """A message, of whosever making, as numbers, texts, lists and dictionaries."""
    if dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value) if field.name != "__msgtype__"]
        return {name: plain(getattr(value, name)) for name in names}
    if isinstance(value, bytes):
        return list(value)
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    return "NaN" if isinstance(value, float) and math.isnan(value) else value


def float32(value: float) -> float:
    """As a float of four bytes holds it."""
    (narrow,) = struct.unpack("<f", struct.pack("<f", value))
    return float(narrow)


def messages(cls: type[Message]) -> list[type[Message]]:
    """The message and all those in it."""
    from arva_hil.records.ros_messages.message import field_types

    found = [cls]
    for of in field_types(cls).values():
        if of.message:
            found += messages(of.message)
    return list(dict.fromkeys(found))
