"""The message types: those of ROS 2 Jazzy, and the receiver's own; publications of messages.

`Arva` is the message of the paper's simulator (`arva_sim/arva`), with δ and the zone of each slot in addition.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from arva_hil.records.ros_messages.message import (
    Bool,
    Byte,
    Bytes,
    Covariance,
    Float32,
    Float64,
    Int8,
    Int32,
    Message,
    Text,
    UInt8,
    UInt16,
    UInt32,
)


class Time(Message, package="builtin_interfaces"):
    """Since 1970."""

    sec: Int32
    nanosec: UInt32


class Duration(Message, package="builtin_interfaces"):
    sec: Int32
    nanosec: UInt32


class Header(Message, package="std_msgs"):
    stamp: Time
    frame_id: Text


class ColorRGBA(Message, package="std_msgs"):
    """0 to 1 each."""

    r: Float32
    g: Float32
    b: Float32
    a: Float32


class Point(Message, package="geometry_msgs"):
    x: Float64
    y: Float64
    z: Float64


class Vector3(Message, package="geometry_msgs"):
    x: Float64
    y: Float64
    z: Float64


class Quaternion(Message, package="geometry_msgs"):
    x: Float64
    y: Float64
    z: Float64
    w: Float64


class Pose(Message, package="geometry_msgs"):
    position: Point
    orientation: Quaternion


class PoseStamped(Message, package="geometry_msgs"):
    header: Header
    pose: Pose


class Transform(Message, package="geometry_msgs"):
    translation: Vector3
    rotation: Quaternion


class TransformStamped(Message, package="geometry_msgs"):
    header: Header
    child_frame_id: Text
    transform: Transform


class TFMessage(Message, package="tf2_msgs"):
    transforms: Sequence[TransformStamped]


class NavSatStatus(Message, package="sensor_msgs"):
    status: Int8
    service: UInt16


class NavSatFix(Message, package="sensor_msgs"):
    """Degrees; metres above mean sea level as in MAVLink, although ROS defines them above the ellipsoid."""

    header: Header
    status: NavSatStatus
    latitude: Float64
    longitude: Float64
    altitude: Float64
    position_covariance: Covariance
    position_covariance_type: UInt8


class CompressedImage(Message, package="sensor_msgs"):
    header: Header
    format: Text
    data: Bytes


class UVCoordinate(Message, package="visualization_msgs"):
    u: Float32
    v: Float32


class MeshFile(Message, package="visualization_msgs"):
    filename: Text
    data: Bytes


ORIGIN: Final = Point(0.0, 0.0, 0.0)
UNTURNED: Final = Quaternion(0.0, 0.0, 0.0, 1.0)
AT_ONCE: Final = Time(0, 0)


class Marker(Message, package="visualization_msgs"):
    """A shape in a 3D view. `action`: 0 draws it, 2 deletes it. `lifetime` 0: for ever."""

    header: Header
    ns: Text
    id: Int32
    type: Int32
    action: Int32
    pose: Pose
    scale: Vector3
    color: ColorRGBA
    lifetime: Duration = Duration(0, 0)
    frame_locked: Bool = False
    points: Sequence[Point] = ()
    colors: Sequence[ColorRGBA] = ()
    texture_resource: Text = ""
    texture: CompressedImage = CompressedImage(Header(AT_ONCE, ""), "", b"")
    uv_coordinates: Sequence[UVCoordinate] = ()
    text: Text = ""
    mesh_resource: Text = ""
    mesh_file: MeshFile = MeshFile("", b"")
    mesh_use_embedded_materials: Bool = False


class MarkerArray(Message, package="visualization_msgs"):
    markers: Sequence[Marker]


class KeyValue(Message, package="diagnostic_msgs"):
    key: Text
    value: Text


class DiagnosticStatus(Message, package="diagnostic_msgs"):
    """`level`: 0 good, 1 a warning, 2 an error, 3 stale."""

    level: Byte
    name: Text
    message: Text
    hardware_id: Text
    values: Sequence[KeyValue]


class DiagnosticArray(Message, package="diagnostic_msgs"):
    header: Header
    status: Sequence[DiagnosticStatus]


class ArvaData(Message, package="arva_msgs"):
    """One slot.

    - `id`: −1 for an empty slot, whose values are the receiver's no-signal values, mostly −1; −2 if the frames carry no
      ids.
    - `distance`: the receiver's d [cm].
    - `direction`: in the receiver's frame FLU; (0, 0, 0) if it is not known. From an emulator it is the model's field
      of this transmitter without noise, in 1/m³ for κ‖m‖ = 1; from a search it is the direction of δ, with length 1.
    - `delta`: the receiver's δ, degrees, positive to the right.
    - `zone`: 0 outer, 1 mid, 2 inner.
    """

    id: Int32
    distance: Float32
    direction: Vector3
    delta: Int32
    zone: UInt8


class Arva(Message, package="arva_msgs"):
    """One reading: all slots of the receiver, the nearest transmitter first. `header`: with the receiver's frame."""

    header: Header
    arva_signals: Sequence[ArvaData]


PUBLISHED: Final = (Arva, PoseStamped, NavSatFix, MarkerArray, TFMessage, DiagnosticArray)
"""The types of messages that are published."""

_SECOND: Final = 1_000_000_000  # ns
_LATEST: Final = 2**31 * _SECOND  # the end of the times that a message can have


class Publication(NamedTuple):
    """A message on a topic at `stamp_ns`, nanoseconds since 1970."""

    topic: str
    stamp_ns: int
    message: Message


def stamp_of(epoch_us: int, time_s: float) -> int:
    """Return nanoseconds since 1970; 0 for times that a message cannot have.

    `epoch_us`: microseconds since 1970 at time 0.
    """
    stamp_ns = epoch_us * 1000 + round(time_s * _SECOND)
    return stamp_ns if 0 <= stamp_ns < _LATEST else 0


def header(stamp_ns: int, frame: str) -> Header:
    """Return the header of a message with this time and frame."""
    return Header(Time(*divmod(stamp_ns, _SECOND)), frame)
