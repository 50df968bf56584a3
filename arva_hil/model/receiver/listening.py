"""The common part of receivers that listen to pulses: the ends of pulses, and their signals at the antennas.

Overlapping pulses are one event. If their carriers differ by less than one over the length of a pulse, they merge into
a vector sum, which belongs to the pulse that began first. Otherwise one is received if it is 6 dB stronger; if none is,
both are lost.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterator, Sequence
from random import Random
from typing import ClassVar, Final, NamedTuple, Self

import numpy as np

from arva_hil.model.field.dipole import one_field
from arva_hil.model.field.keying import KEYING_CLASSES, Keying, PulseTimeline, SentPulse, draw_keying
from arva_hil.model.field.medium import AIR
from arva_hil.model.receiver.display import Display, PulsedOptions
from arva_hil.model.receiver.paper import FEW, FLOOR_RANGE_M, noise_bound
from arva_hil.model.receiver.reading import Vector
from arva_hil.model.receiver.receiver_model import Impairment, Look, ReceiverSettings

_IDLE_S: Final = 1.0  # the longest time between two samples
_BATCH: Final = 256
_SOUND: Final = Impairment()

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
    parts = [one for one in (own, *rivals) if _merge(own, one)]
    total = _sum(parts, random) if len(parts) > 1 else own.signal
    strength = math.hypot(*total)
    if any(one.strength > _CAPTURE * strength for one in rivals if not _merge(own, one)):
        return None
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


def normals(seed: int) -> Iterator[Vector]:
    """Yield normal numbers for three antennas, from a seed."""
    rng = np.random.Generator(np.random.PCG64(seed))
    while True:
        yield from reversed(rng.standard_normal((_BATCH, 3)).tolist())


class Listening:
    """The transmitters' next pulses, the newest sample, and the noise.

    Signals are in units of the reference transmitter's field. Three numbers are drawn for each pulse, also for one
    below the threshold. `interference`: the noise of the newest pulse is above the specified noise.
    """

    def __init__(self, settings: ReceiverSettings, options: PulsedOptions, seed: int) -> None:
        off = settings.noise.kind == "off"
        self.keyings: tuple[Keying, ...] = ()
        self.interference = False
        self._options = options
        self._scale_na_m = options.scale_na_m
        self._sigma_na_m = 0.0 if off else options.sigma_na_m(settings.noise.floor_range_m)
        self._limit_na_m = noise_bound((1.0,), FLOOR_RANGE_M) * self._scale_na_m
        self._draws = normals(seed)
        self._given: tuple[Keying, ...] | None = None
        self._timeline = PulseTimeline((), 0.0)
        self._look: Look | None = None
        self._of_carrier: list[float] = []

    @property
    def ids(self) -> tuple[int, ...]:
        """The ids of the transmitters, by index."""
        return self._look.transmitters.ids if self._look else ()

    def ranges(self) -> dict[int, float]:
        """Return the true distances [m] at the newest sample, by id."""
        look = self._look
        return look.transmitters.ranges(look.pose.position) if look and look.pose else {}

    def next_look(self, after_s: float) -> float:
        """Return the time at which a pulse ends."""
        if self._look is None:
            return max(0.0, math.nextafter(after_s, math.inf))
        return self._timeline.next_end(after_s, after_s + _IDLE_S)

    def look(self, look: Look) -> bool:
        """Use a sample. Return True if its transmitters are new."""
        self._look = look
        if look.transmitters.keyings == self._given:
            return False
        self._given = look.transmitters.keyings
        self.keyings = self._given or tuple(
            draw_keying(KEYING_CLASSES["modern"], 0, id_) for id_ in look.transmitters.ids
        )
        self._of_carrier = [self._options.carrier_gain(keying.carrier_hz) for keying in self.keyings]
        self._timeline = PulseTimeline(self.keyings, look.time_s)
        return True

    def pulses(self) -> list[SentPulse]:
        """Return the pulses that have ended since the last sample."""
        assert self._look is not None
        return list(self._timeline.take(self._look.time_s))

    def signals(self) -> Signals | None:
        """Return the signal of a transmitter's full pulse at the antennas, by its index; None without a pose."""
        look = self._look
        if look is None or look.pose is None:
            return None
        (a, b, c), (x, y, z) = self._options.gains, (look.impairment or _SOUND).gains
        a, b, c, of_carrier = a * x, b * y, c * z, self._of_carrier
        there, position, rotation = look.transmitters, look.pose.position, look.pose.rotation
        if len(there.ids) <= FEW and there.medium is AIR:
            north, east, down = position.tolist()
            (nx, ny, nz), (ex, ey, ez), (dx, dy, dz) = rotation.tolist()

            def signal(index: int) -> Vector:
                pn, pe, pd, *moment = there.dipoles[index]
                _, hn, he, hd = one_field(north - pn, east - pe, down - pd, *moment)
                x, y, z = (hn * n + he * e + hd * d for n, e, d in ((nx, ex, dx), (ny, ey, dy), (nz, ez, dz)))
                gain = of_carrier[index]
                return x * a * gain, y * b * gain, z * c * gain

            return signal
        fields = zip((there.field_at(position) @ rotation).tolist(), of_carrier, strict=True)
        every = [(x * a * gain, y * b * gain, z * c * gain) for (x, y, z), gain in fields]
        return every.__getitem__

    def noise(self, sender: int) -> Vector:
        """Return the noise of the next pulse: the receiver's own, or interference."""
        look = self._look
        assert look is not None
        sigma_na_m = math.hypot(self._sigma_na_m, (look.impairment or _SOUND).noise_na_m)
        sigma = sigma_na_m / self._scale_na_m
        x, y, z = next(self._draws)
        own = sigma * x, sigma * y, sigma * z
        if look.noise is None or look.pose is None:
            self.interference = 3 * sigma_na_m > self._limit_na_m * (1 + 1e-9)
            return own
        x, y, z = (look.noise[sender] @ look.pose.rotation).tolist()
        self.interference = math.hypot(x, y, z) * self._scale_na_m > self._limit_na_m
        return x, y, z

    def limited(self, signal: Vector) -> Vector:
        """Return a signal, limited by the saturation of the antennas."""
        assert self._look is not None
        limit_na_m = (self._look.impairment or _SOUND).saturation_na_m
        if self._options.saturation_na_m is not None:
            limit_na_m = min(limit_na_m, self._options.saturation_na_m)
        limit = limit_na_m / self._scale_na_m
        if max(map(abs, signal)) <= limit:
            return signal
        x, y, z = (max(-limit, min(limit, value)) for value in signal)
        return x, y, z


class ListeningReceiver:
    """The common part of the `ReceiverModel`s that listen to pulses: they take a sample at the end of each pulse."""

    Options: ClassVar[type[PulsedOptions]] = PulsedOptions

    def __init__(self, settings: ReceiverSettings, options: PulsedOptions, seed: int) -> None:
        self._options = options
        law = settings.display.table if settings.display else None
        self._display = Display(options, settings.kappa_eq, law)
        self._listening = Listening(settings, options, seed)

    @classmethod
    def from_settings(cls, settings: ReceiverSettings, seed: int) -> Self:
        return cls(settings, settings.options, seed)

    def next_look(self, after_s: float, frame_s: float) -> float:
        """See `ReceiverModel`: when a pulse ends."""
        return self._listening.next_look(after_s)
