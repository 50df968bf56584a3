"""The emulator: bytes and time in; bytes, deadlines and events out. It opens no link, does not wait, prints nothing.

Serves many vehicles on many links, each with many receivers. A driver calls

    receive(link, data, now)     bytes that came on a link
    advance(now)                 do everything that is due until now
    output()                     the bytes to write; `written` for each of them, when it is written
    events()                     the events since the last call
    next_deadline()              the time of the next call of `advance`

and `link_lost` and `link_back` for the state of a link, as with h11 and aioquic. `arva_hil.runtime.drivers` has three
drivers.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Final, NamedTuple

from arva_hil.emulator import build
from arva_hil.emulator.ports import HostCommands, Output, Parcel, Port, encoder
from arva_hil.emulator.receivers import EmulatedReceiver
from arva_hil.emulator.setup import ReceiverSetup, VehicleSetup
from arva_hil.emulator.true_state import latency_s
from arva_hil.emulator.world import FollowedSystem, Snapshot, VehicleWorld
from arva_hil.events import (
    Event,
    FrameMade,
    HeartbeatMissing,
    PacketsReceived,
    ReceiverStatus,
    StatusReport,
    VehicleStatus,
)
from arva_hil.mavlink.codec import Packet
from arva_hil.registry import FORMATS

_STATUS_S: Final = 0.25
_SLACK_S: Final = 0.1  # a status report may be this late, to share a wake-up
_SPREAD_S: Final = 0.1  # the first frames of several vehicles wait no longer than this


class Unit(NamedTuple):
    """A receiver with its port."""

    receiver: EmulatedReceiver
    port: Port


class EmulatedVehicle:
    """Remembers one vehicle's session, world and receivers. `next_due`: the time of the next work.

    `phase`: of its frames, in periods, or tenths of a second, after the start of the run.
    """

    def __init__(
        self,
        setup: VehicleSetup,
        followed: Mapping[int, FollowedSystem],
        *,
        start: float,
        max_age_s: float,
        phase: float,
        missing_from: float,
    ) -> None:
        self.name = setup.name
        self.link = setup.link
        self.session = setup.session
        self.world = VehicleWorld(setup, followed, start=start, max_age_s=max_age_s)
        self.units = [make_unit(setup, one, start, phase) for one in setup.receivers]
        self.next_due = start
        self.missing_from: float | None = missing_from  # None: the vehicle was found, or reported as missing

    def receive(self, packets: Sequence[Packet], now: float, sender: Hashable) -> Sequence[Event]:
        """Use the packets of one chunk on its link."""
        received = self.session.receive(packets, now, sender)
        self.next_due = min(self.next_due, max(self.session.next_due, now))
        return self.world.update(received, now)

    def receive_commands(self, link: str, data: bytes, now: float) -> None:
        """Use bytes of the host on the port of a receiver. They are answered at the next call."""
        for _, port in self.units:
            if port.link == link and port.commands:
                port.commands.receive(data, now)
                self.next_due = now

    def make_frames(
        self, now: float, look_ahead_s: float, *, final: bool = False
    ) -> tuple[Sequence[tuple[Port, Parcel]], Sequence[Event]]:
        """Make the frames of the instants until `now` whose poses are known, and send delayed frames that are due.

        `look_ahead_s`: a frame waits at most this long for its pose, 0 for a live run; `final`: it waits no longer.
        """
        parcels: list[tuple[Port, Parcel]] = []
        events: list[Event] = []
        seen: Snapshot | None = None
        for receiver, port in self.units:
            sent: list[Parcel] = []
            while (t := receiver.next_due) <= now and (final or now - t >= look_ahead_s or self.world.is_known(t)):
                if seen is None or seen.t != t:  # several receivers take a sample at once
                    seen = self.world.at(t)
                for event in receiver.advance(seen, t if look_ahead_s else now):
                    if isinstance(event, FrameMade):
                        events += self.world.datum.check_distance(event)
                        bytes_, more = port.send(event, t)
                        sent += bytes_
                        events += more
                    else:
                        events.append(event)
            waited, received = port.release(now, receiver.schedule.deadline)
            parcels += zip(repeat(port), [*sent, *waited])
            events += received
        return parcels, events

    def poll(self, now: float) -> tuple[bytes, Sequence[Event]]:
        """Return the messages to the autopilot to send now, and the events. Sets `next_due`."""
        polled = self.world.poll(now)
        due = self.session.next_due
        for receiver, port in self.units:
            due = min(due, receiver.next_due, port.next_due)
        self.next_due = due
        return polled

    def check_missing(self, now: float) -> Sequence[Event]:
        """Return an event if the vehicle is not found. Called once, at `missing_from` or at the end."""
        self.missing_from = None
        return [] if self.session.vehicle else [HeartbeatMissing(now, self.name, self.session.why_no_vehicle())]

    def status(self, now: float) -> VehicleStatus:
        """Return the status of the vehicle and its receivers."""
        receivers = []
        for receiver, port in self.units:
            c = port.counters
            count = c.delivered + c.damaged + c.dropped
            receivers.append(ReceiverStatus(port.name, port.last, count, c.dropped, receiver.seen.transmitters))
        session, found = self.session, self.session.vehicle
        label, source = (found.short, (self.link, found.system)) if found else ("", None)
        return VehicleStatus(self.name, label, session.rates(now), receivers, tuple(session.counts().items()), source)


def make_unit(vehicle: VehicleSetup, setup: ReceiverSetup, start: float, phase: float = 0.0) -> Unit:
    """Make a receiver of a vehicle. `phase`: see `EmulatedVehicle`."""
    about, scenario = (vehicle.name, setup.name), setup.scenario
    model, faults = build.receiver(scenario), None
    if scenario.faults or setup.faults_change:
        from arva_hil.emulator.faults.plan import Faults  # slow to import, and most runs have none

        faults = Faults(scenario, model)
        model = faults.receiver
    first = start + phase * min(1 / scenario.receiver.rate_hz, _SPREAD_S)
    made = EmulatedReceiver(*about, scenario, model, start=start, first=first)
    host = getattr(FORMATS[scenario.output_format], "host", None)
    commands = HostCommands(*about, scenario, host, made.command) if host else None
    encode = encoder(scenario.output_format, vehicle.session)
    return Unit(made, Port(*about, setup.sink, encode, faults, commands))


class Addressees(NamedTuple):
    """The senders to which a link writes."""

    peer: Hashable
    """The sender of the link's only vehicle; None if it is not known, or if there are several vehicles."""
    others: Sequence[Hashable]
    """The senders to which the link writes without a peer: all that may be one of the vehicles."""


NOBODY: Final = Addressees(None, ())


@dataclass(frozen=True)
class EngineOptions:
    """The options of an `Emulator`, which explains them."""

    look_ahead_s: float
    tell_packets: bool
    tell_status: bool
    needs_times: bool
    """Use packets at their arrival times: for a record, and for a simulator's truth, which has no clock."""


class _VehicleLink:
    """Remembers the vehicles on one link. Raises ValueError if the readers of their sessions differ.

    `open_to_all`: packets count also if their sender cannot be one of the vehicles.
    """

    def __init__(self, vehicles: Sequence[EmulatedVehicle], *, open_to_all: bool) -> None:
        self.vehicles = vehicles
        self._sessions = [vehicle.session for vehicle in vehicles]
        if len({id(session.reader) for session in self._sessions}) > 1:
            raise ValueError("the sessions of vehicles on one link need the same reader")
        self._reader = self._sessions[0].reader
        self._open_to_all = open_to_all
        targets = {session.target_system for session in self._sessions}
        self._shares = [(vehicle, targets - {vehicle.session.target_system}) for vehicle in vehicles]

    def receive(self, data: bytes, now: float, sender: Hashable, *, whole: bool) -> tuple[list[Packet], list[Event]]:
        """Give each vehicle its own packets, and all vehicles the packets of other systems. Returns all packets."""
        events: list[Event] = []
        stranger = False
        if sender is not None:
            accepted = [session.accepts(sender, now) for session in self._sessions]
            stranger = not (self._open_to_all or any(accepted))
        packets = self._reader.feed(data, now, sender, stranger=stranger, whole=whole)
        for vehicle, siblings in self._shares:
            share = [packet for packet in packets if packet.system not in siblings] if siblings else packets
            if share:
                events += vehicle.receive(share, now, sender)
        return packets, events

    def follows(self, sender: Hashable) -> bool:
        """Return True if a sender may be one of the vehicles."""
        return any(session.follows(sender) for session in self._sessions)

    @property
    def addressees(self) -> Addressees:
        """The senders to which outputs go."""
        first, *others = (session.senders for session in self._sessions)
        if not others:
            return Addressees(first.vehicle, first.candidates)
        every = (sender for one in (first, *others) for sender in (one.vehicle, *one.candidates))
        return Addressees(None, [sender for sender in dict.fromkeys(every) if sender is not None])


class Emulator:
    """Remembers its vehicles, the outputs and the events. Times are seconds on the driver's clock.

    - `start`: the instant of the first frames. `spread`: spread those of several vehicles over a period, at most 0.1 s.
    - `timeout_s`: without a heartbeat, emit an event after this time.
    - `max_age_s`: an older pose is not used.
    - `look_ahead_s`: the time that a frame waits for a later pose, to interpolate its own, besides the scenario's
      latency; 0 for a live run.
    - `tell_packets`: emit an event for every chunk, for a record.
    - `tell_status`: emit a `StatusReport` four times a second.

    Raises ValueError without a vehicle, for an unknown link, and for a time before the last one.
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
        if not vehicles:
            raise ValueError("vehicles: none, expected one VehicleSetup at least, e.g. one_vehicle(scenario)")
        self._now = -math.inf  # of the last `advance`
        if look_ahead_s:  # the report of a frame's instant comes later
            look_ahead_s += max(latency_s(setup.scenario) for setup in vehicles)
        truth = any(setup.scenario.pose == "truth" for setup in vehicles)
        self.options = EngineOptions(look_ahead_s, tell_packets, tell_status, needs_times=tell_packets or truth)
        scenarios = [receiver.scenario for setup in vehicles for receiver in setup.receivers]
        followed = (t.follows.system for scenario in scenarios for t in scenario.transmitters if t.follows)
        self._followed = {system: FollowedSystem(system, start) for system in followed}
        between = 1 / len(vehicles) if spread else 0.0
        self.vehicles = [
            EmulatedVehicle(
                setup,
                self._followed,
                start=start,
                max_age_s=max_age_s,
                phase=n * between,
                missing_from=start + timeout_s,
            )
            for n, setup in enumerate(vehicles)
        ]
        on_link: dict[str, list[EmulatedVehicle]] = {}
        for vehicle in self.vehicles:
            on_link.setdefault(vehicle.link, []).append(vehicle)
        open_to_all = bool(self._followed)
        self._links = {link: _VehicleLink(every, open_to_all=open_to_all) for link, every in on_link.items()}
        self._lost: set[str] = set()
        self._outputs: list[Output] = []
        self._number = 0  # of the newest output
        self._unwritten: dict[int, tuple[EmulatedVehicle, Port, Parcel]] = {}
        self._events: list[Event] = []
        self._next_status = start

    def receive(
        self, link: str, data: bytes, now: float, sender: Hashable = None, *, whole: bool = False
    ) -> Addressees:
        """Use bytes received at `now` from an autopilot's link or a receiver's port.

        `sender`: one of several on the link. `whole`: no packet continues in the next bytes. Returns the senders to
        which the link writes from now on.
        """
        if (vehicles := self._links.get(link)) is None:
            self._check_port(link)
            for vehicle in self.vehicles:
                vehicle.receive_commands(link, data, now)
            return NOBODY
        packets, events = vehicles.receive(data, now, sender, whole=whole)
        for followed in self._followed.values():
            followed.on_packets(packets, now)
        if self.options.tell_packets:
            self._events.append(PacketsReceived(now, link, packets if vehicles.follows(sender) else ()))
        self._events += events
        return NOBODY if sender is None else vehicles.addressees

    def link_lost(self, link: str, why: str, now: float) -> None:
        """Handle a lost link: until `link_back` nothing can be sent there, and silence does not count."""
        self._lost.add(link)
        for vehicle in self._vehicles_on(link):
            vehicle.session.interrupt(why)

    def link_back(self, link: str, now: float) -> None:
        """Handle a link that is back. Its vehicles may have rebooted."""
        self._lost.discard(link)
        for vehicle in self._vehicles_on(link):
            vehicle.session.resume(now)
            vehicle.next_due = now

    def advance(self, now: float, *, final: bool = False) -> None:
        """Do all work due until `now`. `final`: no more bytes will come, so make the waiting frames."""
        if now < self._now:
            raise ValueError(f"now: {now:g}, expected {self._now:g} s or later: time does not go back")
        self._now = now
        for vehicle in self.vehicles:  # frames first: they are urgent
            if vehicle.next_due > now and not final:
                continue
            parcels, events = vehicle.make_frames(now, self.options.look_ahead_s, final=final)
            self._events += events
            for port, parcel in parcels:
                self._put(port.link, parcel.data, parcel.due, (vehicle, port, parcel))
        for vehicle in self.vehicles:
            if vehicle.next_due > now and not final:
                continue
            data, events = vehicle.poll(now)
            self._events += events
            if data:
                self._put(vehicle.link, data, now)
        for vehicle in self.vehicles:
            if vehicle.missing_from is not None and (now >= vehicle.missing_from or final):
                self._events += vehicle.check_missing(now)

    def next_deadline(self) -> float:
        """Return the latest time for the next call of `advance`."""
        return min([self._next_status + _SLACK_S, *[vehicle.next_due for vehicle in self.vehicles]])

    def output(self) -> list[Output]:
        """Return the outputs to write, in this order. Call `written` for each."""
        outputs, self._outputs = self._outputs, []
        return outputs

    def written(self, output: int, accepted: bool, now: float) -> None:
        """Handle a written output. `accepted`: the link has accepted all of it."""
        if (sent := self._unwritten.pop(output, None)) is not None:
            vehicle, port, parcel = sent
            quiet = port.link in self._lost or not (accepted or vehicle.session.vehicle)
            self._events += port.written(parcel, accepted, now, quiet=quiet)

    def events(self) -> list[Event]:
        """Return the events since the last call, in their order."""
        if (now := self._now) >= self._next_status:
            self._next_status = max(self._next_status + _STATUS_S, now)
            for followed in self._followed.values():
                self._events += followed.check(now)
            if self.options.tell_status:
                self._events.append(StatusReport(now, [vehicle.status(now) for vehicle in self.vehicles]))
        events, self._events = self._events, []
        return events

    def _vehicles_on(self, link: str) -> Sequence[EmulatedVehicle]:
        """Return the vehicles on a link; none on a receiver's port."""
        if link in self._links:
            return self._links[link].vehicles
        self._check_port(link)
        return ()

    def _check_port(self, link: str) -> None:
        """Raise ValueError if no receiver has this port."""
        ports = [port.link for vehicle in self.vehicles for _, port in vehicle.units]
        if link not in ports:
            raise ValueError(f"link: {link!r}, expected one of {', '.join(sorted({*self._links, *ports}))}")

    def _put(
        self, link: str, data: bytes, due: float, sent: tuple[EmulatedVehicle, Port, Parcel] | None = None
    ) -> None:
        """Add an output. `sent`: what to report when it is written."""
        self._number += 1
        self._outputs.append(Output(self._number, link, data, due))
        if sent is not None:
            self._unwritten[self._number] = sent
