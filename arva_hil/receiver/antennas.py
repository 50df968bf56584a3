"""A pulse as it reaches the display: antennas, noise, threshold, zones, steps."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from arva_hil.receiver.paper import outputs
from arva_hil.receiver.pulsed_options import PulsedOptions
from arva_hil.receiver.reading import Zone
from arva_hil.receiver.separation import Vector
from arva_hil.receiver.track import Shown

__all__ = ["Display", "NoiseDraws"]

_BATCH: Final = 256
_LARGEST_CM: Final = 9900


class NoiseDraws:
    """Draws normal noise for three antennas, from a seed; nothing when `sigma` is 0. Remembers its generator."""

    def __init__(self, sigma: float, seed: int) -> None:
        self.sigma = sigma
        self._rng = np.random.Generator(np.random.PCG64(seed))
        self._drawn: list[list[float]] = []

    def draw(self) -> Vector:
        """The next three."""
        if not self.sigma:
            return 0.0, 0.0, 0.0
        if not self._drawn:
            self._drawn = (self.sigma * self._rng.standard_normal((_BATCH, 3))).tolist()
        x, y, z = self._drawn.pop()
        return x, y, z


class Display:
    """Makes the display's values of a signal. Remembers the last direction, for receivers that keep it near by.

    `kappa_eq`: turns field into distance. Signals are in units of the reference transmitter's field.
    """

    def __init__(self, options: PulsedOptions, kappa_eq: float) -> None:
        self._options = options
        self._kappa_eq = kappa_eq
        self._scale = options.scale_na_m
        self._limit = math.inf if options.saturation_na_m is None else options.saturation_na_m / self._scale
        self._there = (1.0, float(options.antennas > 1), float(options.antennas > 2))
        self._inner_m = options.third_within_m if options.antennas > 2 else -1.0
        self._mid_m = options.range_m(kappa_eq)
        self._directions: dict[int, int] = {}  # by the transmitter's index

    def heard(self, signal: Vector, noise: Vector) -> Vector:
        """What the antennas say of a signal."""
        x, y, z = signal
        u, v, w = noise
        if (there := self._there) != (1.0, 1.0, 1.0):
            x, y, z, u, v, w = x * there[0], y * there[1], z * there[2], u * there[0], v * there[1], w * there[2]
        x, y, z = x + u, y + v, z + w
        limit = self._limit
        if max(abs(x), abs(y), abs(z)) > limit:
            x, y, z = (max(-limit, min(limit, value)) for value in (x, y, z))
        return x, y, z

    def shown(self, index: int, signal: Vector) -> Shown | None:
        """What the display says of a signal; None: it is below the threshold."""
        d, delta, zone_ = outputs(signal, self._kappa_eq, self._inner_m, self._mid_m)
        zone, d_cm, delta_deg = int(zone_), int(d), int(delta)
        if zone == Zone.OUTER:
            return None
        options = self._options
        if options.antennas == 1:
            delta_deg = 0
        if zone == Zone.MID:
            delta_deg = self._arrow(delta_deg)
            self._directions[index] = delta_deg
        elif options.near_direction == "frozen":
            delta_deg = self._directions.get(index, 0)
        x, y, z = signal
        scale = self._scale
        return Shown(zone, self._step(d_cm), delta_deg, (x * scale, y * scale, z * scale))

    def _step(self, d_cm: int) -> int:
        options = self._options
        if options.steps == "digits":
            step = 10 if d_cm < 995 else 100
            d_cm = min(_LARGEST_CM, step * ((2 * d_cm + step) // (2 * step)))
        return max(d_cm, round(100 * options.lowest_m))

    def _arrow(self, delta_deg: int) -> int:
        arrows = self._options.directions
        if not arrows:
            return delta_deg
        width = 180 / arrows
        return round(-90 + width * (min(arrows - 1, math.floor((delta_deg + 90) / width)) + 0.5))
