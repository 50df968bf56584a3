"""A receiver on a rope under its vehicle: a pendulum that is excited by the vehicle's motion."""

from __future__ import annotations

import cmath
import math
from typing import Final

import numpy as np

from arva_hil.model.field.arrays import Array

_G_M_S2: Final = 9.81
_STEEPEST: Final = 0.9  # the horizontal part of the rope's length: the linear law is wrong for larger swings
_LONGEST_S: Final = 5.0  # after a longer gap it hangs at rest


class Sling:
    """The swing of the load: a damped oscillator on each horizontal axis, for small swings.

    It is exact for a constant acceleration between two known velocities of the vehicle. `length_m`: length of the rope.
    `damping`: damping of the swing, relative to critical, below 1.
    """

    def __init__(self, length_m: float, damping: float) -> None:
        if not length_m > 0 or not 0 <= damping < 1:
            raise ValueError(f"a sling of {length_m:g} m, damping {damping:g}: expected above 0, and from 0 to below 1")
        self.length_m = length_m
        self._pole = math.sqrt(_G_M_S2 / length_m) * complex(-damping, math.sqrt(1 - damping * damping))
        self._time_s: float | None = None
        self._velocity: tuple[float, float] = (0.0, 0.0)
        self._swing = [(0.0, 0.0), (0.0, 0.0)]  # north, east: offset from the point of suspension [m], and its rate

    def hang(self, time_s: float, position: Array, velocity: Array, rotation: Array) -> tuple[Array, Array]:
        """Return the pose of the load at a time: position (3,) NED [m] and load → NED (3, 3).

        `position` (3,) of the point of suspension and `velocity` (3,) of the vehicle, NED; `rotation` (3, 3), vehicle →
        NED. The load has the vehicle's heading and is tilted with the rope. Times of calls never go back.
        """
        north, east, _ = velocity.tolist()
        last = self._time_s
        if last is None or time_s - last > _LONGEST_S:
            self._swing = [(0.0, 0.0), (0.0, 0.0)]
        elif time_s > last:
            span = time_s - last
            rates = [(now - before) / span for now, before in zip((north, east), self._velocity, strict=True)]
            self._swing = [self._swung(*one, rate, span) for one, rate in zip(self._swing, rates, strict=True)]
        self._time_s, self._velocity = time_s, (north, east)
        (x, _), (y, _) = self._swing
        return self._pose(x, y, position, rotation)

    def _swung(self, offset: float, rate: float, acceleration: float, span: float) -> tuple[float, float]:
        """Return offset and rate of one axis after the time `span`, with this acceleration of the upper end."""
        pole = self._pole
        rest = -acceleration / abs(pole) ** 2
        # offset − rest = Re(c · exp(pole · t)) with the rate Re(c · pole · exp(pole · t))
        real = offset - rest
        c = complex(real, (pole.real * real - rate) / pole.imag)
        turned = c * cmath.exp(pole * span)
        return rest + turned.real, (turned * pole).real

    def _pose(self, x: float, y: float, position: Array, rotation: Array) -> tuple[Array, Array]:
        length, off = self.length_m, math.hypot(x, y)
        if off > _STEEPEST * length:
            x, y = x * _STEEPEST * length / off, y * _STEEPEST * length / off
        down = np.array([x, y, math.sqrt(length * length - x * x - y * y)]) / length
        ahead = np.array([rotation[0, 0], rotation[1, 0], 0.0])
        ahead -= down * (ahead @ down)
        size = float(np.linalg.norm(ahead))
        ahead = ahead / size if size > 1e-9 else np.array([1.0, 0.0, 0.0])
        return position + length * down, np.column_stack([ahead, np.cross(down, ahead), down])
