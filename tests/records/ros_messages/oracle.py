"""A reader of ROS 2's messages that others wrote: mcap_ros2's, with our schemas."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from arva_hil.records.ros_messages.types import PUBLISHED, schema


def read(data: bytes, name: str) -> Any:
    """The message of these bytes, as numbers, texts, lists and dictionaries."""
    (cls,) = [published for published in PUBLISHED if published.__msgtype__ == name]
    decode = DecoderFactory().decoder_for("cdr", Schema(1, schema(cls).encode(), "ros2msg", name))
    assert decode is not None
    return plain(decode(data))


def plain(value: Any) -> Any:
    """A message, of whosever making, as numbers, texts, lists and dictionaries."""
    if dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value) if field.name != "__msgtype__"]
        return {name: plain(getattr(value, name)) for name in names}
    if hasattr(value, "__slots__"):
        return {name: plain(getattr(value, name)) for name in value.__slots__}
    if isinstance(value, bytes):
        return list(value)
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    return "NaN" if isinstance(value, float) and math.isnan(value) else value
