"""Overlapping pulses of several transmitters at a receiver.

Overlapping pulses are one event. If their carriers differ by less than one over the length of a pulse, they merge into
a vector sum, which belongs to the pulse that began first. Otherwise one is received if it is 6 dB stronger; if none is,
both are lost.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from random import Random
from typing import Final, NamedTuple

from arva_hil.model.field.keying import Keying
from arva_hil.model.field.pulse_timeline import SentPulse

Vector = tuple[float, float, float]
"""A signal at the three antennas, signed."""

Signals = Callable[[int], Vector]
"""The signal of each transmitter's full pulse at the antennas, by its index."""

_CAPTURE: Final = 0.5  # 6 dB: a weaker signal above this share of the strongest one is not suppressed


class SeparatedPulse(NamedTuple):
    """A received pulse: its start, the offset of its carrier [Hz], its signal. `touched`: others disturb it."""

    start_s: float
    carrier_hz: float
    signal: Vector
    touched: bool


class _Part(NamedTuple):
    start_s: float
    pulse_s: float
    carrier_hz: float
    signal: Vector

    @property
    def strength(self) -> float:
        return math.hypot(*self.signal)


def separate(sent: SentPulse, signals: Signals, keyings: Sequence[Keying], random: Random) -> SeparatedPulse | None:
    """Return the event of a pulse; None if it is lost.

    `random`: for the phases between carriers.
    """
    pulse = sent.pulse
    keying = keyings[pulse.sender]
    own = _Part(pulse.start_s, keying.pulse_s, keying.carrier_hz, _times(signals(pulse.sender), pulse.amplitude))
    rivals = [
        _Part(
            other.start_s,
            keyings[other.sender].pulse_s,
            keyings[other.sender].carrier_hz,
            _times(signals(other.sender), other.amplitude),
        )
        for other in sent.touching
    ]
    in_pulse = {other.sender for other in sent.touching}
    rivals += [
        _Part(pulse.start_s, keying.pulse_s, other.carrier_hz, _times(signals(index), other.leak))
        for index, other in enumerate(keyings)
        if other.leak_db is not None and index != pulse.sender and index not in in_pulse and pulse.end_s > other.from_s
    ]
    if not rivals:
        return SeparatedPulse(own.start_s, own.carrier_hz, own.signal, False)
    merging = [one for one in rivals if _merge(own, one)]
    total = _sum([own, *merging], random) if merging else own.signal
    strength = math.hypot(*total)
    if any(one.strength > _CAPTURE * strength for one in rivals if not _merge(own, one)):
        return None
    parts = [own, *merging]
    loudest = max(one.strength for one in parts)
    told = [one for one in parts if one.strength > _CAPTURE * loudest] or parts
    if min(told, key=lambda one: one.start_s) is not own:
        return None
    weight = sum(one.strength for one in told) or 1.0
    carrier_hz = sum(one.carrier_hz * one.strength for one in told) / weight if len(told) > 1 else own.carrier_hz
    return SeparatedPulse(own.start_s, carrier_hz, total, len(told) > 1)


def _merge(one: _Part, other: _Part) -> bool:
    """Return True if the pulses are too short to distinguish their carriers."""
    return abs(one.carrier_hz - other.carrier_hz) * min(one.pulse_s, other.pulse_s) < 1


def _times(signal: Vector, factor: float) -> Vector:
    if factor == 1:
        return signal
    x, y, z = signal
    return x * factor, y * factor, z * factor


def _sum(parts: Sequence[_Part], random: Random) -> Vector:
    """Return the sum with random phases, in phase with the strongest antenna."""
    sums = [complex(value) for value in parts[0].signal]
    for part in parts[1:]:
        turn = cmath.rect(1.0, math.tau * random.random())
        sums = [total + turn * value for total, value in zip(sums, part.signal, strict=True)]
    strongest = max(sums, key=abs)
    back = strongest.conjugate() / abs(strongest) if strongest else 1.0
    x, y, z = ((total * back).real for total in sums)
    return x, y, z
