"""Rotations: quaternions (w, x, y, z) from body to world coordinates, as in MAVLink; mounts of receivers.

Angles in radians. Every function accepts any leading shape (...). Input quaternions may have any length but 0;
returned ones have length 1. Raises ValueError for length 0 or values that are not finite.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from arva_hil.model.field.arrays import Array
from arva_hil.model.field.quaternion import NO_ROTATION, matrix, rows


def from_euler(roll: ArrayLike, pitch: ArrayLike, yaw: ArrayLike) -> Array:
    """Return quaternion (..., 4) of yaw about z, then pitch about the new y, then roll about the new x."""
    r, p, y = (np.asarray(angle, float) / 2 for angle in (roll, pitch, yaw))
    cr, sr, cp, sp, cy, sy = np.cos(r), np.sin(r), np.cos(p), np.sin(p), np.cos(y), np.sin(y)
    return _stack(
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def to_euler(rotation: ArrayLike) -> Array:
    """(roll, pitch, yaw) (..., 3) of quaternions (..., 4) or matrices (..., 3, 3); pitch in [−π/2, π/2].

    Right at pitch ±π/2 too, where only roll ∓ yaw is defined: the returned yaw fits the returned roll.
    """
    rotation = np.asarray(rotation, float)
    m = to_matrix(rotation) if rotation.shape[-1] == 4 else rotation
    roll = np.arctan2(m[..., 2, 1], m[..., 2, 2])
    pitch = np.arctan2(-m[..., 2, 0], np.hypot(m[..., 0, 0], m[..., 1, 0]))
    c, s = np.cos(roll), np.sin(roll)
    yaw = np.arctan2(s * m[..., 0, 2] - c * m[..., 0, 1], c * m[..., 1, 1] - s * m[..., 1, 2])
    return _stack(roll, pitch, yaw)


def to_matrix(q: ArrayLike) -> Array:
    """Return rotation matrix (..., 3, 3), body → world, of a quaternion (..., 4)."""
    if isinstance(q, tuple) and len(q) == 4 and isinstance(q[0], float):  # a single one, as it is nearly always
        return np.array(matrix(*q))
    q = np.asarray(q, float)
    if q.shape == (4,):
        return np.array(matrix(*q.tolist()))
    length = np.sqrt(np.add.reduce(q * q, axis=-1, keepdims=True))
    if not ((length > 0) & (length < np.inf)).all():
        raise ValueError(NO_ROTATION)
    return np.moveaxis(np.array(rows(*np.moveaxis(q / length, -1, 0))), (0, 1), (-2, -1))


def _stack(*parts: Array) -> Array:
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


class Mount:
    """`position` (3,) in metres, body frame FRD; `attitude` (4,): quaternion, mounted → body."""

    def __init__(self, position: ArrayLike = (0.0, 0.0, 0.0), attitude: ArrayLike = (1.0, 0.0, 0.0, 0.0)) -> None:
        self._position = np.asarray(position, float)
        self._aside = bool(self._position.any())
        self._rotation = to_matrix(attitude)
        self._turned = not np.array_equal(self._rotation, np.eye(3))

    def pose(self, position: ArrayLike, attitude: ArrayLike) -> tuple[Array, Array]:
        """Return the pose of the mounted part: p (..., 3) in NED, metres, and R (..., 3, 3), mounted → NED.

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
