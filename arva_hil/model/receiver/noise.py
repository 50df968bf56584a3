"""The noise of the paper's receiver (eq. 5): its bound, its draws, and a source of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal

import numpy as np

from arva_hil.model.field.arrays import Array

NoiseKind = Literal["uniform", "gaussian", "off"]

_AHEAD: Final = 256  # values drawn at a time


def noise_bound(sensitivity: Sequence[float], floor_range_m: float) -> float:
    """Return the largest ‖w‖ (eq. 5), for the reference transmitter: κ‖m‖ = 1."""
    return 1 / (2 * math.pi * max(sensitivity) * floor_range_m**3)


def draw_noise(rng: np.random.Generator, m: int, kind: NoiseKind, bound: float) -> Array:
    """Return noise w (m, 3) in NED, from 3 doubles for each: uniform on the sphere, ‖w‖ ≤ bound.

    Magnitude: `uniform` in [0, bound]; `gaussian` is |N(0, bound/3)|, limited to the bound; `off` is 0 and draws none.
    """
    if kind == "off":
        return np.zeros((m, 3))
    height, azimuth, magnitude = rng.random((m, 3)).T
    if kind == "gaussian":
        from statistics import NormalDist  # slow to import

        inverse = NormalDist().inv_cdf
        magnitude = np.array([min(1.0, -inverse(tail / 2) / 3) for tail in (1 - magnitude).tolist()])
    z, size = 2 * height - 1, bound * magnitude
    across = np.sqrt(1 - z * z) * size
    half = np.tan(np.pi * azimuth)  # tangent of half the azimuth: much faster than cosine and sine
    more = 2 * across / (1 + half * half)  # across · (1 + cosine)
    return np.column_stack((more - across, half * more, z * size))


class NoiseSource:
    """A source of noise of one kind, up to a bound, from a seed. Remembers its generator, and noise drawn in advance.

    Many draws at once take hardly more time than one, and give the same numbers.
    """

    def __init__(self, kind: NoiseKind, bound: float, seed: int) -> None:
        self._kind = kind
        self._bound = bound
        self._rng = np.random.Generator(np.random.PCG64(seed))
        self._ahead: list[list[float]] = []

    def draw(self, m: int) -> Array:
        """Return the next (m, 3), NED: see `draw_noise`."""
        if m <= max(_AHEAD, len(self._ahead)):
            return np.array(self.draw_few(m)).reshape(m, 3)
        first = np.array(self._ahead).reshape(-1, 3)
        self._ahead = []
        return np.concatenate((first, draw_noise(self._rng, m - len(first), self._kind, self._bound)))

    def draw_few(self, m: int) -> list[list[float]]:
        """Return `draw` as plain numbers."""
        if m > len(self._ahead):
            self._ahead += draw_noise(self._rng, max(m, _AHEAD), self._kind, self._bound).tolist()
        drawn = self._ahead[:m]
        del self._ahead[:m]
        return drawn
