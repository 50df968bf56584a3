"""Where a vehicle truly is, from where its autopilot believes it is: a seeded error between the two."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from arva_hil.field import rotation

__all__ = ["PoseError"]

Array = NDArray[np.float64]

_STEP_S: Final = 0.1  # of the walk; between two steps it is straight
_KEEP: Final = 600  # steps: who asks for a time before them has the walk computed again from its start


class PoseError:
    """Remembers the last minute of a random walk. The true pose is the reported pose and this.

    `bias_ned` (3,): metres. `walk_sigma_m`, `walk_tau_s`: standard deviation and correlation time of a Gauss-Markov
    process on each axis. `heading_deg`: the true heading is this much further clockwise. The same seed gives the same
    error at the same time, however often and in whatever order it is asked for.
    """

    def __init__(
        self, bias_ned: ArrayLike, walk_sigma_m: float, walk_tau_s: float, heading_deg: float, *, seed: int
    ) -> None:
        self._bias = np.asarray(bias_ned, float)
        self._sigma = walk_sigma_m
        self._keep = math.exp(-_STEP_S / walk_tau_s)
        self._turn = rotation.from_euler(0.0, 0.0, math.radians(heading_deg))
        self._seed = seed
        self._begin()

    def true_pose(self, time_s: float, position: Array, attitude: Array) -> tuple[Array, Array]:
        """Position (3,) NED, metres, and attitude quaternion (4,), body → NED, from those reported.

        `time_s`: from the start of the run; before it the error is that of the start.
        """
        there = position + self._bias
        if self._sigma:
            there += self._walked(max(0.0, time_s / _STEP_S))
        return there, rotation.multiply(self._turn, attitude)

    def _begin(self) -> None:
        self._random = np.random.Generator(np.random.PCG64([self._seed, 0x57A4]))
        self._first = 0  # the number of the oldest step remembered
        self._steps = deque([self._sigma * self._random.standard_normal(3)])

    def _walked(self, steps: float) -> Array:
        number = math.floor(steps)
        if number < self._first:
            self._begin()
        spread = self._sigma * math.sqrt(1 - self._keep**2)
        while self._first + len(self._steps) <= number + 1:
            self._steps.append(self._keep * self._steps[-1] + spread * self._random.standard_normal(3))
            if len(self._steps) > _KEEP:
                self._steps.popleft()
                self._first += 1
        before, after = self._steps[number - self._first], self._steps[number + 1 - self._first]
        return before + (steps - number) * (after - before)
