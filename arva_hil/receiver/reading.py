"""Readings: the output of a receiver model, in centimetres and degrees."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import IntEnum

__all__ = ["ChannelReading", "Reading", "Zone", "with_true_ranges"]


class Zone(IntEnum):
    """The zone of a transmitter. OUTER, in which it is not heard, is false."""

    OUTER = 0
    MID = 1  # two antennas: distance and direction
    INNER = 2  # three antennas: distance only


@dataclass(frozen=True, slots=True)
class ChannelReading:
    """One slot of the receiver. An empty slot has no id, zone OUTER and the no-signal values.

    `true_range_m`: the distance to the slot's transmitter. Empty slots have the distances of transmitters that no slot
    shows, nearest first. None if there is no such transmitter, or no pose.
    """

    id: int | None
    zone: int
    d_cm: int
    delta_deg: int  # positive to the right; the 180° ambiguity is the receiver's own
    true_range_m: float | None


@dataclass(frozen=True, slots=True)
class Reading:
    """The content of one frame: all slots, nearest first, empty ones last."""

    channels: tuple[ChannelReading, ...]
    interference: bool  # noise above the floor that a receiver is specified for
    more_heard: bool  # more transmitters than slots


def with_true_ranges(channels: Iterable[ChannelReading], ranges: Mapping[int, float]) -> tuple[ChannelReading, ...]:
    """The same slots with their true ranges. `ranges`: the distances of all transmitters [m], by id."""
    every = tuple(channels)
    shown = {c.id for c in every}
    rest = iter(sorted(metres for id_, metres in ranges.items() if id_ not in shown))
    return tuple(
        ChannelReading(c.id, c.zone, c.d_cm, c.delta_deg, next(rest, None) if c.id is None else ranges.get(c.id))
        for c in every
    )
