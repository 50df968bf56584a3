"""Readings: the output of a receiver model, in centimetres and degrees."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

Vector = tuple[float, float, float]
"""A signal at the three antennas, signed."""


class Zone(IntEnum):
    """The zone of a transmitter. OUTER, without a signal, is false."""

    OUTER = 0
    MID = 1  # two antennas: distance and direction
    INNER = 2  # three antennas: distance only


@dataclass(frozen=True, slots=True)
class PulseReading:
    """The newest pulse of a slot, from a receiver that sends its measurements.

    The signs are relative to each other: a receiver does not know the phase of the transmitter. Without an antenna: 0.
    """

    time_s: float  # its end, seconds from the start of the run
    signal_na_m: tuple[float, float, float]  # at the antennas x, y, z, signed, nA/m
    period_s: float | None  # of the transmitter; None: not known
    carrier_hz: float | None  # offset from 457 kHz; None: not known
    level_dbfs: float | None = None  # of receivers that give the strength


class ChannelReading(NamedTuple):
    """One slot of the receiver. An empty slot has no id, zone OUTER and the no-signal values.

    `true_range_m`: distance to the slot's transmitter; of empty slots, to transmitters without a slot, nearest first;
    None without a transmitter or pose. A slot whose transmitter is not received at the moment is blank: it has an id,
    zone OUTER and the no-signal values.
    """

    id: int | None
    zone: int
    d_cm: int
    delta_deg: int  # positive to the right; the 180° ambiguity is the receiver's own
    true_range_m: float | None
    marked: bool = False  # by the host: it was found
    pulse: PulseReading | None = None  # of receivers that measure pulses


@dataclass(frozen=True, slots=True)
class Reading:
    """The content of one frame: all slots, nearest first, marked ones behind the others, empty ones last."""

    channels: tuple[ChannelReading, ...]
    interference: bool  # noise above the specified floor
    more_heard: bool  # more transmitters than slots
    overlapping: bool = False  # pulses of several transmitters overlap
    searching: bool = True  # False: it has returned to sending by itself, and receives nothing
    failed: bool = False  # its self-test


def with_true_ranges(channels: Iterable[ChannelReading], ranges: Mapping[int, float]) -> tuple[ChannelReading, ...]:
    """Return the same slots with their true ranges. `ranges`: the distances of all transmitters [m], by id."""
    every, rest = list(channels), dict(ranges)
    shown = {c.id: rest.pop(c.id, None) for c in every if c.id is not None}
    hidden = iter(sorted(rest.values()))
    for n, c in enumerate(every):
        metres = shown[c.id] if c.id is not None else next(hidden, None)
        if metres != c.true_range_m:
            every[n] = ChannelReading(c.id, c.zone, c.d_cm, c.delta_deg, metres, c.marked, c.pulse)
    return tuple(every)
