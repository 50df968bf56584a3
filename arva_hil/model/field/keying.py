"""Transmitters in time: when each sends its pulses, on which carrier, and how strong.

A transmitter is keyed: a pulse, a pause, a pulse. `Keying` has the pulses of one transmitter, `PulseTimeline` those of
several in the order of their ends, `KEYING_CLASSES` the classes of sets from which a keying is drawn. Times are seconds
from the start of the run. Sources of the numbers: docs/explanation/pulsed.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.model.field.arrays import Array, require

CARRIER_HZ: Final = 457_000.0
JITTER_S: Final = 0.2e-3  # assumption
DRIFT_PPM: Final = 20.0  # assumption
LEAK_DB: Final = -71.0  # derived from one report: docs/explanation/pulsed.md

_LOW_BATTERY: Final = 0.2  # assumption: below this charge the output falls, to −3 dB with an empty battery
_EMPTY_DB: Final = -3.0  # assumption
_WORST_JITTER: Final = 6.0  # standard deviations; jitter is limited to that
_WORST_SPREAD: Final = 4.0  # standard deviations; a period drawn from a normal distribution is limited to that
_GOLDEN: Final = 0x9E3779B97F4A7C15  # the step of SplitMix64


def jitter_limit_s(period_s: float, pulse_s: float) -> float:
    """Return the limit of the jitter that leaves a pause between any two pulses."""
    return (period_s - pulse_s) / (2 * _WORST_JITTER)


class Pulses(NamedTuple):
    """The pulses of one transmitter, in time: four arrays (n,)."""

    numbers: NDArray[np.int64]
    starts: Array
    ends: Array
    amplitudes: Array  # relative to a full battery


@dataclass(frozen=True)
class Keying:
    """The times at which one transmitter sends. The same values give the same pulses, in any order of calls.

    Raises ValueError for contradictory times: no pause between two pulses, or a negative value.
    """

    period_s: float = 1.0
    pulse_s: float = 0.08
    phase_s: float = 0.0  # the start of pulse 0
    jitter_s: float = 0.0  # standard deviation of each start
    drift_ppm: float = 0.0  # of the set's clock: its period is longer by this
    carrier_hz: float = 0.0  # offset from 457 kHz
    leak_db: float | None = None  # carrier in the pauses, relative to a pulse; None: none
    from_s: float = -math.inf  # it sends from this time on
    battery: float = 1.0  # charge at the start of the run, 0…1
    battery_life_s: float = math.inf  # from a full battery to an empty one
    seed: int = 0  # of the jitter

    def __post_init__(self) -> None:
        limit = jitter_limit_s(self.period_s, self.pulse_s)
        require(
            (
                0 < self.pulse_s < self.period_s < math.inf,
                f"a pulse of {self.pulse_s:g} s in a period of {self.period_s:g} s: expected a period above the pulse",
            ),
            (
                0 <= self.jitter_s < limit,
                f"jitter_s {self.jitter_s:g}: expected 0 or more, and below a twelfth of the pause ({limit:.4g} s)",
            ),
            (0 <= self.battery <= 1, f"battery {self.battery:g}: expected 0…1"),
            (self.battery_life_s > 0, f"battery_life_s {self.battery_life_s:g}: expected above 0"),
        )

    @property
    def leak(self) -> float:
        """The carrier's amplitude in the pauses, relative to a pulse."""
        return 0.0 if self.leak_db is None else 10 ** (self.leak_db / 20)

    def pulses(self, t0: float, t1: float) -> Pulses:
        """Return the pulses that start in [t0, t1)."""
        return pulses_of([self], t0, t1)[1]


def pulses_of(keyings: Sequence[Keying], t0: float, t1: float) -> tuple[NDArray[np.int64], Pulses]:
    """Return the pulses of several transmitters that start in [t0, t1), in order, and the index of each sender.

    Many transmitters take hardly more time than one.
    """
    periods = [k.period_s * (1 + k.drift_ppm * 1e-6) for k in keyings]
    every = []
    for k, period in zip(keyings, periods, strict=True):
        around = _WORST_JITTER * k.jitter_s
        first = math.floor((max(t0, k.from_s) - around - k.phase_s) / period) - 1
        every.append(range(first, max(first, math.ceil((t1 + around - k.phase_s) / period) + 1)))
    numbers = np.array([number for one in every for number in one], np.int64)
    senders = np.repeat(np.arange(len(keyings)), [len(one) for one in every])
    values = [(k.phase_s, k.jitter_s, k.pulse_s, k.from_s, k.battery, k.battery_life_s) for k in keyings]
    phase, jitter, length, from_s, battery, life_s = np.array(values, float).reshape(-1, 6).T[:, senders]
    seeds = np.array([k.seed % 2**64 for k in keyings], np.uint64)[senders]
    starts: Array = np.multiply(numbers, np.array(periods)[senders], dtype=np.float64) + phase
    starts += jitter * _normals(seeds, numbers)
    charge = np.minimum(np.maximum(battery - np.maximum(starts, 0.0) / life_s, 0.0), 1.0)
    amplitudes: Array = 10 ** (_EMPTY_DB / 20 * np.maximum(0.0, 1 - charge / _LOW_BATTERY))
    within = (starts >= t0) & (starts < t1) & (starts >= from_s)
    return senders[within], Pulses(*(of[within] for of in (numbers, starts, starts + length, amplitudes)))


@dataclass(frozen=True)
class KeyingClass:
    """A class of sets: their common values and distributions.

    `spread_s`: half the width of a uniform distribution of the period, or the standard deviation of a normal one.
    """

    pulse_s: float
    period_s: float
    spread: Literal["uniform", "normal"]
    spread_s: float
    carrier_sigma_hz: float
    carrier_limit_hz: float
    strength: float = 1.0  # the field on the axis at 10 m, relative to the reference set
    carrier_hz: float = 0.0
    carrier_hz_per_c: float = 0.0  # from 20 °C
    leak_db: float | None = None

    @property
    def shortest_s(self) -> float:
        """The shortest period that is drawn."""
        return self.period_s - self.spread_s * (1.0 if self.spread == "uniform" else _WORST_SPREAD)


KEYING_CLASSES: Final = {
    "modern": KeyingClass(0.080, 1.0, "uniform", 0.3, 20.0, 80.0),
    "modern-tight": KeyingClass(0.070, 1.0, "uniform", 0.1, 20.0, 80.0),
    "old-digital": KeyingClass(0.100, 0.8, "normal", 0.005, 40.0, 100.0),
    "analogue": KeyingClass(0.200, 0.9, "normal", 0.022, 50.0, 100.0, carrier_hz_per_c=1.0, leak_db=LEAK_DB),
    "norm-weak": KeyingClass(0.070, 1.3, "uniform", 0.0, 0.0, 80.0, strength=0.5, carrier_hz=-80.0),
    "norm-strong": KeyingClass(0.070, 0.7, "uniform", 0.0, 0.0, 80.0, strength=2.24, carrier_hz=80.0),
}
"""Classes by name. The widths of pulses and the spreads are assumptions within the norm's limits."""


def draw_keying(kind: KeyingClass, seed: int, id_: int, temperature_c: float = 20.0, **given: Any) -> Keying:
    """Return a set of a class. Period, phase, carrier and clock are drawn from a seed and the transmitter's id.

    `given`: fields with other values than those drawn.
    """
    rng = np.random.Generator(np.random.PCG64([seed, id_]))
    uniform, clock, phase = rng.random(3).tolist()
    normal, carrier = rng.standard_normal(2).tolist()
    around = 2 * uniform - 1 if kind.spread == "uniform" else max(-_WORST_SPREAD, min(_WORST_SPREAD, normal))
    period_s = kind.period_s + kind.spread_s * around
    offset = kind.carrier_hz + kind.carrier_sigma_hz * carrier + kind.carrier_hz_per_c * (temperature_c - 20.0)
    drawn = {
        "period_s": period_s,
        "pulse_s": kind.pulse_s,
        "phase_s": period_s * phase,
        "jitter_s": JITTER_S,
        "drift_ppm": DRIFT_PPM * (2 * clock - 1),
        "carrier_hz": max(-kind.carrier_limit_hz, min(kind.carrier_limit_hz, offset)),
        "leak_db": kind.leak_db,
        "seed": int(rng.integers(2**63)),
    }
    return Keying(**drawn | given)


def outside_norm(keying: Keying, strength: float = 1.0) -> list[str]:
    """Return one sentence for each value of a transmitter that is outside EN 300 718-1, with the limit.

    `strength`: the field on the axis at 10 m, µA/m.
    """
    pause_s = keying.period_s - keying.pulse_s
    limits = (
        (0.7 <= keying.period_s <= 1.3, f"period {keying.period_s:g} s: the norm has 0.7…1.3 s"),
        (keying.pulse_s >= 0.07, f"pulse {keying.pulse_s:g} s: the norm has at least 0.07 s"),
        (pause_s >= 0.4, f"pause {pause_s:.3g} s: the norm has at least 0.4 s"),
        (abs(keying.carrier_hz) <= 80, f"carrier {keying.carrier_hz:+.0f} Hz: the norm has at most ±80 Hz"),
        (0.5 <= strength <= 2.24, f"strength {strength:g}: the norm has 0.5…2.24 µA/m at 10 m"),
    )
    return [sentence for within, sentence in limits if not within]


def _normals(seeds: NDArray[np.uint64], numbers: NDArray[np.int64]) -> Array:
    """Return a normal random number for each pulse, limited to `_WORST_JITTER`: Box-Muller of hashed counters."""
    counters = 2 * numbers.astype(np.uint64) + seeds
    radius, angle = _uniform(np.stack([counters, counters + np.uint64(1)]))
    normals: Array = np.sqrt(-2 * np.log(1 - radius)) * np.cos(2 * np.pi * angle)
    return np.minimum(np.maximum(normals, -_WORST_JITTER), _WORST_JITTER)


def _uniform(counters: NDArray[np.uint64]) -> Array:
    """Return numbers in [0, 1), by SplitMix64."""
    z = counters * np.uint64(_GOLDEN)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    uniform: Array = np.multiply((z ^ (z >> np.uint64(31))) >> np.uint64(11), 2.0**-53, dtype=np.float64)
    return uniform


_STRETCH_PULSES: Final = 64  # calculated at a time, about


class Pulse(NamedTuple):
    """One pulse: seconds from the start of the run. `sender`: the index of its transmitter."""

    sender: int
    start_s: float
    end_s: float
    amplitude: float  # relative to a full battery


class SentPulse(NamedTuple):
    """A pulse, and the pulses of other transmitters at the same time."""

    pulse: Pulse
    touching: tuple[Pulse, ...]


class PulseTimeline:
    """The pulses of transmitters with these `keyings`.

    It keeps the pulses of a short stretch of time, so that no call takes long. Calls go forward in time:
    `next_end` and `take` never return a pulse that ended before one already taken.
    """

    def __init__(self, keyings: Sequence[Keying], start_s: float) -> None:
        self._keyings = keyings
        rate = sum(1 / keying.period_s for keying in keyings)
        self._stretch_s = max(2 * max((k.period_s for k in keyings), default=1.0), _STRETCH_PULSES / max(rate, 1e-3))
        self._margin_s = max((keying.pulse_s for keying in keyings), default=0.0)
        self._waiting: list[SentPulse] = []  # the next one last
        self._from_s = start_s  # of the next stretch

    def next_end(self, after_s: float, until_s: float) -> float:
        """Return the end of the first pulse that ends after `after_s`; at most `until_s`."""
        while self._waiting and self._waiting[-1].pulse.end_s <= after_s:
            self._waiting.pop()
        while not self._waiting and self._from_s < until_s:
            self._from_s = max(self._from_s, after_s)
            self._fill()
        return min(self._waiting[-1].pulse.end_s, until_s) if self._waiting else until_s

    def take(self, until_s: float) -> Iterator[SentPulse]:
        """Yield the pulses that end until `until_s` and that `next_end` has not skipped, in their order."""
        while self._waiting and self._waiting[-1].pulse.end_s <= until_s:
            yield self._waiting.pop()

    def _fill(self) -> None:
        """Change to the next stretch."""
        t0, t1 = self._from_s - 2 * self._margin_s, self._from_s + self._stretch_s + self._margin_s
        senders, (_, *columns) = pulses_of(self._keyings, t0, t1)
        made = (Pulse(*row) for row in zip(*(one.tolist() for one in (senders, *columns)), strict=True))
        until_s = self._from_s + self._stretch_s
        every = sorted(made, key=lambda pulse: pulse.start_s)
        sent = [
            SentPulse(pulse, tuple(others))
            for pulse, others in zip(every, _touching(every), strict=True)
            if self._from_s < pulse.end_s <= until_s
        ]
        sent.sort(key=lambda one: one.pulse.end_s, reverse=True)
        self._waiting = sent
        self._from_s = until_s


def _touching(every: Sequence[Pulse]) -> list[list[Pulse]]:
    """Return for each pulse the pulses of other transmitters at the same time. `every`: sorted by their starts."""
    touching: list[list[Pulse]] = [[] for _ in every]
    for n, pulse in enumerate(every):
        for m in range(n + 1, len(every)):
            other = every[m]
            if other.start_s >= pulse.end_s:
                break
            if other.sender != pulse.sender:
                touching[n].append(other)
                touching[m].append(pulse)
    return touching
