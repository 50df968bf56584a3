"""The news of an engine: frozen values, each with its time and the vehicle, receiver or link that it concerns.

There is no other news. Nothing in here is a sentence: the console makes those. What the engine and its links tell is
here, in `vehicles` what the session with a vehicle and its commander tell of it. Times are seconds on the clock of
whoever drives the engine.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from arva_hil.events.frozen import Frozen
from arva_hil.mavlink.codec import Packet
from arva_hil.receiver import Pose, Reading
from arva_hil.vehicle.reasons import NoPose, NoVehicle
from firmware_proto import Frame


class Event(Frozen):
    """Something that happened at `time_s`."""

    time_s: float


class ObserverFailed(Event):
    """An observer raised `error` and is switched off."""

    observer: str
    error: str


# -- links -------------------------------------------------------------------------------------------------


class LinkEvent(Event):
    """`link`: its name in the engine."""

    link: str


class LinkLost(LinkEvent):
    """`address`: its connection string. `reason`: the error of the link, with its cure."""

    address: str
    reason: str


class LinkBlocked(LinkEvent):
    """It is there again and cannot be opened, or there is another reason why it is not back."""

    address: str
    reason: str


class LinkThere(LinkEvent):
    """What was not there yet when the run began is there now."""

    address: str


class LinkBack(LinkEvent):
    """`away_s`: how long it was lost."""

    address: str
    away_s: float


class StrangersIgnored(LinkEvent):
    """Others than the link's peer have sent something, `stranger` the first of them. Once a link."""

    address: str
    stranger: str


class PacketsReceived(LinkEvent):
    """Every packet of one chunk, whoever sent it, believed or not."""

    packets: Sequence[Packet]


class LogLayout(Event):
    """A log is not laid out as usual: `layout` says how, "" when it has no times at all."""

    log: str
    layout: str


class LogClockSet(Event):
    """The clock of whoever wrote the log was set meanwhile: time goes on by the vehicles' own clocks."""

    log: str


# -- systems that transmitters follow ----------------------------------------------------------------------


class FollowedSystemSilent(Event):
    """No pose of MAVLink system `system` is heard on any link: the transmitters that follow it are silent.

    `was_heard`: before.
    """

    system: int
    was_heard: bool


class FollowedSystemHeard(Event):
    """Its pose is heard, after it was not: the transmitters that follow it are where it is."""

    system: int


# -- receivers ---------------------------------------------------------------------------------------------


class ReceiverEvent(Event):
    """`vehicle` and `receiver` are names in the scenario."""

    vehicle: str
    receiver: str


class FrameMade(ReceiverEvent):
    """One frame: its instant, what the receiver shows then, the pose that this was heard at, and what the frame says.

    `pose` is where the receiver truly was, `reported_pose` where it would be if its vehicle were where it reports to
    be; the same object where the report counts as the truth.
    """

    number: int  # 0…
    instant_s: float  # from the start of the run
    boot_s: float | None  # the same instant on the autopilot's clock
    pose: Pose | None  # None: no pose, or one too old
    age_s: float | None  # of the pose
    reading: Reading
    frame: Frame
    sent: bool  # False: nobody took it, or a fault keeps it from being sent
    late_s: float  # how long after its instant it was made
    faults: tuple[str, ...] = ()  # that it met
    reported_pose: Pose | None = None  # None: no report, or one too old


class BytesSent(ReceiverEvent):
    """What a port took: a frame, or what faults left of it."""

    data: bytes


class FramesRefused(ReceiverEvent):
    """Nobody takes the frames: they are dropped until somebody does."""


class FramesTaken(ReceiverEvent):
    """Somebody takes the frames again. `dropped`: how many were dropped so far."""

    dropped: int


class PoseFound(ReceiverEvent):
    """Readings are real from here on."""


class PoseLost(ReceiverEvent):
    """Frames say no signal. `age_s`: of the newest pose, None when there is none; `lacking`: why there is none."""

    age_s: float | None
    lacking: NoPose


class PoseMissing(ReceiverEvent):
    """There is a vehicle for some time, and still no pose."""

    lacking: NoPose


class TooFar(ReceiverEvent):
    """No transmitter can be heard from here. Once for each datum.

    `from_datum_m`: horizontally; `nearest_m`: to the nearest transmitter; `fixed`: the datum is not the vehicle's home.
    """

    from_datum_m: float
    nearest_m: float
    fixed: bool


# -- vehicles ----------------------------------------------------------------------------------------------


class VehicleEvent(Event):
    """`vehicle`: its name in the scenario."""

    vehicle: str


class DatumSet(VehicleEvent):
    """Where this vehicle's scenario has its origin now: degrees, degrees, metres AMSL.

    `reason`: why it is no longer where it was, "" for the first one.
    """

    lat: float
    lon: float
    alt: float
    reason: str


class HeartbeatMissing(VehicleEvent):
    """No autopilot was heard in time; `heard` is what was heard instead."""

    heard: NoVehicle


class StatusReport(Event):
    """How things stand, a few times a second: one entry a vehicle."""

    vehicles: Sequence[VehicleStatus]


class VehicleStatus(Frozen):
    """`label`: what it is, "" before there is one. `rates`: Hz by message name. `receivers`: one entry each."""

    name: str
    label: str
    rates: Mapping[str, float]
    receivers: Sequence[ReceiverStatus]


class ReceiverStatus(Frozen):
    """`frames`: that were to be sent; `dropped` of them nobody took. `last`: the newest, None before the first."""

    name: str
    last: FrameMade | None
    frames: int
    dropped: int
