"""The noise of a vehicle at its receiver. It rises with the motors' load and falls with the cube of their distance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from arva_hil.model.field.arrays import require

Point = tuple[float, float, float]

_AT_M: Final = 0.5  # distance of the specified noise: makers require it between a receiver and electronics
_NEAREST_M: Final = 0.05


@dataclass(frozen=True)
class VehicleNoise:
    """The noise that a vehicle's motors add to that of a receiver.

    - `motors`: their places, body FRD, metres.
    - `motor_na_m`: standard deviation of the noise of one motor at full load, 0.5 m away [nA/m].
    - `line_na_m`: the same of a harmonic of the motors' controllers within the receiver's band, at any load.
    - `levels`: instead of all these, the noise measured at the receiver over the load: (load, nA/m), linear between.

    No noise of a real vehicle at 457 kHz is published: the law is physics, the size is assumed.
    """

    motors: tuple[Point, ...]
    motor_na_m: float = 0.0
    line_na_m: float = 0.0
    levels: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        require(
            (bool(self.motors or self.levels), "a vehicle without motors makes no noise: expected one or more"),
            (self.motor_na_m >= 0 and self.line_na_m >= 0, "the noise of a motor is 0 nA/m or more"),
        )

    def sigma_na_m(self, place: Sequence[float], load: float) -> float:
        """Return standard deviation at an antenna at `place` (3,), body FRD, metres; `load`: 0…1."""
        if self.levels:
            loads, sigmas = np.array(self.levels).T
            return float(np.interp(load, loads, sigmas))
        one = math.hypot(self.motor_na_m * load, self.line_na_m)
        return one * math.hypot(*((_AT_M / max(math.dist(place, motor), _NEAREST_M)) ** 3 for motor in self.motors))
