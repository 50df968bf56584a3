"""Shapes for 3D views such as RViz and Foxglove: transmitters, their dipoles, the field at a receiver, a search."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from arva_hil.records.ros_messages import types as ros
from arva_hil.records.ros_messages.types import ColorRGBA, Header, Marker, Point, Pose, Quaternion, Vector3

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
_CHI_95: Final = math.sqrt(-2 * math.log(1 - 0.95))  # sigmas to the edge of the area with a probability of 95 %


_FOR_EVER: Final = ros.Duration(0, 0)
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
        lifetime=_FOR_EVER,
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
    shaft = Vector3(_DIPOLE_M, 0.08, 0.08)
    return (
        _marker(header, "transmitters", id_, Marker.SPHERE, pose, Vector3(0.4, 0.4, 0.4), colour(id_)),
        _marker(header, "dipoles", id_, Marker.ARROW, pose, shaft, colour(id_)),
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
    nn, ne, ee = covariance
    mean, half = (nn + ee) / 2, math.hypot((nn - ee) / 2, ne)
    long, short = (2 * _CHI_95 * math.sqrt(max(variance, 0.0)) for variance in (mean + half, mean - half))
    bearing = math.atan2(2 * ne, nn - ee) / 2  # of the long axis, clockwise from north
    yaw = math.pi / 2 - bearing  # anticlockwise from east
    turned = Quaternion(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    size = Vector3(max(long, 0.01), max(short, 0.01), 0.02)
    return _marker(header, ns, 0, Marker.CYLINDER, Pose(at, turned), size, colour(6, 0.4))


def removed(header: Header, ns: str, ids: Sequence[int]) -> list[Marker]:
    """Return markers that delete others."""
    size = Vector3(1.0, 1.0, 1.0)
    return [_marker(header, ns, id_, Marker.SPHERE, _AT_ORIGIN, size, colour(0), action=Marker.DELETE) for id_ in ids]
