"""An emulator of one vehicle with one receiver, on links, by any clock; who notes its events; both with a vehicle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from arva_hil.autopilot.following.session import Session
from arva_hil.clock import StepClock
from arva_hil.config import Scenario
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.ports import Counters, Output
from arva_hil.emulator.receivers import Schedule
from arva_hil.emulator.setup import one_vehicle
from arva_hil.events import BytesSent, Event, FrameMade, HeartbeatMissing, PacketsReceived, StatusReport
from arva_hil.events.words.reasons import no_vehicle
from arva_hil.events.words.sentences import sentence
from arva_hil.events.words.text import Notice
from arva_hil.links import Link, memory
from arva_hil.mavlink.codec import Encoder, command, dialect
from arva_hil.runtime.audience import Audience, Observer
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.loop import run
from arva_hil.simulated import HOME
from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator


class OneReceiver(Live):
    """`link`: the autopilot's, None where there is none; `port`: takes the frames, None where `link` does."""

    def __init__(
        self,
        scenario: Scenario,
        session: Session,
        link: Link | None,
        port: Link | None,
        *,
        start: float,
        observers: Sequence[Observer] = (),
        **options: float,
    ) -> None:
        emulator = Emulator([one_vehicle(scenario, session)], start=start, tell_packets=True, **options)
        links = {"autopilot": link} if link else {}
        super().__init__(emulator, links, {"port": port} if port else {}, Audience(observers))
        self.session = session

    @property
    def counters(self) -> Counters:
        return self.emulator.vehicles[0].units[0].port.counters

    def fault_counts(self) -> dict[str, dict[str, int]]:
        return self.emulator.vehicles[0].units[0].port.fault_counts()

    @property
    def schedule(self) -> Schedule:
        return self.emulator.vehicles[0].units[0].receiver.schedule


class Diary:
    """Notes every event."""

    def __init__(self) -> None:
        self.events: list[Event] = []

    def observe(self, event: Event) -> None:
        self.events.append(event)

    @property
    def frames(self) -> list[FrameMade]:
        return [event for event in self.events if isinstance(event, FrameMade)]

    @property
    def bytes(self) -> bytes:
        """All that a port took."""
        return b"".join(event.data for event in self.events if isinstance(event, BytesSent))

    @property
    def packets(self) -> list[PacketsReceived]:
        return [event for event in self.events if isinstance(event, PacketsReceived)]

    @property
    def statuses(self) -> list[StatusReport]:
        return [event for event in self.events if isinstance(event, StatusReport)]

    @property
    def missing(self) -> list[str]:
        """What was heard instead of a heartbeat, when none came in time."""
        return [no_vehicle(event.heard) for event in self.events if isinstance(event, HeartbeatMissing)]

    @property
    def notices(self) -> list[Notice]:
        return [notice for event in self.events if (notice := sentence(event)) is not None]

    def said(self, part: str) -> int:
        return sum(part in notice.text for notice in self.notices)


def turn(emulator: Emulator, now: float, *diaries: Diary) -> list[Output]:
    """Do what is due, and write all of it. Returns the outputs; the diaries note the events."""
    emulator.advance(now)
    outputs = emulator.output()
    for output in outputs:
        emulator.written(output.id, True, now)
    events = emulator.events()
    for diary in diaries:
        diary.events += events
    return outputs


class Flown:
    """The built-in vehicle, an emulator and a `consumer` of its frames, on memory links and a stepped clock.

    `capacity`: bytes that the consumer's link holds. `inside`: frames have no port, and go to the vehicle.
    """

    def __init__(
        self,
        scenario: Scenario,
        vehicle: SimulatedVehicle | None = None,
        session: Session | None = None,
        *,
        capacity: int | None = None,
        inside: bool = False,
        **options: Any,
    ) -> None:
        self.clock, self.diary = StepClock(), Diary()
        self.vehicle = vehicle or SimulatedVehicle(HOME)
        self.session = session or Session()
        autopilot, self.far = memory.pair()
        port, self.consumer = memory.pair(capacity)
        self.simulator = Simulator([self.vehicle], [self.far])
        self.emulator = OneReceiver(
            scenario, self.session, autopilot, None if inside else port, start=0.0, observers=[self.diary], **options
        )

    def run(self, until: float, *, with_vehicle: bool = True) -> None:
        tasks = [self.simulator, self.emulator] if with_vehicle else [self.emulator]
        run(tasks, self.clock, until=until)

    def go_on(self, seconds: float) -> None:
        self.run(self.clock.now() + seconds)

    def fly(self, north: float, east: float = 0.0) -> None:
        """Arm, take off to 3 m, then keep a velocity [m/s]."""
        say = Encoder(255, 190)
        for asked in ((176, 1, 4), (400, 1), (22, 0, 0, 0, 0, 0, 0, 3.0)):
            self.vehicle.feed(say.pack(command(1, 1, *asked)), self.clock.now())
        self.go_on(6.0)
        still, keeps = (0.0, 0.0, 0.0), 0b110111000111
        move = dialect.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, keeps, *still, north, east, 0, *still, 0, 0
        )
        self.vehicle.feed(say.pack(move), self.clock.now())
