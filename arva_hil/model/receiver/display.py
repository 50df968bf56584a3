"""The display of a receiver: threshold, zones, steps of d, arrows."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from typing import Final

from arva_hil.model.receiver.paper import near, output
from arva_hil.model.receiver.pulsed_options import PulsedOptions
from arva_hil.model.receiver.reading import Vector, Zone

_LARGEST_CM: Final = {"digits": 9900, "cm": 32767}  # two digits; what frames can carry


@dataclass(frozen=True)
class DisplayLaw:
    """A table of fields, which rise, and of the d that the display shows at each, which falls.

    `source`: the file. `field_na_m`: at the antennas that count [nA/m]. `d_m`: metres.
    """

    source: str
    field_na_m: tuple[float, ...]
    d_m: tuple[float, ...]

    def d(self, field_na_m: float) -> float:
        """Return d [m] at a field, linear in the logarithms; beyond the table it is that of the table's end."""
        after = bisect_right(self.field_na_m, field_na_m)
        if after == 0:
            return self.d_m[0]
        if after == len(self.d_m):
            return self.d_m[-1]
        low, high = self.field_na_m[after - 1], self.field_na_m[after]
        share = math.log(field_na_m / low) / math.log(high / low)
        return self.d_m[after - 1] * math.exp(share * math.log(self.d_m[after] / self.d_m[after - 1]))


@dataclass(frozen=True, slots=True)
class Shown:
    """The values of one pulse: those of the display, and the signed signal of the antennas [nA/m]."""

    zone: int
    d_cm: int
    delta_deg: int
    signal_na_m: Vector


class Display:
    """Remembers the last direction of each transmitter, for receivers that keep it near the transmitter.

    `kappa_eq`: factor from field to distance; with a `law` only for zones and range. Signals are in units of the
    reference transmitter's field.
    """

    def __init__(self, options: PulsedOptions, kappa_eq: float, law: DisplayLaw | None = None) -> None:
        self._options = options
        self._law = law
        self._cbrt = math.cbrt(kappa_eq / (4 * math.pi))
        self._scale = options.scale_na_m
        self._inner_m = options.third_within_m if options.antennas > 2 else -1.0
        self._near = near(kappa_eq, self._inner_m) if self._inner_m > 0 else math.inf
        self._mid_m = options.range_m(kappa_eq)
        self._directions: dict[int, int] = {}  # by the transmitter's index

    def antennas(self, signal: Vector) -> Vector:
        """Return the part of a signal at the antennas that the receiver has."""
        x, y, z = signal
        there = self._options.antennas
        return x, y if there > 1 else 0.0, z if there > 2 else 0.0

    def shown(self, index: int, signal: Vector) -> Shown | None:
        """Return the values of a signal; None below the threshold."""
        if (heard := output(signal, self._cbrt, self._near, self._inner_m, self._mid_m)) is None:
            return None
        d_cm, delta_deg, zone = heard
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
        if self._law is not None:
            d_cm = round(100 * self._law.d(scale * math.hypot(x, y, z if zone == Zone.INNER else 0.0)))
        return Shown(zone, self._step(d_cm), delta_deg, (x * scale, y * scale, z * scale))

    def _step(self, d_cm: int) -> int:
        options = self._options
        if options.steps == "digits":
            step = 10 if d_cm < 995 else 100
            d_cm = step * ((2 * d_cm + step) // (2 * step))
        return max(min(d_cm, _LARGEST_CM[options.steps]), round(100 * options.lowest_m))

    def _arrow(self, delta_deg: int) -> int:
        arrows = self._options.directions
        if not arrows:
            return delta_deg
        width = 180 / arrows
        return round(-90 + width * (min(arrows - 1, math.floor((delta_deg + 90) / width)) + 0.5))
