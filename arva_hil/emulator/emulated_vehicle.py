"""One vehicle of the engine with its receivers; systems that transmitters follow; links that vehicles share."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import Final

from arva_hil.config import Scenario
from arva_hil.emulator.datum import MOVE_DATUM, Datum
from arva_hil.emulator.frame_source import FrameSource, ReceiverSetup
from arva_hil.emulator.placed_transmitters import PlacedTransmitters
from arva_hil.emulator.true_state import true_state
from arva_hil.emulator.virtual_receiver import Run
from arva_hil.events import DatumSet, Event, FollowedSystemHeard, FollowedSystemSilent, VehicleStatus
from arva_hil.field import LocalFrame, rotation
from arva_hil.field.arrays import Array
from arva_hil.frozen import Frozen
from arva_hil.mavlink.codec import Packet, Parser, dialect
from arva_hil.mavlink.packet_reader import Packets
from arva_hil.registry import MAVLINK_FORMATS
from arva_hil.vehicle.motor_load import MotorLoad
from arva_hil.vehicle.navigation import EventQueue, Navigation
from arva_hil.vehicle.pose_track import ClockMap, VehicleState
from arva_hil.vehicle.reasons import NoPose
from arva_hil.vehicle.session import Session

_SILENT_S: Final = 2.0  # without a pose
_POSITION: Final = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
_POSES: Final = frozenset({_POSITION, dialect.MAVLINK_MSG_ID_ATTITUDE, dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION})


class FollowedSystem:
    """Remembers the pose of one system, from the messages of the first component that sent a position."""

    def __init__(self, system: int, start: float) -> None:
        self.system = system
        self._navigation = Navigation(EventQueue())
        self._parser = Parser()
        self._component: int | None = None
        self._newest: float | None = None  # pose, on its own clock
        self._heard_at = start
        self._silent = False
        self._was_heard = False

    @property
    def clock(self) -> ClockMap:
        """Its boot time."""
        return self._navigation.clock

    def hear(self, packet: Packet, now: float) -> None:
        """Use one of its packets."""
        if packet.msgid not in _POSES or (message := self._parser.decode(packet)) is None:
            return
        if self._component is None and packet.msgid == _POSITION:
            self._component = packet.component
        if packet.component != self._component:
            return
        self._navigation.hear(message, now)
        newest = self._navigation.track.newest
        if newest is not None and newest != self._newest:
            self._heard_at, self._was_heard = now, True
        self._newest = newest

    def pose(self, t: float, frame: LocalFrame) -> tuple[Array, Array] | None:
        """Position (3,) NED in `frame` [m] and body → NED (3, 3) at `t`; None if it is not heard."""
        state = self._navigation.track.at(self.clock.boot(t), frame)
        if state is None or state.age_s > _SILENT_S:
            return None
        return state.position, rotation.to_matrix(state.attitude)

    def known_at(self, t: float) -> bool:
        """Whether no later message can change its pose at `t`."""
        return self._navigation.track.is_known(self.clock.boot(t))

    def look(self, now: float) -> Event | None:
        """The event if it is not heard any more or is heard again, otherwise None."""
        silent = now - self._heard_at > _SILENT_S
        if silent == self._silent:
            return None
        self._silent = silent
        back = FollowedSystemHeard(now, self.system)
        return FollowedSystemSilent(now, self.system, self._was_heard) if silent else back


class VehicleSetup(Frozen):
    """One vehicle with its receivers. `link`: the link on which it is heard; `session`: follows it there."""

    name: str
    link: str
    session: Session
    scenario: Scenario
    receivers: Sequence[ReceiverSetup]


def one_vehicle(scenario: Scenario, session: Session, *, link: str = "autopilot", sink: str = "port") -> VehicleSetup:
    """One vehicle with one receiver, for a scenario without `vehicles`. Formats inside MAVLink do not use `sink`."""
    sink = link if scenario.output_format in MAVLINK_FORMATS else sink
    return VehicleSetup("vehicle", link, session, scenario, [ReceiverSetup("receiver", sink, scenario)])


class EmulatedVehicle:
    """Remembers one vehicle's datum and receivers. Its session remembers the rest."""

    def __init__(self, setup: VehicleSetup, followed: Mapping[int, FollowedSystem], run: Run, phase: float) -> None:
        self.name = setup.session.news.name = setup.name
        self.link = setup.link
        self.session = setup.session
        self.datum = Datum(setup.scenario, run.start)
        self.true_state = true_state(setup.scenario, setup.session, run.start)
        self.sources = [FrameSource(self.name, one, setup.session, run, phase) for one in setup.receivers]
        self.told_missing = False
        noises = [noise for receiver in setup.receivers if (noise := receiver.scenario.receiver.vehicle_noise)]
        full_a = next((noise.full_current_a for noise in noises if noise.full_current_a), None)
        self._motors = MotorLoad(setup.session, full_a) if noises else None
        self.reads_more = bool(noises) or setup.scenario.terrain == "autopilot" or setup.scenario.pose == "truth"
        self._events = run.events
        self._followed = followed
        receivers = [source.receiver for source in self.sources]
        self._transmitters = PlacedTransmitters(setup.scenario, setup.session, receivers)
        if self.datum.frame:
            self._transmitters.place(self.datum.frame)

    @property
    def known(self) -> bool:
        """Whether the vehicle was found."""
        return self.session.vehicle is not None

    @property
    def next_due(self) -> float:
        """The time at which there is something to do [s]."""
        return min([self.session.next_due, *[source.next_due for source in self.sources]])

    def hear(self, now: float) -> None:
        """The session has been fed."""
        if self.reads_more:
            self.true_state.hear(now)
            if self._motors:
                self._motors.hear(now)
            self._transmitters.hear(now)
        for packet in self.session.own:
            if packet.msgid in MOVE_DATUM:
                if self.datum.update(self.session, now):
                    assert self.datum.frame is not None
                    self._transmitters.place(self.datum.frame)
                    change = self.datum.changes[-1]
                    self._events.append(DatumSet(now, self.name, *change.lat_lon_alt, change.why))
                break

    def poll(self, now: float) -> bytes:
        """The requests to the vehicle to send now."""
        return self.session.poll(now) + self._transmitters.poll(now)

    def load(self) -> float:
        """The load of its motors now, 0…1."""
        return self._motors.load if self._motors else 0.0

    def states(self, t: float) -> tuple[VehicleState | None, VehicleState | None]:
        """The true and the reported state at `t`, NED from the datum; None: not known.

        Both are the same object if the report counts as the truth.
        """
        if (frame := self.datum.frame) is None:
            return None, None
        reported = self.session.state_at(t, frame)
        return self.true_state.at(t, frame, reported), reported

    def pose_of(self, system: int, t: float) -> tuple[Array, Array] | None:
        """Position (3,) NED from the datum [m] and body → NED (3, 3) of another vehicle; None: it is not heard."""
        return self._followed[system].pose(t, self.datum.frame) if self.datum.frame else None

    def lacking(self) -> NoPose:
        """Why there is no pose."""
        if self.datum.frame is None and self.session.track.newest is not None:
            return NoPose("no home")
        return self.true_state.lacking() or self.session.why_no_pose()

    def status(self, now: float) -> VehicleStatus:
        session, receivers = self.session, [source.status() for source in self.sources]
        label = session.vehicle.short if session.vehicle else ""
        return VehicleStatus(self.name, label, session.rates(now), receivers, tuple(session.counts().items()))


class SharedLink:
    """Remembers the vehicles on one link. `senders`: all that may be one of them, to which outputs go."""

    def __init__(self, vehicles: Sequence[EmulatedVehicle]) -> None:
        self.senders: Sequence[Hashable] = ()
        self._vehicles = vehicles
        self._numbers = {vehicle.session.target_system: number for number, vehicle in enumerate(vehicles)}
        self._of_each: list[tuple[Hashable, ...]] = [()] * len(vehicles)

    def hear(
        self, packets: Packets, now: float, sender: Hashable
    ) -> tuple[Sequence[EmulatedVehicle], Sequence[Packet]]:
        """Give each vehicle its own packets, and all vehicles the packets of other systems.

        Returns the vehicles that got packets; and all packets, if they may come from one of these vehicles.
        """
        systems = {packet.system for packet in packets.every}
        numbers: Sequence[int] = range(len(self._vehicles))
        if systems <= self._numbers.keys():
            numbers = sorted(self._numbers[system] for system in systems)
        vehicles = [self._vehicles[number] for number in numbers]
        heard = False
        shares = packets.shares([vehicle.session.target_system for vehicle in vehicles])
        for number, vehicle, share in zip(numbers, vehicles, shares, strict=True):
            heard |= vehicle.session.hear(share, now, sender) and bool(share.every)
            self._note_senders(number, vehicle)
        return vehicles, packets.every if heard else []

    def _note_senders(self, number: int, vehicle: EmulatedVehicle) -> None:
        senders = vehicle.session.senders
        known = (senders.vehicle, *senders.candidates)
        if known != self._of_each[number]:
            self._of_each[number] = known
            self.senders = [one for one in dict.fromkeys(one for of in self._of_each for one in of) if one is not None]
