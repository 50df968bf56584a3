"""The mount of a receiver on a vehicle: position and attitude."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from arva_hil.model.field.arrays import Array
from arva_hil.model.field.rotation import to_matrix


class Mount:
    """`position` (3,) in metres, body frame FRD; `attitude` (4,): quaternion, mounted → body."""

    def __init__(self, position: ArrayLike = (0.0, 0.0, 0.0), attitude: ArrayLike = (1.0, 0.0, 0.0, 0.0)) -> None:
        self._position = np.asarray(position, float)
        self._aside = bool(self._position.any())
        self._rotation = to_matrix(attitude)
        self._turned = not np.array_equal(self._rotation, np.eye(3))

    def pose(self, position: ArrayLike, attitude: ArrayLike) -> tuple[Array, Array]:
        """The pose of the mounted part: p (..., 3) in NED, metres, and R (..., 3, 3), mounted → NED.

        From the vehicle's position (..., 3) in NED, metres, and its attitude (..., 4), body → NED.
        """
        R_body = to_matrix(attitude)
        if not self._aside and not self._turned:
            return np.asarray(position, float), R_body
        return position + R_body @ self._position, R_body @ self._rotation

    def place(self, position: ArrayLike, attitude: ArrayLike) -> Array:
        """`pose` without the rotation."""
        if not self._aside:
            return np.asarray(position, float)
        place: Array = position + to_matrix(attitude) @ self._position
        return place
