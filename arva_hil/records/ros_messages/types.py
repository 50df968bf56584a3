"""The message types: those of ROS 2 Jazzy by rosbags, and the receiver's own; their bytes; publications of messages.

`Arva` is the message of the paper's simulator (`arva_sim/arva`), with δ and the zone of each slot in addition.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, NamedTuple, Protocol

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.stores import ros2_jazzy as jazzy

Time = jazzy.builtin_interfaces__msg__Time
Duration = jazzy.builtin_interfaces__msg__Duration
Header = jazzy.std_msgs__msg__Header
ColorRGBA = jazzy.std_msgs__msg__ColorRGBA
Point = jazzy.geometry_msgs__msg__Point
Vector3 = jazzy.geometry_msgs__msg__Vector3
Quaternion = jazzy.geometry_msgs__msg__Quaternion
Pose = jazzy.geometry_msgs__msg__Pose
PoseStamped = jazzy.geometry_msgs__msg__PoseStamped
Transform = jazzy.geometry_msgs__msg__Transform
TransformStamped = jazzy.geometry_msgs__msg__TransformStamped
TFMessage = jazzy.tf2_msgs__msg__TFMessage
NavSatFix = jazzy.sensor_msgs__msg__NavSatFix
CompressedImage = jazzy.sensor_msgs__msg__CompressedImage
MeshFile = jazzy.visualization_msgs__msg__MeshFile
Marker = jazzy.visualization_msgs__msg__Marker
# rosbags declares the two with the parts of another release
NavSatStatus: Final[Any] = jazzy.sensor_msgs__msg__NavSatStatus
MarkerArray: Final[Any] = jazzy.visualization_msgs__msg__MarkerArray
KeyValue = jazzy.diagnostic_msgs__msg__KeyValue
DiagnosticStatus = jazzy.diagnostic_msgs__msg__DiagnosticStatus
DiagnosticArray = jazzy.diagnostic_msgs__msg__DiagnosticArray


class Message(Protocol):
    """A message. `__msgtype__`: its name, e.g. `geometry_msgs/msg/Point`."""

    __msgtype__: ClassVar[str]


@dataclass
class ArvaData:
    """One slot.

    - `id`: −1 for an empty slot, whose values are the receiver's no-signal values, mostly −1; −2 if the frames carry no
      ids.
    - `distance`: the receiver's d [cm].
    - `direction`: in the receiver's frame FLU; (0, 0, 0) if it is not known. From an emulator it is the model's field
      of this transmitter without noise, in 1/m³ for κ‖m‖ = 1; from a search it is the direction of δ, with length 1.
    - `delta`: the receiver's δ, degrees, positive to the right.
    - `zone`: 0 outer, 1 mid, 2 inner.
    """

    id: int
    distance: float
    direction: Vector3
    delta: int
    zone: int
    __msgtype__: ClassVar[str] = "arva_msgs/msg/ArvaData"


@dataclass
class Arva:
    """One reading: all slots of the receiver, the nearest transmitter first. `header`: with the receiver's frame."""

    header: Header
    arva_signals: Sequence[ArvaData]
    __msgtype__: ClassVar[str] = "arva_msgs/msg/Arva"


_OURS: Final[dict[type[Message], str]] = {  # as in tools/ros2/arva_msgs
    ArvaData: "int32 id\nfloat32 distance\ngeometry_msgs/Vector3 direction\nint32 delta\nuint8 zone\n",
    Arva: "std_msgs/Header header\narva_msgs/ArvaData[] arva_signals\n",
}
STORE: Final = get_typestore(Stores.ROS2_JAZZY)
for _cls, _text in _OURS.items():
    STORE.register(get_types_from_msg(_text, _cls.__msgtype__))

PUBLISHED: Final[tuple[type[Message], ...]] = (Arva, PoseStamped, NavSatFix, MarkerArray, TFMessage, DiagnosticArray)
"""The types of messages that are published."""


def encode(message: Message) -> bytes:
    """Return a message as CDR, little endian. Raises struct.error for a number that its field cannot hold."""
    return bytes(STORE.serialize_cdr(message, message.__msgtype__, little_endian=True))


def schema(cls: type[Message]) -> str:
    """Return the `ros2msg` text: the message's definition, and that of each message in it."""
    return STORE.generate_msgdef(cls.__msgtype__, ros_version=2)[0]


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


MAP: Final = "map"  # the world; its origin is the scenario's
TF: Final = "/tf"
DIAGNOSTICS: Final = "/diagnostics"


class ReceiverNames(NamedTuple):
    """The names for one receiver.

    `map`: the frame of its poses. `frame`: its own frame. `transmitter`: the prefix of the transmitters' frames, before
    their ids. `arva`: the topic of its readings, which begins the others.
    """

    map: str
    frame: str
    transmitter: str
    arva: str


def names_of(receivers: Sequence[tuple[str, str]]) -> dict[tuple[str, str], ReceiverNames]:
    """Return the names for all receivers, by (vehicle, receiver). They have no prefix if there is only one receiver."""
    if len(receivers) < 2:
        return {of: _names("", MAP) for of in receivers or [("vehicle", "receiver")]}
    vehicles = unique([vehicle for vehicle, _ in receivers])
    prefixes = unique([f"{vehicles[vehicle]}/{receiver}" for vehicle, receiver in receivers])
    return {
        (vehicle, receiver): _names(f"{prefixes[f'{vehicles[vehicle]}/{receiver}']}/", f"{vehicles[vehicle]}/{MAP}")
        for vehicle, receiver in receivers
    }


def word(name: str) -> str:
    """Return a name for ROS: letters, digits and underscores, without a digit at the start."""
    allowed = re.sub("[^A-Za-z0-9_]", "_", name)
    return f"_{allowed}" if allowed[:1].isdigit() else allowed


def unique(names: Sequence[str]) -> dict[str, str]:
    """Return a different name for ROS for each name. Slashes are kept."""
    given: dict[str, str] = {}
    for name in dict.fromkeys(names):
        allowed = "/".join(map(word, name.split("/")))
        number, free = 2, allowed
        while free in given.values():
            free, number = f"{allowed}_{number}", number + 1
        given[name] = free
    return given


def _names(prefix: str, world: str) -> ReceiverNames:
    return ReceiverNames(world, f"{prefix}arva_receiver", f"{world.removesuffix(MAP)}arva_data_", f"/{prefix}arva")
