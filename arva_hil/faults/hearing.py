"""Faults of hearing: transmitters off, moved or fading, bursts of interference, a stuck receiver."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.config import Scenario
from arva_hil.faults.switch import Switch
from arva_hil.field import Transmitters
from arva_hil.receiver import Answer, Antennas, Look, Reading, ReceiverModel, with_true_ranges
from arva_hil.receiver.paper import NoiseSource, noise_bound

Array = NDArray[np.float64]

_LIMIT_RANGE_M: Final = Antennas().floor_range_m  # the noise a receiver is made for is a transmitter's field from there


class FaultyReceiver:
    """A receiver that hears what faults leave it; a `ReceiverModel` around another one.

    Remembers what it shows, for a fault that holds it, and its newest look. `scenario`: with the receiver's noise.
    """

    def __init__(self, model: ReceiverModel, scenario: Scenario, switches: Sequence[Switch]) -> None:
        self._model = model
        self._transmitters = [s for s in switches if s.fault.name in _CHANGES]
        self._stuck = [s for s in switches if s.fault.name == "stuck"]
        self._loud = [(s, _interference(scenario, s)) for s in switches if s.fault.name == "interference"]
        self._shown: Reading | None = None
        self._look: Look | None = None

    def next_look(self, after_s: float, frame_s: float) -> float:
        """See `ReceiverModel`."""
        return self._model.next_look(after_s, frame_s)

    def look(self, look: Look) -> None:
        """See `ReceiverModel`."""
        time_us = round(look.time_s * 1e6)
        if on := [switch for switch in self._transmitters if switch.turn(time_us)]:
            look = replace(look, transmitters=_changed(look.transmitters, on))
        m = len(look.transmitters.ids)
        if loud := [noise.draw(m) for switch, noise in self._loud if switch.turn(time_us)]:
            look = replace(look, noise=sum(loud[1:], loud[0]))
        self._look = look
        self._model.look(look)

    def show(self, time_s: float) -> Reading:
        """See `ReceiverModel`; while it is stuck what it showed before, its true ranges those of its newest look."""
        reading, time_us = self._model.show(time_s), round(time_s * 1e6)
        stuck = [switch for switch in self._stuck if switch.turn(time_us)]
        if self._shown is None or not stuck:
            self._shown = reading
            return reading
        look = self._look
        ranges = look.transmitters.ranges(look.pose.position) if look and look.pose else {}
        return replace(self._shown, channels=with_true_ranges(self._shown.channels, ranges))

    def command(self, time_s: float, name: str, values: Sequence[float]) -> Answer:
        """See `ReceiverModel`."""
        return self._model.command(time_s, name, values)


def _interference(scenario: Scenario, switch: Switch) -> NoiseSource:
    """Noise up to `value` times what the receiver is made for, from numbers of its own."""
    noise, bound_m = scenario.receiver.noise, _LIMIT_RANGE_M / math.cbrt(switch.fault.value)
    kind = "uniform" if noise.kind == "off" else noise.kind
    seed = switch.random(-1).getrandbits(63)
    return NoiseSource(kind, noise_bound(scenario.receiver.sensitivity, bound_m), seed)


def _changed(there: Transmitters, switches: Sequence[Switch]) -> Transmitters:
    """The transmitters as faults that are on leave them."""
    changed = replace(there, positions=there.positions.copy(), strengths=there.strengths.copy())
    for switch in switches:
        _CHANGES[switch.fault.name](changed, there.ids.index(int(switch.fault.value)), switch)
    return changed


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
