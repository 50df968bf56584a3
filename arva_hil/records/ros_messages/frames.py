"""Converts to the frames of ROS (REP 103): the world is east, north, up; bodies are forward, left, up.

The rest of arva-hil uses north, east, down and forward, right, down.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from arva_hil.model.field import LocalFrame, rotation
from arva_hil.records.ros_messages.types import Point, Pose, Quaternion, Transform, Vector3

_NED_TO_ENU = (0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0)  # (w, x, y, z): half a turn about the line north-east
_FLU_TO_FRD = (0.0, 1.0, 0.0, 0.0)  # half a turn about forward


def point(ned: Sequence[float]) -> Point:
    """Convert a place from NED [m] to ENU [m]."""
    north, east, down = ned
    return Point(east, north, -down)


def body_vector(frd: Sequence[float]) -> Vector3:
    """Convert a vector from body FRD to FLU."""
    forward, right, down = frd
    return Vector3(forward, -right, -down)


def orientation(matrix: ArrayLike) -> Quaternion:
    """Convert a rotation (3, 3) FRD → NED to the quaternion FLU → ENU."""
    of_body = rotation.from_angles(*rotation.to_euler(matrix).tolist())
    w, x, y, z = rotation.multiply(rotation.multiply(_NED_TO_ENU, of_body), _FLU_TO_FRD)
    return Quaternion(x, y, z, w)


def pose(position: ArrayLike, matrix: ArrayLike) -> Pose:
    """Convert position (3,) NED [m] and rotation (3, 3) FRD → NED to a pose in ENU."""
    return Pose(point(np.asarray(position, float).tolist()), orientation(matrix))


def transform(of: Pose) -> Transform:
    """Return the transform of a pose, from its body to the world."""
    at = of.position
    return Transform(Vector3(at.x, at.y, at.z), of.orientation)


def between(world: LocalFrame, own: LocalFrame) -> Transform:
    """Return the transform from the ENU frame of `own` to that of `world`."""
    origin, *ends = world.ned(*own.lla([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]))
    of_own = rotation.from_angles(*rotation.to_euler(np.stack([end - origin for end in ends], axis=1)).tolist())
    w, x, y, z = rotation.multiply(rotation.multiply(_NED_TO_ENU, of_own), _NED_TO_ENU)
    at = point(origin.tolist())
    return Transform(Vector3(at.x, at.y, at.z), Quaternion(-x, -y, -z, -w))  # two half turns change the sign
