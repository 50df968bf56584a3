"""What the receiver says: the values that leave the model, in the receiver's own centimetres and degrees."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

__all__ = ["ChannelReading", "Reading", "Zone"]


class Zone(IntEnum):
    """How well a transmitter is heard; false when it is not."""

    OUTER = 0
    MID = 1  # two antennas: distance and direction
    INNER = 2  # three antennas: distance only


@dataclass(frozen=True, slots=True)
class ChannelReading:
    """One slot of the receiver. An empty one has no id, zone OUTER, the no-signal pair and no true range."""

    id: int | None
    zone: int
    d_cm: int
    delta_deg: int  # positive to the right; the 180° ambiguity is the receiver's own
    true_range_m: float | None


@dataclass(frozen=True, slots=True)
class Reading:
    """One frame's worth: all the slots, nearest first, empty ones last."""

    channels: tuple[ChannelReading, ...]
    interference: bool  # noise above the floor that a receiver is specified for
    more_heard: bool  # more transmitters than slots
