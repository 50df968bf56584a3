"""Faults of reception: transmitters, interference, a stuck receiver, its antennas and electronics near it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from random import Random
from typing import Any, Final

import numpy as np

from arva_hil.config import Fault, FaultKind, Scenario
from arva_hil.config.constraints import Number
from arva_hil.config.faults import TRANSMITTER
from arva_hil.model.receiver import Answer, Impairment, Look, Reading, ReceiverModel, with_true_ranges
from arva_hil.model.receiver.paper import FLOOR_RANGE_M, NoiseSource, noise_bound
from arva_hil.registry import FAULTS


class Switch:
    """A fault of the scenario. Remembers since when it is on. `stage`, `strike`: see `FaultKind`.

    Its effect on a frame depends only on `key` and the frame's number, not on other faults.
    """

    def __init__(self, fault: Fault, key: str) -> None:
        kind: FaultKind = FAULTS[fault.name]
        self.fault, self.stage = fault, kind.stage
        strike: Any = kind.strike or (lambda look, switch: look)
        own = {} if fault.options is None else {"options": fault.options}
        self.strike: Callable[..., Any] = partial(strike, **own) if own else strike
        self.since_s: float | None = None  # seconds since it was switched on, None when it is off
        self._key = key

    def turn(self, time_us: int) -> bool:
        """Switch on or off for this time of the run [µs]. Return True if it is on."""
        since = self.fault.since(time_us)
        self.since_s = None if since is None else since / 1e6
        return since is not None

    def random(self, number: int) -> Random:
        """Return the random numbers for one frame."""
        return Random(f"{self._key} {number}")


_SIGNAL: Final = Number(0, 1e9, "nA/m", above=True, unit="nA/m")


def _impaired(made: Callable[[float], Impairment]) -> Callable[[Look, Switch], Look]:
    """Return a strike that adds an impairment, made of the fault's value."""

    def strike(look: Look, switch: Switch) -> Look:
        more = made(switch.fault.value)
        return replace(look, impairment=look.impairment.also(more) if look.impairment else more)

    return strike


def _antenna(axis: int, gain: float) -> Impairment:
    x, y, z = (gain if axis == one else 1.0 for one in range(3))
    return Impairment(gains=(x, y, z))


ANTENNA_X, ANTENNA_Y, ANTENNA_Z = (
    FaultKind(
        "heard",
        Number(0, 1, "a gain"),
        f"the antenna {name} has this gain: 0 dead, below 1 detuned",
        _impaired(partial(_antenna, axis)),
    )
    for axis, name in enumerate("xyz")
)
COLD: Final = FaultKind(
    "heard",
    Number(0, 60, "decibels", above=True, unit="dB"),
    "a cold battery: the gain of all antennas",
    _impaired(lambda decibels: Impairment(gains=(10 ** (-decibels / 20),) * 3)),
)
SATURATION: Final = FaultKind(
    "heard",
    _SIGNAL,
    "upper limit of each antenna, as next to a transmitter",
    _impaired(lambda na_m: Impairment(saturation_na_m=na_m)),
)
ELECTRONICS: Final = FaultKind(
    "heard",
    _SIGNAL,
    "standard deviation of the noise of something beside it",
    _impaired(lambda na_m: Impairment(noise_na_m=na_m)),
)


class FaultyReceiver:
    """A `ReceiverModel` around another one, which applies the faults of reception.

    Remembers its last reading, for the fault `stuck`, and its newest sample. `scenario`: has the receiver's noise.
    """

    def __init__(self, model: ReceiverModel, scenario: Scenario) -> None:
        self._model = model
        self._scenario = scenario
        self._shown: Reading | None = None
        self._look: Look | None = None
        self.use(())

    def use(self, switches: Sequence[Switch]) -> None:
        """Apply these faults from now on."""
        self._changes = [s for s in switches if s.stage == "heard"]
        self._stuck = [s for s in switches if s.fault.name == "stuck"]
        self._loud = [(s, _interference(self._scenario, s)) for s in switches if s.fault.name == "interference"]

    def next_look(self, after_s: float, frame_s: float) -> float:
        return self._model.next_look(after_s, frame_s)

    def look(self, look: Look) -> bool | None:
        time_us = round(look.time_s * 1e6)
        for switch in self._changes:
            if switch.turn(time_us):
                look = switch.strike(look, switch)
        m = len(look.transmitters.ids)
        if loud := [noise.draw(m) for switch, noise in self._loud if switch.turn(time_us)]:
            look = replace(look, noise=sum(loud[1:], loud[0]))
        self._look = look
        return self._model.look(look)

    def show(self, time_s: float) -> Reading:
        """See `ReceiverModel`. While it is stuck: the earlier reading, with the true ranges of the newest sample."""
        reading, time_us = self._model.show(time_s), round(time_s * 1e6)
        stuck = [switch for switch in self._stuck if switch.turn(time_us)]
        if self._shown is None or not stuck:
            self._shown = reading
            return reading
        look = self._look
        ranges = look.transmitters.ranges(look.pose.position) if look and look.pose else {}
        return replace(self._shown, channels=with_true_ranges(self._shown.channels, ranges))

    def command(self, time_s: float, name: str, values: Sequence[float]) -> Answer:
        return self._model.command(time_s, name, values)


def _interference(scenario: Scenario, switch: Switch) -> NoiseSource:
    """Return noise up to `value` times the receiver's specified noise, from its own random numbers."""
    noise, bound_m = scenario.receiver.noise, FLOOR_RANGE_M / math.cbrt(switch.fault.value)
    kind = "uniform" if noise.kind == "off" else noise.kind
    seed = switch.random(-1).getrandbits(63)
    return NoiseSource(kind, noise_bound(scenario.receiver.sensitivity, bound_m), seed)


def _moved(look: Look, switch: Switch) -> Look:
    there = look.transmitters
    positions = there.positions.copy()
    positions[there.ids.index(int(switch.fault.value))] += np.array(switch.fault.by_ned)
    return replace(look, transmitters=replace(there, positions=positions))


def _fading(look: Look, switch: Switch) -> Look:
    """Reduce the transmitter's field linearly to zero."""
    assert switch.since_s is not None
    assert switch.fault.over_s is not None
    return _weakened(look, switch, max(0.0, 1 - switch.since_s / switch.fault.over_s))


def _weakened(look: Look, switch: Switch, factor: float = 0.0) -> Look:
    strengths = look.transmitters.strengths.copy()
    strengths[look.transmitters.ids.index(int(switch.fault.value))] *= factor
    return replace(look, transmitters=replace(look.transmitters, strengths=strengths))


OFF: Final = FaultKind("heard", TRANSMITTER, "it sends nothing", _weakened)
MOVED: Final = FaultKind("heard", TRANSMITTER, "it moves away, then back", _moved, ("by_ned",))
FADING: Final = FaultKind("heard", TRANSMITTER, "its field falls linearly to zero", _fading, ("over_s",))
INTERFERENCE: Final = FaultKind(
    "heard", Number(1, 1_000_000, above=True), "noise, in multiples of the specified noise", None
)
STUCK: Final = FaultKind("heard", None, "it repeats the same reading", None)
