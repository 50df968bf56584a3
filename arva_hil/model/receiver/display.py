"""Receivers that listen to pulses: their keys, and their display with its threshold, zones, steps of d and arrows.

Sources of the defaults: docs/explanation/pulsed.md.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Final, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from arva_hil.model.receiver.paper import distance, near, output
from arva_hil.model.receiver.reading import Vector, Zone

_REFERENCE_M: Final = 10.0  # the norm's distance
_NA_PER_UA: Final = 1e3

Frames = Literal["rate", "pulses"]
Steps = Literal["digits", "cm"]
NearDirection = Literal["zero", "frozen"]


@dataclass(frozen=True)
class PulsedOptions:
    """The keys of `model: pulsed` besides those of every receiver. Raises ValueError for contradictory values."""

    reference_ua_m: Annotated[
        float, Gt(0), Le(1000), "field on the axis of the transmitter of strength 1, at 10 m [µA/m]"
    ] = 1.0
    noise_na_m: Annotated[
        float | None, Ge(0), "standard deviation of each antenna and pulse [nA/m]; default: by noise.floor_range_m"
    ] = None
    threshold_na_m: Annotated[float, Gt(0), "a weaker pulse is not received [nA/m]"] = 2.25
    antennas: Annotated[Literal[1, 2, 3], "1: x; 2: x, y; 3: also z near by"] = 3
    third_within_m: Annotated[float, Ge(0), Le(1000), "the third antenna counts up to this distance [m]"] = 3.0
    gains: Annotated[tuple[float, float, float], "of the antennas x, y and z; 0 is a dead one"] = (1.0, 1.0, 1.0)
    carrier_db: Annotated[
        tuple[tuple[float, float], ...], "own sensitivity over the carrier's offset: [[Hz, dB], …], linear between"
    ] = ()
    saturation_na_m: Annotated[float | None, Gt(0), "upper limit of each antenna [nA/m]"] = None
    start_s: Annotated[float, Ge(0), "from switching on until it receives [s]"] = 3.0
    steps: Annotated[Steps, "of d: digits is 0.1 m below 10 m, then 1 m, up to 99 m; or cm, up to 327.67 m"] = "digits"
    lowest_m: Annotated[float, Ge(0), Le(99), "the lowest d [m]"] = 0.0
    directions: Annotated[int, Ge(0), Le(180), "number of arrows from −90° to 90°; 0: whole degrees"] = 0
    near_direction: Annotated[NearDirection, "δ where the third antenna counts: 0, or the last one"] = "zero"
    frames: Annotated[Frames, "at rate_hz, or one a received pulse and at least rate_hz"] = "rate"
    lag_s: Annotated[float, Ge(0), Le(10), "the display is so late [s]"] = 0.0
    mark_within_m: Annotated[float, Ge(0), "a transmitter farther away cannot be marked [m]"] = 6.0
    self_test_m: Annotated[
        float | None, Gt(0), "its self-test fails when it starts nearer to a transmitter, or beside electronics [m]"
    ] = None
    revert_s: Annotated[float | None, Gt(0), "after this time without motion it sends instead of searching [s]"] = None

    def __post_init__(self) -> None:
        if not all(0 <= gain <= 1 for gain in self.gains) or not any(self.gains):
            raise ValueError(f"gains {list(self.gains)}: expected three values in [0, 1], at least one above 0")
        offsets = [hertz for hertz, _ in self.carrier_db]
        if any(b <= a for a, b in pairwise(offsets)) or any(decibels > 0 for _, decibels in self.carrier_db):
            raise ValueError(f"carrier_db {[list(one) for one in self.carrier_db]}: expected Hz that rise, dB up to 0")
        if self.saturation_na_m is not None and self.saturation_na_m <= self.threshold_na_m:
            raise ValueError(
                f"saturation_na_m {self.saturation_na_m:g}: expected above threshold_na_m ({self.threshold_na_m:g})"
            )

    @property
    def scale_na_m(self) -> float:
        """The field [nA/m] that is 1 in units of the reference transmitter (1 / 2π on its axis at 1 m)."""
        return self.reference_ua_m * _NA_PER_UA * 2 * math.pi * _REFERENCE_M**3

    def carrier_gain(self, offset_hz: float) -> float:
        """Return the gain for a carrier so far from 457 kHz."""
        if not self.carrier_db:
            return 1.0
        hertz, decibels = zip(*self.carrier_db, strict=True)
        return float(10 ** (np.interp(offset_hz, hertz, decibels) / 20))

    def sigma_na_m(self, floor_range_m: float) -> float:
        """Return the noise of each antenna: `noise_na_m`, or a third of the reference transmitter's field.

        The paper's noise has a uniform magnitude up to that field, and any direction. So the root mean square of a
        component is a third of that field.
        """
        if self.noise_na_m is not None:
            return self.noise_na_m
        return self.reference_ua_m * _NA_PER_UA * (_REFERENCE_M / floor_range_m) ** 3 / 3

    def range_m(self, kappa_eq: float) -> float:
        """Return the d [m] of a signal at the threshold."""
        return float(distance(self.threshold_na_m / self.scale_na_m, kappa_eq))  # type: ignore[arg-type]


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
        self._mid_m = options.range_m(kappa_eq)
        self._inner_m = min(options.third_within_m, self._mid_m) if options.antennas > 2 else -1.0
        self._near = near(kappa_eq, self._inner_m) if self._inner_m > 0 else math.inf
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
