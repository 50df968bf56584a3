"""One vehicle of the engine: its session, its world, its receivers with their ports."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from itertools import repeat
from typing import Final, NamedTuple

from arva_hil.emulator import build
from arva_hil.emulator.host_commands import HostCommands
from arva_hil.emulator.ports import Parcel, Port, encoder
from arva_hil.emulator.receivers import EmulatedReceiver
from arva_hil.emulator.setup import ReceiverSetup, VehicleSetup
from arva_hil.emulator.world import FollowedSystem, Snapshot, VehicleWorld
from arva_hil.events import Event, FrameMade, HeartbeatMissing, ReceiverStatus, VehicleStatus
from arva_hil.mavlink.codec import Packet
from arva_hil.registry import FORMATS

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
