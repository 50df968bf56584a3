"""Single rotations as quaternions (w, x, y, z) in plain floats; `rotation` is for arrays of them."""

from __future__ import annotations

import math
from typing import Any

Quaternion = tuple[float, float, float, float]
Row = tuple[float, float, float]

NO_ROTATION = "a quaternion of length 0, or not finite, is no rotation"


def from_euler(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return the quaternion of angles in radians, FRD → NED, yaw first."""
    sr, cr = math.sin(roll / 2), math.cos(roll / 2)
    sp, cp = math.sin(pitch / 2), math.cos(pitch / 2)
    sy, cy = math.sin(yaw / 2), math.cos(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def unit(w: float, x: float, y: float, z: float) -> Quaternion:
    """Return the quaternion with length 1. Its length must not be 0."""
    length = math.hypot(w, x, y, z)
    return w / length, x / length, y / length, z / length


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the rotation b followed by a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def slerp(a: Quaternion, b: Quaternion, u: float) -> Quaternion:
    """Interpolate from a (u = 0) to b (u = 1), both of length 1, on the shortest path at a constant rate."""
    if a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] < 0:
        b = -b[0], -b[1], -b[2], -b[3]
    turn = 2 * math.atan2(math.dist(a, b), math.hypot(a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]))  # ≤ π/2
    of_a, of_b = (1 - u) * _sinc((1 - u) * turn), u * _sinc(u * turn)
    return unit(
        of_a * a[0] + of_b * b[0], of_a * a[1] + of_b * b[1], of_a * a[2] + of_b * b[2], of_a * a[3] + of_b * b[3]
    )


def _sinc(x: float) -> float:
    return math.sin(x) / x if x else 1.0


def matrix(w: float, x: float, y: float, z: float) -> tuple[Row, Row, Row]:
    """Return the rotation matrix, body → world, of a quaternion of any length but 0. Raises ValueError for that."""
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not 0 < length < math.inf:
        raise ValueError(NO_ROTATION)
    first, second, third = rows(w / length, x / length, y / length, z / length)
    return first, second, third


def rows(w: Any, x: Any, y: Any, z: Any) -> tuple[tuple[Any, Any, Any], ...]:
    """Return the rows of the rotation matrix of a quaternion of length 1, whose numbers may be arrays."""
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def heading(q: Quaternion) -> float:
    """Return the yaw of a rotation, body FRD → NED, in radians; also at pitch ±π/2, where it fits to the roll."""
    a, b, c = matrix(*q)
    roll = math.atan2(c[1], c[2])
    cos, sin = math.cos(roll), math.sin(roll)
    return math.atan2(sin * a[2] - cos * a[1], cos * b[1] - sin * b[2])
