"""Single rotations as quaternions (w, x, y, z) in plain floats; `rotation` has arrays of them."""

from __future__ import annotations

import math

Quaternion = tuple[float, float, float, float]


def from_euler(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Of angles in radians, FRD → NED, yaw first."""
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
    """Of length 1. It must not be 0."""
    length = math.hypot(w, x, y, z)
    return w / length, x / length, y / length, z / length


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """The rotation b followed by a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )
