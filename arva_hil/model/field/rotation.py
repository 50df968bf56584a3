"""Rotations: quaternions (w, x, y, z) from body to world coordinates, as in MAVLink; mounts, ropes, poses of receivers.

Angles in radians. The first functions are for single rotations in plain floats. Those from `from_euler` on are for
arrays, and accept any leading shape (...). Input quaternions of arrays may have any length but 0; returned ones have
length 1. Raises ValueError for length 0 or values that are not finite.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from arva_hil.model.field.arrays import Array, vector

Quaternion = tuple[float, float, float, float]
Row = tuple[float, float, float]

NO_ROTATION = "a quaternion of length 0, or not finite, is no rotation"


def from_angles(roll: float, pitch: float, yaw: float) -> Quaternion:
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
    """Return (roll, pitch, yaw) (..., 3) of quaternions (..., 4) or matrices (..., 3, 3); pitch in [−π/2, π/2].

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
    if isinstance(q, tuple) and len(q) == 4 and isinstance(q[0], float):  # a single one: the usual case
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


@dataclass(frozen=True, slots=True)
class Pose:
    """The receiver's own pose, mount included: position (3,) NED [m] from the datum, rotation (3, 3) receiver → NED.

    Lists are accepted as arrays. Raises ValueError for another shape.
    """

    position: Array
    rotation: Array

    def __post_init__(self) -> None:
        for name, shape in ("position", (3,)), ("rotation", (3, 3)):
            value = getattr(self, name)
            if type(value) is not np.ndarray or value.shape != shape or value.dtype != float:
                object.__setattr__(self, name, vector(name, value, *shape))


class Mount:
    """`position` (3,) in metres, body frame FRD; `attitude` (4,): quaternion, mounted → body."""

    def __init__(self, position: ArrayLike = (0.0, 0.0, 0.0), attitude: ArrayLike = (1.0, 0.0, 0.0, 0.0)) -> None:
        self._position = np.asarray(position, float)
        self._rotation = to_matrix(attitude)
        self._straight = not self._position.any() and np.array_equal(self._rotation, np.eye(3))

    def pose(self, position: ArrayLike, attitude: ArrayLike) -> tuple[Array, Array]:
        """Return the pose of the mounted part: p (..., 3) in NED, metres, and R (..., 3, 3), mounted → NED.

        From the vehicle's position (..., 3) in NED, metres, and its attitude (..., 4), body → NED.
        """
        R_body = to_matrix(attitude)
        if self._straight:
            return np.asarray(position, float), R_body
        return position + R_body @ self._position, R_body @ self._rotation


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
