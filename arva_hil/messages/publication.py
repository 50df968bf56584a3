"""Publications: messages with topic and time."""

from __future__ import annotations

from typing import Final, NamedTuple

from arva_hil.messages.message import Message
from arva_hil.messages.types import Header, Time

_SECOND: Final = 1_000_000_000  # ns
_LATEST: Final = 2**31 * _SECOND  # the end of the times that a message can have


class Publication(NamedTuple):
    """A message on a topic at `stamp_ns`, nanoseconds since 1970."""

    topic: str
    stamp_ns: int
    message: Message


def stamp_of(epoch_us: int, time_s: float) -> int:
    """Nanoseconds since 1970; 0 for times that a message cannot have. `epoch_us`: microseconds since 1970 at time 0."""
    stamp_ns = epoch_us * 1000 + round(time_s * _SECOND)
    return stamp_ns if 0 <= stamp_ns < _LATEST else 0


def header(stamp_ns: int, frame: str) -> Header:
    """The header of a message with this time and frame."""
    return Header(Time(*divmod(stamp_ns, _SECOND)), frame)
