"""The emulator: bytes and time in; bytes, deadlines and events out. It opens no link, does not wait, prints nothing.

Any number of vehicles on any number of links, each with any number of receivers. A driver calls

    receive(link, data, now)    bytes from a link; link_lost and link_back for its state
    advance(now)                does everything that is due until now
    output()                    what to write; the driver then calls `written` for each
    events()                    what has happened
    next_deadline()             when to call `advance` again

like h11 and aioquic. `arva_hil.runtime.drivers` has three of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from typing import Final

from arva_hil.config import ReceiverConfig, Scenario, VehicleConfig
from arva_hil.emulator.agenda import Agenda
from arva_hil.emulator.emulated_vehicle import EmulatedVehicle, FollowedSystem, SharedLink, VehicleSetup
from arva_hil.emulator.frame_source import Output, ReceiverSetup
from arva_hil.emulator.host_commands import HostCommands
from arva_hil.emulator.virtual_receiver import Run
from arva_hil.events import Event, HeartbeatMissing, PacketsReceived, StatusReport
from arva_hil.mavlink.codec import Packet
from arva_hil.mavlink.packet_reader import PacketReader
from arva_hil.vehicle.session import Session

_STATUS_S: Final = 0.25
_SLACK_S: Final = 0.1  # a status waits so long for something else that is due


class Emulator:
    """Remembers its vehicles, the outputs and the events. Times are seconds on the driver's clock.

    `start`: the instant of the first frames. `spread`: those of the vehicles are spread over a period, 0.1 s at most.
    `timeout_s`: without a heartbeat, until there is an event. `max_age_s`: an older pose is not used. `look_ahead_s`:
    how long a frame waits for a pose after its instant, so that its pose can be interpolated; 0 for live: a frame is
    made at its instant, with what is known then. `tell_packets`: make an event for every chunk, for a record;
    `tell_status`: make a `StatusReport` four times a second.
    """

    def __init__(
        self,
        vehicles: Sequence[VehicleSetup],
        *,
        start: float,
        timeout_s: float = math.inf,
        max_age_s: float = 2.0,
        look_ahead_s: float = 0.0,
        spread: bool = False,
        tell_packets: bool = False,
        tell_status: bool = True,
    ) -> None:
        run = Run(start, max_age_s)
        self._outputs, self._events = run.outputs, run.events
        scenarios = [receiver.scenario for setup in vehicles for receiver in setup.receivers]
        followed = (t.follows.system for scenario in scenarios for t in scenario.transmitters if t.follows)
        self._followed = {system: FollowedSystem(system, start) for system in followed}
        between = 1 / len(vehicles) if spread and vehicles else 0.0
        self.vehicles = [EmulatedVehicle(one, self._followed, run, n * between) for n, one in enumerate(vehicles)]
        self._on_link: dict[str, list[EmulatedVehicle]] = {}
        for vehicle in self.vehicles:
            self._on_link.setdefault(vehicle.link, []).append(vehicle)
        if any(len({id(vehicle.session.reader) for vehicle in every}) > 1 for every in self._on_link.values()):
            raise ValueError("the sessions of vehicles on one link need the same reader")
        self._shared = {link: SharedLink(every) for link, every in self._on_link.items() if len(every) > 1}
        self._hosts: dict[str, list[tuple[EmulatedVehicle, HostCommands]]] = {}
        for vehicle in self.vehicles:
            for source in vehicle.sources:
                if source.commands:
                    self._hosts.setdefault(source.sink, []).append((vehicle, source.commands))
        self._agenda = Agenda(self.vehicles)
        self._start = start
        self._timeout_s = timeout_s
        self._look_ahead_s = look_ahead_s
        self._tell_packets = tell_packets
        # whether the time of each packet counts, also behind the first ones
        self.needs_times = tell_packets or any(setup.scenario.pose == "truth" for setup in vehicles)
        self._tell_status = tell_status
        self._next_status = start
        self._status_at: float | None = None  # one is to be made, after the outputs are written
        self._lost: set[str] = set()
        self._told: PacketsReceived | None = None  # the newest
        self._later: list[tuple[float, Sequence[Packet]]] = []  # chunks behind the newest that was told

    def receive(self, link: str, data: bytes, now: float, sender: Hashable = None, *, whole: bool = False) -> None:
        """Use bytes that were received at `now` from an autopilot's link or from a receiver's port.

        `sender`: one of several on the link. `whole`: no packet continues in the next bytes.
        """
        vehicles: Sequence[EmulatedVehicle] | None = self._on_link.get(link)
        if vehicles is None:
            for vehicle, commands in self._hosts.get(link, ()):
                commands.receive(data, now)
                self._agenda.called.add(vehicle)
            return
        if not self._followed and len(vehicles) == 1:
            packets: Sequence[Packet] = vehicles[0].session.feed(data, now, sender, whole=whole)
        else:
            read = vehicles[0].session.reader.read(data, now, sender, whole=whole)
            for packet in read.believed if self._followed else ():
                if (followed := self._followed.get(packet.system)) is not None:
                    followed.hear(packet, now)
            if link in self._shared:
                vehicles, packets = self._shared[link].hear(read, now, sender)
            else:
                packets = read.every if vehicles[0].session.hear(read, now, sender) else []
        if self._tell_packets:
            self._tell(link, packets, now)
        for vehicle in vehicles:
            self._agenda.called.add(vehicle)
            vehicle.hear(now)

    def receive_records(self, link: str, records: Sequence[tuple[float, bytes]]) -> None:
        """As `receive` for each record of a log, its time and one whole packet. Packets that nobody uses are only told.

        There must be no deadline between the records.
        """
        vehicle, *others = self._on_link[link]
        session = vehicle.session
        if others or self._followed or vehicle.reads_more or session.reader.signing:
            for now, data in records:
                self.receive(link, data, now, whole=True)
            return
        every = session.reader.read_records([data for _, data in records])
        for (now, _), packets in zip(records, every, strict=True):
            used = session.hear_record(packets, now)
            if self._tell_packets:
                self._tell(link, packets, now)
            if used:
                vehicle.hear(now)
        self._agenda.called.add(vehicle)

    def _tell(self, link: str, packets: Sequence[Packet], now: float) -> None:
        if self._told and self._events and self._events[-1] is self._told and link == self._told.link:
            self._later.append((now, packets))
        else:
            self._later = []
            self._told = PacketsReceived(now, link, packets, self._later)
            self._events.append(self._told)

    def link_lost(self, link: str, why: str, now: float) -> None:
        """A link is lost: until `link_back` nothing can be sent there, and silence does not count."""
        self._lost.add(link)
        for vehicle in self._on_link.get(link, ()):
            vehicle.session.interrupt(why)
            self._agenda.called.add(vehicle)

    def link_back(self, link: str, now: float) -> None:
        """The link is back. Its vehicles may have rebooted."""
        self._lost.discard(link)
        for vehicle in self._on_link.get(link, ()):
            vehicle.session.resume(now)
            self._agenda.called.add(vehicle)

    def advance(self, now: float) -> None:
        """Do what is due until `now`."""
        due = self._agenda.due(now)
        for vehicle in due:  # frames first: they are urgent
            self._make_frames(vehicle, now)
        for vehicle in due:
            self._answer(vehicle, now)
            self._agenda.served(vehicle)
        if now >= self._next_status:
            self._next_status = max(self._next_status + _STATUS_S, now)
            self._status_at = now

    def finish(self, now: float) -> None:
        """Nothing more will come: make the frames that waited for it, and send what faults have delayed."""
        self.advance(now)
        for vehicle in self.vehicles:
            self._make_frames(vehicle, now, last=True)
            self._tell_missing(vehicle, now)

    def next_deadline(self) -> float:
        """The latest time for the next call of `advance`."""
        return min(self._next_status + _SLACK_S, self._agenda.first())

    def output(self) -> list[Output]:
        """The outputs to write, in this order. Call `written` for each of them."""
        if outputs := self._outputs[:]:
            self._outputs.clear()
        return outputs

    def clock_samples(self) -> list[int]:
        """How many samples each map of a vehicle's clock has taken."""
        clocks = [vehicle.session.clock for vehicle in self.vehicles]
        clocks += [followed.clock for followed in self._followed.values()]
        return [clock.taken for clock in clocks]

    def addressees(self, link: str) -> tuple[Hashable, Sequence[Hashable]]:
        """The receivers of outputs on a link: the vehicle's sender; or, if it is None, these senders."""
        if link in self._shared:
            return None, self._shared[link].senders
        senders = self._on_link[link][0].session.senders
        return senders.vehicle, senders.candidates

    def written(self, output: Output, taken: bool, now: float) -> None:
        """An output was written. `taken`: the link has accepted all of it."""
        if output.source is not None:
            output.source.written(output, taken, now, lost=output.sink in self._lost)

    def events(self) -> list[Event]:
        """The events since the last call, in their order."""
        if (now := self._status_at) is not None:
            self._status_at = None
            self._events += [event for followed in self._followed.values() if (event := followed.look(now))]
            if self._tell_status:
                self._events.append(StatusReport(now, [vehicle.status(now) for vehicle in self.vehicles]))
        if events := self._events[:]:
            self._events.clear()
        return events

    def _make_frames(self, vehicle: EmulatedVehicle, now: float, *, last: bool = False) -> None:
        for source in vehicle.sources:
            if source.next_due <= now:
                ready = self._ready(vehicle, math.inf if last else now) if self._look_ahead_s else None
                source.advance(now, vehicle, ready)  # the last frames do not wait
            source.obey(now)

    def _ready(self, vehicle: EmulatedVehicle, now: float) -> Callable[[float], bool]:
        known = [vehicle.true_state.known_at, *(followed.known_at for followed in self._followed.values())]
        return lambda t: now - t >= self._look_ahead_s or all(known_at(t) for known_at in known)

    def _answer(self, vehicle: EmulatedVehicle, now: float) -> None:
        if out := vehicle.poll(now):
            self._outputs.append(Output(vehicle.link, out, now))
        self._events += vehicle.session.take_events()
        if now - self._start > self._timeout_s and not vehicle.known and not vehicle.told_missing:
            for one in self._on_link[vehicle.link]:  # all at the same time, for a reader
                self._tell_missing(one, now)

    def _tell_missing(self, vehicle: EmulatedVehicle, now: float) -> None:
        if not vehicle.known and not vehicle.told_missing:
            vehicle.told_missing = True
            self._events.append(HeartbeatMissing(now, vehicle.name, vehicle.session.heard()))


def scenario_of(scenario: Scenario, receiver: ReceiverConfig) -> Scenario:
    """The scenario of one of its receivers: with its mount, rate, format and seed, and without vehicles."""
    return replace(
        scenario, receiver=receiver.receiver, output_format=receiver.output_format, seed=receiver.seed, vehicles=()
    )


def receivers_of(scenario: Scenario) -> list[tuple[str, str]]:
    """The names of all receivers: (vehicle, receiver)."""
    return [(vehicle.name, receiver.name) for vehicle in scenario.vehicles for receiver in vehicle.receivers]


def sink_name(vehicle: VehicleConfig, receiver: ReceiverConfig) -> str:
    """The engine's name of a receiver's port."""
    return f"{vehicle.name}/{receiver.name}"


def vehicle_setups(
    scenario: Scenario, link_of: Callable[[VehicleConfig], str], session_of: Callable[[VehicleConfig], Session]
) -> list[VehicleSetup]:
    """The setups of the vehicles of a scenario with `vehicles`.

    `link_of`: gives the engine's name of a vehicle's link; `session_of`: its session. Sessions on one link need the
    same reader. Frames of a receiver without a port are sent over the vehicle's link.
    """
    setups = []
    for vehicle in scenario.vehicles:
        link = link_of(vehicle)
        receivers = [
            ReceiverSetup(one.name, sink_name(vehicle, one) if one.port else link, scenario_of(scenario, one))
            for one in vehicle.receivers
        ]
        setups.append(VehicleSetup(vehicle.name, link, session_of(vehicle), scenario, receivers))
    return setups


def check_systems(source: str, link: str, vehicles: Sequence[VehicleConfig]) -> None:
    """Check that vehicles on one link can be told apart. Raises ValueError."""
    systems = [vehicle.system for vehicle in vehicles]
    if len(vehicles) > 1 and (None in systems or len(set(systems)) < len(systems)):
        names = ", ".join(vehicle.name for vehicle in vehicles)
        raise ValueError(f"{source}: {names} are all on {link}: give each its own `system`")


def recorded_vehicles(
    scenario: Scenario, log: str, link: str, *, target_component: int | None = None
) -> list[VehicleSetup]:
    """The setups for a replay of one log with all vehicles of a scenario. They differ by their system ids.

    `log`: its name for a person; `link`: the engine's name. Raises ValueError if vehicles have the same system id.
    """
    check_systems(scenario.source, log, scenario.vehicles)
    reader = PacketReader()

    def session(vehicle: VehicleConfig) -> Session:
        return Session(target_system=vehicle.system, target_component=target_component, passive=True, reader=reader)

    return vehicle_setups(scenario, lambda _: link, session)
