"""What an autopilot believes of its pose, and where it truly is: a seeded error between the two."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import rotation

__all__ = ["NavigationError"]

Array = NDArray[np.float64]

_STEP_S: Final = 0.1  # of the walk; between two steps it is straight


@dataclass(frozen=True)
class Walk:
    """An Ornstein-Uhlenbeck process an axis: `sigma_m` is its standard deviation, `tau_s` its correlation time."""

    sigma_m: float = 0.0
    tau_s: float = 60.0


class NavigationError:
    """Remembers the walk so far. The true pose is the reported pose and this.

    `bias_ned` (3,): metres; `heading_deg`: the true heading is this much further clockwise; `latency_s`: a pose is
    reported so long after it was true. Same seed, same error at the same time, however often it is asked for; times
    may not go back by more than a step.
    """

    def __init__(self, bias_ned: ArrayLike, walk: Walk, heading_deg: float, latency_s: float, *, seed: int) -> None:
        self.latency_s = latency_s
        self._bias = np.asarray(bias_ned, float)
        self._walk = walk
        self._turn = rotation.from_euler(0.0, 0.0, math.radians(heading_deg))
        self._random = np.random.Generator(np.random.PCG64([seed, 0x57A4]))
        self._step = 0  # of `_after`
        self._before = self._after = walk.sigma_m * self._random.standard_normal(3)

    def true_pose(self, time_s: float, position: Array, attitude: Array) -> tuple[Array, Array]:
        """Position (3,) NED, metres, and attitude quaternion (4,), body → NED, from the reported ones at `time_s`."""
        return position + self._bias + self._wandered(time_s), rotation.multiply(self._turn, attitude)

    def _wandered(self, time_s: float) -> Array:
        if not self._walk.sigma_m:
            return self._after
        keep = math.exp(-_STEP_S / self._walk.tau_s)
        spread = self._walk.sigma_m * math.sqrt(1 - keep * keep)
        while self._step * _STEP_S < time_s:
            self._step += 1
            self._before, self._after = self._after, keep * self._after + spread * self._random.standard_normal(3)
        share = min(1.0, max(0.0, time_s / _STEP_S - self._step + 1))
        return self._before + share * (self._after - self._before)
