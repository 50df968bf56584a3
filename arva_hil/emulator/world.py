"""The world of one vehicle: its state, its surroundings and the transmitters, for its receivers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from arva_hil.autopilot.following.navigation import Navigation, VehicleState
from arva_hil.autopilot.following.on_request import MotorLoad, TerrainRequests
from arva_hil.autopilot.following.session import Received, Session
from arva_hil.config import Scenario
from arva_hil.emulator.build import ground_places, moving_transmitters
from arva_hil.emulator.datum import MOVE_DATUM, Datum
from arva_hil.emulator.setup import VehicleSetup
from arva_hil.emulator.true_state import SimulatorTruth, true_state
from arva_hil.events import DatumSet, Event, FollowedSystemHeard, FollowedSystemSilent, GroundFound, GroundMissing
from arva_hil.events.reasons import NoPose
from arva_hil.mavlink.codec import Packet, decode, dialect
from arva_hil.model.field import LocalFrame, Transmitters, rotation
from arva_hil.model.field.arrays import Array

_ANSWER_S: Final = 10.0  # without the autopilot's heights, emit an event after this time


class Snapshot(NamedTuple):
    """One vehicle among the transmitters, NED from its datum."""

    t: float
    """The instant, on the driver's clock [s]."""
    boot_s: float | None
    """The same instant on the vehicle's clock; None before its first message."""
    pose: VehicleState | None
    """The true state; None if it is unknown or too old."""
    reported: VehicleState | None
    """The state that the vehicle reports; the same object as `pose` if the report counts as true."""
    age_s: float | None
    """The age of the newest true state, also of one that is too old."""
    transmitters: Transmitters
    """The transmitters at this instant."""
    load: float
    """The load of the vehicle's motors, 0…1."""
    lacking: NoPose | None
    """The reason why there is no pose; None if there is one."""


_SILENT_S: Final = 2.0  # without a pose
_POSITION: Final = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
_POSES: Final = frozenset({_POSITION, dialect.MAVLINK_MSG_ID_ATTITUDE, dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION})


class FollowedSystem:
    """Remembers the pose of one system, from the messages of the first component that sent a position."""

    def __init__(self, system: int, start: float) -> None:
        self.system = system
        self._navigation = Navigation(lambda *event: None)
        self._component: int | None = None
        self._newest: float | None = None  # pose, on its own clock
        self._heard_at = start
        self._silent = False
        self._was_heard = False

    def on_packets(self, packets: Sequence[Packet], now: float) -> None:
        """Use the system's packets of a chunk."""
        for packet in packets:
            if packet.system != self.system or packet.msgid not in _POSES or packet.refused:
                continue
            if (message := decode(packet)) is None:
                continue
            if self._component is None and packet.msgid == _POSITION:
                self._component = packet.component
            if packet.component == self._component:
                self._on_pose(message, now)

    def pose(self, t: float, frame: LocalFrame) -> tuple[Array, Array] | None:
        """Return position (3,) NED in `frame` [m] and body → NED (3, 3) at `t`; None if it is silent."""
        state = self._navigation.state_at(t, frame)
        if state is None or state.age_s > _SILENT_S:
            return None
        return state.position, rotation.to_matrix(state.attitude)

    def is_known(self, t: float) -> bool:
        """Return True if no later message can change its pose at `t`."""
        return self._navigation.is_known(t)

    def check(self, now: float) -> list[Event]:
        """Return an event if it has become silent, or sends again."""
        silent = now - self._heard_at > _SILENT_S
        if silent == self._silent:
            return []
        self._silent = silent
        back = FollowedSystemHeard(now, self.system)
        return [FollowedSystemSilent(now, self.system, self._was_heard) if silent else back]

    def _on_pose(self, message: object, now: float) -> None:
        self._navigation.on_message(message, now)
        newest = self._navigation.track.newest
        if newest is not None and newest != self._newest:
            self._heard_at, self._was_heard = now, True
        self._newest = newest


class PlacedTransmitters:
    """Remembers the transmitters in `present`. Those below a ground that is not known are silent.

    With `terrain: autopilot` the heights of the ground are requested. `vehicle`: its name for events.
    """

    def __init__(self, vehicle: str, scenario: Scenario, session: Session) -> None:
        self.present = moving_transmitters(scenario, LocalFrame(0.0, 0.0, 0.0))  # until the datum is known
        self._vehicle = vehicle
        self._scenario = scenario
        self._requests = TerrainRequests(session) if scenario.terrain == "autopilot" else None
        self._frame: LocalFrame | None = None
        self._missing_since: float | None = None
        self._reported = False  # that heights are missing, for this datum

    def place(self, frame: LocalFrame) -> None:
        """Move to a new datum, the origin of `frame`."""
        self._frame, self._missing_since, self._reported = frame, None, False
        if self._requests:
            self._requests.request(ground_places(self._scenario, frame))
        self._build(frame)

    def observe(self, received: Received, now: float) -> list[Event]:
        """Use the heights in the packets that the session received."""
        if not self._requests or not self._requests.on_packets(received) or not self._frame:
            return []
        self._build(self._frame)
        return [GroundFound(now, self._vehicle)]

    def poll(self, now: float) -> tuple[bytes, Sequence[Event]]:
        """Return the requests to the autopilot to send now; an event if heights are missing.

        Called only while there are `present.unplaced`.
        """
        if self._frame is None:
            return b"", ()
        if self._missing_since is None:
            self._missing_since = now
        events: list[Event] = []
        if not self._reported and now - self._missing_since >= (_ANSWER_S if self._requests else 0.0):
            self._reported = True
            terrain = getattr(self._scenario.terrain, "source", "autopilot")
            events.append(GroundMissing(now, self._vehicle, sorted(self.present.unplaced), terrain))
        return self._requests.poll(now) if self._requests else b"", events

    def _build(self, frame: LocalFrame) -> None:
        heights = self._requests.heights if self._requests else None
        self.present = moving_transmitters(self._scenario, frame, heights)


class VehicleWorld:
    """Remembers one vehicle's datum, its true state, its motors' load, and the transmitters around it.

    `followed`: the systems that transmitters follow. `max_age_s`: an older pose is not used. `start`: of the run.
    """

    def __init__(
        self, setup: VehicleSetup, followed: Mapping[int, FollowedSystem], *, start: float, max_age_s: float
    ) -> None:
        scenario, session = setup.scenario, setup.session
        self.datum = Datum(scenario, start)
        self._name = setup.name
        self._session = session
        self._truth = true_state(scenario, session, start)
        self._motors = _motors(setup)
        self._transmitters = PlacedTransmitters(setup.name, scenario, session)
        parts: list[SimulatorTruth | MotorLoad | PlacedTransmitters | None] = [self._motors]
        if isinstance(self._truth, SimulatorTruth):
            parts.append(self._truth)
        if scenario.terrain == "autopilot":
            parts.append(self._transmitters)
        self._observing = [part for part in parts if part]
        self._followed = followed
        self._max_age_s = max_age_s
        self._start = start
        if self.datum.frame:
            self._transmitters.place(self.datum.frame)

    def update(self, received: Received, now: float) -> list[Event]:
        """Use what the session received at `now`."""
        events = [*received.events]
        for part in self._observing:
            events += part.observe(received, now)
        moves = MOVE_DATUM & {packet.msgid for packet in received.own}
        if moves and self.datum.update(self._session, now):
            assert self.datum.frame is not None
            self._transmitters.place(self.datum.frame)
            change = self.datum.changes[-1]
            events.append(DatumSet(now, self._name, *change.lat_lon_alt, change.why))
        return events

    def at(self, t: float) -> Snapshot:
        """Return the vehicle and the transmitters at `t`."""
        session, frame = self._session, self.datum.frame
        boot_s = session.navigation.clock.boot(t)
        pose = reported = None
        if frame is not None:
            reported = session.navigation.track.at(boot_s, frame)
            pose = self._truth.at(t, frame, reported) if self._truth else reported
        age_s = pose.age_s if pose else None
        if pose and pose.age_s > self._max_age_s:
            pose = None
        if reported and reported.age_s > self._max_age_s:
            reported = None
        carriers = {}
        for system in self._transmitters.present.systems:
            if frame is not None and (carrier := self._followed[system].pose(t, frame)):
                carriers[system] = carrier
        there = self._transmitters.present.at(t - self._start, carriers)
        load = self._motors.load if self._motors else 0.0
        return Snapshot(t, boot_s, pose, reported, age_s, there, load, None if pose else self._lacking())

    def is_known(self, t: float) -> bool:
        """Return True if no later message can change the snapshot at `t`."""
        navigation = self._session.navigation
        known = self._truth.known_at(t) if self._truth else navigation.is_known(t)
        return known and all(system.is_known(t) for system in self._followed.values())

    def poll(self, now: float) -> tuple[bytes, Sequence[Event]]:
        """Return the messages to the autopilot to send now, and the events."""
        data, events = self._session.poll(now)
        if not self._transmitters.present.unplaced:
            return data, events
        requests, more = self._transmitters.poll(now)
        return data + requests, [*events, *more]

    def _lacking(self) -> NoPose:
        if self.datum.frame is None and self._session.navigation.track.newest is not None:
            return NoPose("no home")
        lacking = self._truth.lacking() if isinstance(self._truth, SimulatorTruth) else None
        return lacking or self._session.why_no_pose()


def _motors(setup: VehicleSetup) -> MotorLoad | None:
    """Return the load of the motors; None if no receiver needs it."""
    noises = [noise for receiver in setup.receivers if (noise := receiver.scenario.receiver.vehicle_noise)]
    full_a = next((noise.full_current_a for noise in noises if noise.full_current_a), None)
    return MotorLoad(setup.name, setup.session, full_a) if noises else None
