"""The events of an engine: frozen values, each with its time and its vehicle, receiver or link.

Events have no sentences; the console makes those. This module has the events of the engine and its links; `vehicles`
has those of a vehicle's session and commander. Times are seconds on the clock of the engine's driver.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import dataclass_transform

from arva_hil.events.reasons import NoPose, NoVehicle, Reason
from arva_hil.mavlink.codec import Packet
from arva_hil.model.field.dipole import Transmitters
from arva_hil.model.receiver import Pose, Reading
from firmware_proto import Frame


@dataclass(frozen=True, eq=False, repr=False)
@dataclass_transform(frozen_default=True)
class Event:
    """Something that happened at `time_s`. Each subclass is a frozen dataclass without a decorator of its own."""

    time_s: float

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True, eq=False, repr=False)(
            cls
        )  # the methods below serve all events: a start takes 10 ms less

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and vars(other) == vars(self)

    def __hash__(self) -> int:
        return hash(tuple(vars(self).values()))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in vars(self).items())})"


class ObserverFailed(Event):
    """An observer raised `error` and is switched off."""

    observer: str
    error: str


class LinkEvent(Event):
    """`link`: the link's name in the engine. `address`: its connection string."""

    link: str
    address: str


class LinkLost(LinkEvent):
    """A link is lost. `reason`: its error, with the cure."""

    reason: str


class LinkBlocked(LinkEvent):
    """A lost link cannot be opened again. `reason`: e.g. another program has the port."""

    reason: str


class LinkThere(LinkEvent):
    """A link that was missing at the start of the run is open now."""


class LinkBack(LinkEvent):
    """A lost link is open again after `away_s`."""

    away_s: float


class StrangersIgnored(LinkEvent):
    """Other senders than the link's peer are ignored; `stranger` is the first. Once for each link."""

    stranger: str


class PacketsReceived(Event):
    """All packets of one chunk on the engine's `link`, of every sender, also those that are not used."""

    link: str
    packets: Sequence[Packet]


class LogLayout(Event):
    """A log has an unusual layout, `layout`; "" if it has no time stamps."""

    log: str
    layout: str


class LogClockSet(Event):
    """The clock of the log's computer was set during the recording. The vehicles' clocks are used instead."""

    log: str


class FollowedSystemSilent(Event):
    """No link receives a pose of MAVLink system `system`. Transmitters that follow it are silent.

    `was_heard`: its poses were received before.
    """

    system: int
    was_heard: bool


class FollowedSystemHeard(Event):
    """The system sends its pose. Transmitters follow it from now on."""

    system: int


class ReceiverEvent(Event):
    """`vehicle` and `receiver` are names in the scenario."""

    vehicle: str
    receiver: str


class FrameMade(ReceiverEvent):
    """One frame: its instant, the reading, the pose of this reading, and the frame's content.

    `pose`: the receiver's true pose. `reported_pose`: its pose by the vehicle's reported pose; the same object if the
    reported pose counts as true.
    """

    number: int  # 0…
    instant_s: float  # from the start of the run
    boot_s: float | None  # the same instant on the autopilot's clock
    pose: Pose | None  # None: no pose, or one too old
    age_s: float | None  # of the pose
    reading: Reading
    frame: Frame
    sent: bool  # False: no program read it, or a fault withheld it
    late_s: float  # delay after its instant
    faults: tuple[str, ...] = ()  # the faults that changed it
    reported_pose: Pose | None = None  # None: no report, or one too old


class BytesSent(ReceiverEvent):
    """Bytes that a port accepted: a frame, perhaps changed by faults. In a record of a real receiver: its bytes."""

    data: bytes


class ReceiverRestarted(ReceiverEvent):
    """A real receiver has restarted: its sequence number `after` does not follow `before`."""

    before: int
    after: int


class CommandReceived(ReceiverEvent):
    """The receiver follows a command of its host, or refuses it. Commands for which it has no time are only counted.

    `number`: the host's number of the command. `name`: e.g. "mark".
    """

    number: int
    name: str
    values: Sequence[int]


class CommandAnswered(ReceiverEvent):
    """The answer to a command. `result`: "done", "refused", "unknown" or "busy"; `sent`: a program read it."""

    number: int
    name: str
    result: str
    values: Sequence[int]
    text: str
    sent: bool


class FramesRefused(ReceiverEvent):
    """No program reads the frames. They are dropped until one does."""


class FramesLate(ReceiverEvent):
    """Frames are late repeatedly, the last one by `late_s`: the machine is overloaded."""

    late_s: float


class FramesTaken(ReceiverEvent):
    """A program reads the frames again. `dropped`: the number dropped so far."""

    dropped: int


class PoseFound(ReceiverEvent):
    """There is a pose. Readings are real from now on."""


class PoseLost(ReceiverEvent):
    """The pose is lost, so frames have no signal. `age_s`: of the newest pose, or None; `lacking`: the reason."""

    age_s: float | None
    lacking: NoPose


class PoseMissing(ReceiverEvent):
    """A vehicle was found, and there is still no pose after some seconds."""

    lacking: NoPose


class TooFar(ReceiverEvent):
    """The receiver is too far from all transmitters to detect one. Emitted once for each datum.

    `from_datum_m`: horizontal distance. `nearest_m`: distance to the nearest transmitter. `fixed`: the scenario gives
    the datum, so it is not the vehicle's home.
    """

    from_datum_m: float
    nearest_m: float
    fixed: bool


class VehicleEvent(Event):
    """`vehicle`: its name in the scenario."""

    vehicle: str


class DatumSet(VehicleEvent):
    """The vehicle has a new datum, the origin of the scenario: degrees, degrees, metres AMSL.

    `reason`: the reasons of a change, empty for the first datum.
    """

    lat: float
    lon: float
    alt: float
    reason: Sequence[Reason]


class GroundMissing(VehicleEvent):
    """Transmitters with a depth are silent, because the height of the ground is not known at their places.

    `ids`: their ids. `terrain`: the file of the grid, or "autopilot".
    """

    ids: Sequence[int]
    terrain: str


class GroundFound(VehicleEvent):
    """The autopilot has sent the height of the ground at every transmitter with a depth."""


class MotorsSilent(VehicleEvent):
    """The vehicle does not report the load of its motors. Their noise stays that of `load`, 0…1."""

    load: float


class MotorsHeard(VehicleEvent):
    """The vehicle reports the load of its motors again."""


class HeartbeatMissing(VehicleEvent):
    """No autopilot was found in time. `heard`: the traffic instead."""

    heard: NoVehicle


class StatusReport(Event):
    """The status of the run, a few times a second: one entry for each vehicle."""

    vehicles: Sequence[VehicleStatus]


@dataclass(frozen=True)
class VehicleStatus:
    """The status of one vehicle.

    `label`: the kind of vehicle and its ids, "" before it is found. `rates`: Hz by message name. `counters`: numbers of
    received and of unused packets by name, from the start. `source`: its link and system id, None before it is found.
    """

    name: str
    label: str
    rates: Mapping[str, float]
    receivers: Sequence[ReceiverStatus]
    counters: Sequence[tuple[str, int]] = ()
    source: tuple[str, int] | None = None


@dataclass(frozen=True)
class ReceiverStatus:
    """The status of one receiver.

    - `frames`: the number of frames to send. `dropped`: the number of frames that no reader took.
    - `last`: the newest frame; None before the first.
    - `transmitters`: at the receiver's newest sample, NED from the vehicle's datum; None before the first one.
    """

    name: str
    last: FrameMade | None
    frames: int
    dropped: int
    transmitters: Transmitters | None = None
