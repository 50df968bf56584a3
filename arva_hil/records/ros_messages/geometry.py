"""Places, rotations and shapes for ROS and its 3D views, such as RViz and Foxglove.

In the frames of ROS (REP 103) the world is east, north, up; bodies are forward, left, up. The rest of arva-hil uses
north, east, down and forward, right, down. Shapes: transmitters, their dipoles, the field at a receiver, a search.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from arva_hil.model.field import LocalFrame, rotation
from arva_hil.records.reading.search import ellipse_of
from arva_hil.records.ros_messages import types as ros
from arva_hil.records.ros_messages.types import ColorRGBA, Header, Marker, Point, Pose, Quaternion, Transform, Vector3

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


FIELD: Final = "field"  # the namespace of the field's arrows

_ORIGIN: Final = Point(0.0, 0.0, 0.0)
_UNTURNED: Final = Quaternion(0.0, 0.0, 0.0, 1.0)
_AT_ORIGIN: Final = Pose(_ORIGIN, _UNTURNED)
_COLOURS: Final = (  # of Okabe and Ito: colour-blind people can distinguish them
    (0.90, 0.62, 0.00),
    (0.34, 0.71, 0.91),
    (0.00, 0.62, 0.45),
    (0.94, 0.89, 0.26),
    (0.00, 0.45, 0.70),
    (0.84, 0.37, 0.00),
    (0.80, 0.47, 0.65),
)
_DIPOLE_M: Final = 2.0  # the length in the drawing
_FIELD_M: Final = 1.0


_NO_BYTES: Final = np.zeros(0, np.uint8)
_NO_TEXTURE: Final = ros.CompressedImage(Header(ros.Time(0, 0), ""), "", _NO_BYTES)
_NO_MESH: Final = ros.MeshFile("", _NO_BYTES)


def _marker(
    header: Header,
    ns: str,
    id_: int,
    kind: int,
    pose: Pose,
    scale: Vector3,
    color: ColorRGBA,
    *,
    points: Sequence[Point] = (),
    action: int = Marker.ADD,
) -> Marker:
    """Return a shape without text, texture and mesh. `kind`, `action`: constants of `Marker`."""
    return Marker(
        header,
        ns,
        id_,
        kind,
        action,
        pose,
        scale,
        color,
        lifetime=ros.Duration(0, 0),
        frame_locked=False,
        points=list(points),
        colors=[],
        texture_resource="",
        texture=_NO_TEXTURE,
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=_NO_MESH,
        mesh_use_embedded_materials=False,
    )


def colour(id_: int, opacity: float = 1.0) -> ColorRGBA:
    """Return the colour of a transmitter."""
    return ColorRGBA(*_COLOURS[id_ % len(_COLOURS)], opacity)


def transmitter(header: Header, id_: int, pose: Pose) -> tuple[Marker, Marker]:
    """Return a sphere for a transmitter, and an arrow for its dipole."""
    return (
        _marker(header, "transmitters", id_, Marker.SPHERE, pose, Vector3(0.4, 0.4, 0.4), colour(id_)),
        _marker(header, "dipoles", id_, Marker.ARROW, pose, Vector3(_DIPOLE_M, 0.08, 0.08), colour(id_)),
    )


def field(header: Header, slot: int, id_: int, direction: Vector3) -> Marker:
    """Return an arrow of constant length from the receiver along the field of a slot's transmitter.

    `header`: of the receiver's frame.
    """
    share = _FIELD_M / math.hypot(direction.x, direction.y, direction.z)
    tip = Point(direction.x * share, direction.y * share, direction.z * share)
    thick = Vector3(0.05, 0.1, 0.0)  # shaft and head
    return _marker(header, FIELD, slot, Marker.ARROW, _AT_ORIGIN, thick, colour(id_), points=(_ORIGIN, tip))


def is_direction(vector: Vector3) -> bool:
    """Return True if a vector has a direction."""
    return 0 < math.hypot(vector.x, vector.y, vector.z) < math.inf


def sphere(header: Header, ns: str, id_: int, at: Point, size_m: float, opacity: float = 1.0) -> Marker:
    """Return a sphere, in the colour of a search."""
    size = Vector3(size_m, size_m, size_m)
    return _marker(header, ns, id_, Marker.SPHERE, Pose(at, _UNTURNED), size, colour(6, opacity))


def ellipse(header: Header, ns: str, at: Point, covariance: tuple[float, float, float]) -> Marker:
    """Return the area with a probability of 95 % for the transmitter.

    `covariance`: of north and east [m²], (nn, ne, ee).
    """
    major, minor, bearing = ellipse_of(covariance)
    yaw = math.pi / 2 - bearing  # anticlockwise from east
    turned = Quaternion(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    size = Vector3(max(2 * major, 0.01), max(2 * minor, 0.01), 0.02)
    return _marker(header, ns, 0, Marker.CYLINDER, Pose(at, turned), size, colour(6, 0.4))


def removed(header: Header, ns: str, ids: Sequence[int]) -> list[Marker]:
    """Return markers that delete others."""
    size = Vector3(1.0, 1.0, 1.0)
    return [_marker(header, ns, id_, Marker.SPHERE, _AT_ORIGIN, size, colour(0), action=Marker.DELETE) for id_ in ids]
