"""Faults of hearing: transmitters off, moved or fading, bursts of interference, a stuck receiver."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from arva_hil.config import FaultKind, Scenario
from arva_hil.config.constraints import Number
from arva_hil.config.faults import TRANSMITTER
from arva_hil.faults.switch import Switch
from arva_hil.receiver import Answer, Antennas, Look, Reading, ReceiverModel, with_true_ranges
from arva_hil.receiver.paper import NoiseSource, noise_bound
from arva_hil.registry import FAULTS

Strike = Callable[[Look, Switch], Look]

_LIMIT_RANGE_M: Final = Antennas().floor_range_m  # the noise a receiver is made for is a transmitter's field from there


class FaultyReceiver:
    """A `ReceiverModel` around another one, which applies the faults of hearing.

    Remembers its last reading, for the fault `stuck`, and its newest look. `scenario`: has the receiver's noise.
    """

    def __init__(self, model: ReceiverModel, scenario: Scenario, switches: Sequence[Switch]) -> None:
        self._model = model
        self._changes = [(s, strike) for s in switches if (strike := _strike(s))]
        self._stuck = [s for s in switches if s.fault.name == "stuck"]
        self._loud = [(s, _interference(scenario, s)) for s in switches if s.fault.name == "interference"]
        self._shown: Reading | None = None
        self._look: Look | None = None

    def next_look(self, after_s: float, frame_s: float) -> float:
        """See `ReceiverModel`."""
        return self._model.next_look(after_s, frame_s)

    def look(self, look: Look) -> bool | None:
        """See `ReceiverModel`."""
        time_us = round(look.time_s * 1e6)
        for switch, strike in self._changes:
            if switch.turn(time_us):
                look = strike(look, switch)
        m = len(look.transmitters.ids)
        if loud := [noise.draw(m) for switch, noise in self._loud if switch.turn(time_us)]:
            look = replace(look, noise=sum(loud[1:], loud[0]))
        self._look = look
        return self._model.look(look)

    def show(self, time_s: float) -> Reading:
        """See `ReceiverModel`. While it is stuck: the earlier reading, with the true ranges of the newest look."""
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
    """Noise up to `value` times the receiver's specified noise, from its own random numbers."""
    noise, bound_m = scenario.receiver.noise, _LIMIT_RANGE_M / math.cbrt(switch.fault.value)
    kind = "uniform" if noise.kind == "off" else noise.kind
    seed = switch.random(-1).getrandbits(63)
    return NoiseSource(kind, noise_bound(scenario.receiver.sensitivity, bound_m), seed)


def _strike(switch: Switch) -> Strike | None:
    """The function with which a fault changes a look, None if it does not."""
    kind: FaultKind = FAULTS[switch.fault.name]
    return kind.strike if kind.stage == "heard" else None


def _off(look: Look, switch: Switch) -> Look:
    return _weakened(look, switch, 0.0)


def _moved(look: Look, switch: Switch) -> Look:
    there = look.transmitters
    positions = there.positions.copy()
    positions[_index(look, switch)] += np.array(switch.fault.by_ned)
    return replace(look, transmitters=replace(there, positions=positions))


def _fading(look: Look, switch: Switch) -> Look:
    """The transmitter's field falls linearly to zero."""
    assert switch.since_s is not None
    assert switch.fault.over_s is not None
    return _weakened(look, switch, max(0.0, 1 - switch.since_s / switch.fault.over_s))


def _weakened(look: Look, switch: Switch, factor: float) -> Look:
    strengths = look.transmitters.strengths.copy()
    strengths[_index(look, switch)] *= factor
    return replace(look, transmitters=replace(look.transmitters, strengths=strengths))


def _index(look: Look, switch: Switch) -> int:
    return look.transmitters.ids.index(int(switch.fault.value))


OFF: Final = FaultKind("heard", TRANSMITTER, "it sends nothing", _off)
MOVED: Final = FaultKind("heard", TRANSMITTER, "it is elsewhere, then back again", _moved, ("by_ned",))
FADING: Final = FaultKind("heard", TRANSMITTER, "its field falls evenly to nothing", _fading, ("over_s",))
INTERFERENCE: Final = FaultKind("heard", Number(1, 1_000_000, above=True), "noise, times the most it is made for", None)
STUCK: Final = FaultKind("heard", None, "the same reading over and over", None)
