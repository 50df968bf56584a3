"""Faults of hearing: transmitters off, moved or fading, bursts of interference, a stuck receiver."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from arva_hil.config import Noise, Scenario
from arva_hil.faults.switch import Switch
from arva_hil.model import Antennas, Reading, Transmitters, with_true_ranges
from arva_hil.scene import receiver

Array = NDArray[np.float64]

_LIMIT_RANGE_M: Final = Antennas().floor_range_m  # the noise a receiver is made for is a transmitter's field from there


class FaultyReceiver:
    """A receiver that hears what faults leave it: the face of `Receiver`, and `begin` before each frame.

    Its own noise is drawn for every frame all the same, so that after a fault it is what it would have been.
    """

    def __init__(self, scenario: Scenario, switches: Sequence[Switch]) -> None:
        self._plain = receiver(scenario)
        self._there = self._plain.transmitters
        self._transmitters = [s for s in switches if s.fault.name in _CHANGES]
        self._stuck = [s for s in switches if s.fault.name == "stuck"]
        self._loud = [(s, receiver(_louder(scenario, s))) for s in switches if s.fault.name == "interference"]
        self._last: Reading | None = None

    @property
    def transmitters(self) -> Transmitters:
        """As they are for the present frame; what is set is where they are without faults."""
        return self._plain.transmitters

    @transmitters.setter
    def transmitters(self, transmitters: Transmitters) -> None:
        self._there = self._plain.transmitters = transmitters

    def begin(self) -> None:
        """Put the transmitters where they are for the next frame."""
        if not self._transmitters:
            return
        there = self._there
        changed = replace(there, positions=there.positions.copy(), strengths=there.strengths.copy())
        for switch in self._transmitters:
            if switch.since_s is not None:
                _CHANGES[switch.fault.name](changed, there.ids.index(int(switch.fault.value)), switch)
        self._plain.transmitters = changed

    def pose(self, position: ArrayLike, attitude: ArrayLike) -> tuple[Array, Array]:
        """See `Receiver`."""
        return self._plain.pose(position, attitude)

    def read(self, p_r: Array, R_r: Array) -> Reading:
        """See `Receiver`."""
        return self._said(self._plain.read(p_r, R_r, self._interference()), p_r)

    def nothing(self) -> Reading:
        """See `Receiver`."""
        return self._said(self._plain.nothing(self._interference()), None)

    def true_ranges(self, p_r: Array) -> dict[int, float]:
        """See `Receiver`."""
        return self._plain.true_ranges(p_r)

    def _interference(self) -> Array | None:
        """What all interference that is on adds up to, instead of the receiver's own noise; None without any."""
        loud = [receiver.noise() for switch, receiver in self._loud if switch.since_s is not None]
        if not loud:
            return None
        self._plain.noise()
        return sum(loud[1:], loud[0])

    def _said(self, reading: Reading, p_r: Array | None) -> Reading:
        """The reading, or while it is stuck the last one before, its true ranges those of now."""
        if self._last is None or all(switch.since_s is None for switch in self._stuck):
            self._last = reading
            return reading
        ranges = {} if p_r is None else self._plain.true_ranges(p_r)
        return replace(self._last, channels=with_true_ranges(self._last.channels, ranges))


def _louder(scenario: Scenario, switch: Switch) -> Scenario:
    """The same receiver with noise up to `value` times what it is made for, drawn from numbers of its own."""
    kind = scenario.receiver.noise.kind
    noise = Noise("uniform" if kind == "off" else kind, _LIMIT_RANGE_M / math.cbrt(switch.fault.value))
    seed = switch.random(-1).getrandbits(63)
    return replace(scenario, receiver=replace(scenario.receiver, noise=noise), seed=seed)


def _off(t: Transmitters, index: int, switch: Switch) -> None:
    t.strengths[index] = 0.0


def _moved(t: Transmitters, index: int, switch: Switch) -> None:
    t.positions[index] += np.array(switch.fault.by_ned)


def _fading(t: Transmitters, index: int, switch: Switch) -> None:
    """Its field falls evenly to nothing."""
    assert switch.since_s is not None
    assert switch.fault.over_s is not None
    t.strengths[index] *= max(0.0, 1 - switch.since_s / switch.fault.over_s)


_CHANGES: Final[dict[str, Callable[[Transmitters, int, Switch], None]]] = {
    "transmitter_off": _off,
    "transmitter_moved": _moved,
    "transmitter_fading": _fading,
}
