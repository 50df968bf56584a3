"""The magnetic field of the transmitters (eq. 1, 2)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Transmitters", "dipole_field"]

Array = NDArray[np.float64]

_NEAREST_M = 0.01  # a receiver closer than this reads as if it were this far: the field stays finite


@dataclass(frozen=True, eq=False)
class Transmitters:
    """M transmitters at one instant. Raises ValueError when the shapes do not agree.

    `unplaced`: ids of those whose place is not known. They are silent, and no range to them is true.
    """

    ids: tuple[int, ...]
    positions: Array  # (M, 3) NED, metres
    rotations: Array  # (M, 3, 3) R_t, transmitter → NED; the dipole lies along the transmitter's x
    strengths: Array  # (M,) κ‖m‖; 1 is the reference transmitter
    unplaced: frozenset[int] = frozenset()

    def __post_init__(self) -> None:
        m = len(self.ids)
        shapes = (self.positions.shape, self.rotations.shape, self.strengths.shape)
        if shapes != ((m, 3), (m, 3, 3), (m,)):
            raise ValueError(f"{m} transmitters with positions, rotations, strengths of shape {shapes}")

    def ranges(self, point: Array) -> dict[int, float]:
        """How far [m] each is from a point (3,) in NED, by id."""
        at = point.tolist()
        every = zip(self.ids, self.positions.tolist(), strict=True)
        return {id_: math.dist(at, place) for id_, place in every if id_ not in self.unplaced}


def dipole_field(points: ArrayLike, positions: Array, rotations: Array, strengths: Array) -> Array:
    """The field (..., M, 3) in NED of each of M dipoles at each of the points (..., 3) in NED, metres.

    Eq. 1 and 2 with A(r) and R_t multiplied out: h = κ‖m‖ / (4π‖r‖³) · (3(a·n)n − a), where a is the dipole's
    axis and n = r/‖r‖, both in NED. For the other arguments see `Transmitters`. Finite everywhere.
    """
    r = np.asarray(points, float)[..., None, :] - positions
    axis = rotations[..., 0]
    distance = np.hypot(np.hypot(r[..., 0], r[..., 1]), r[..., 2])[..., None]
    n = np.empty_like(r)
    n[:] = axis  # stays so where r is 0
    np.divide(r, distance, out=n, where=distance > 0)
    inverse = 1 / np.maximum(distance, _NEAREST_M)
    along = np.add.reduce(n * axis, axis=-1, keepdims=True)
    h: Array = (strengths / (4 * np.pi))[:, None] * inverse * inverse * inverse * (3 * along * n - axis)
    return h
