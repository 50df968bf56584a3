"""Many vehicles in one engine: none costs or delays another."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Iterable, Sequence
from itertools import pairwise

from arva_hil.autopilot.following.session import Received, Session
from arva_hil.clock import StepClock
from arva_hil.config import parse
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import ReceiverSetup, VehicleSetup
from arva_hil.events import FramesLate
from arva_hil.links import Link, memory
from arva_hil.mavlink.codec import Encoder, Packet, dialect
from arva_hil.mavlink.packet_reader import PacketReader
from arva_hil.runtime.audience import Audience
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.loop import run
from tests.one_receiver import Diary, turn

MANY = 32
SCENARIO = parse("transmitters: [{id: 7, ned: [20, 5, 0]}]\nreceiver: {rate_hz: 10}", "test")


class Counted(Session):
    """Counts how often it was asked for bytes, and how often it was given packets."""

    polls = given = 0

    def poll(self, now: float) -> bytes:
        self.polls += 1
        return super().poll(now)

    def receive(self, packets: Sequence[Packet], now: float, sender: Hashable = None) -> Received:
        self.given += 1
        return super().receive(packets, now, sender)


def heartbeat(system: int) -> bytes:
    message = dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)
    packed: bytes = Encoder(system, 1).pack(message)
    return packed


def fleet(sessions: Sequence[Session], links: Iterable[str]) -> list[VehicleSetup]:
    return [
        VehicleSetup(f"v{n}", link, session, SCENARIO, [ReceiverSetup("r", f"v{n}/r", SCENARIO)])
        for n, (session, link) in enumerate(zip(sessions, links, strict=True))
    ]


def test_bytes_of_one_vehicle_cost_the_others_nothing() -> None:
    sessions = [Counted(target_system=n + 1) for n in range(MANY)]
    emulator = Emulator(fleet(sessions, [f"link {n}" for n in range(MANY)]), start=0.0)
    turn(emulator, 0.0)
    before = [session.polls for session in sessions]
    for step in range(1, 21):  # none of the others has anything to do before 0.1 s
        emulator.receive("link 3", heartbeat(4), step * 1e-3)
        turn(emulator, step * 1e-3)
    polls = [session.polls - was for session, was in zip(sessions, before, strict=True)]
    assert polls[3] > 0
    assert sum(polls) == polls[3]


def test_on_a_shared_link_a_packet_is_given_to_its_vehicle_alone() -> None:
    reader = PacketReader()
    sessions = [Counted(target_system=n + 1, reader=reader) for n in range(MANY)]
    emulator = Emulator(fleet(sessions, ["link"] * MANY), start=0.0)
    for n in (0, 7, 7):
        emulator.receive("link", heartbeat(n + 1), 0.0, sender=n)
        turn(emulator, 0.0)
    assert {n: session.given for n, session in enumerate(sessions) if session.given} == {0: 1, 7: 2}
    assert emulator.receive("link", heartbeat(200), 0.0, sender=99) == (None, [0, 7])
    assert all(session.given for session in sessions)  # of a stranger each has something to say


def test_all_go_on_though_only_one_is_heard() -> None:
    """Each polls its session ten times a second and makes its frames, as if it were alone."""
    sessions = [Counted(target_system=n + 1) for n in range(MANY)]
    emulator, diary = Emulator(fleet(sessions, [f"link {n}" for n in range(MANY)]), start=0.0), Diary()
    now = 0.0
    while now < 2.0:
        turn(emulator, now, diary)
        now = min(emulator.next_deadline(), now + 0.01)
        emulator.receive("link 0", heartbeat(1), now)
    counts = {f"v{n}": sum(made.vehicle == f"v{n}" for made in diary.frames) for n in range(MANY)}
    assert set(counts.values()) == {20}
    assert max(made.late_s for made in diary.frames) < 1e-9
    assert all(20 <= session.polls <= 41 for session in sessions[1:])


def test_a_vehicle_whose_frames_are_late_again_and_again_is_named_once() -> None:
    """And again only when they were in time meanwhile; the other one is not named."""
    sessions = [Session(target_system=n + 1) for n in range(2)]
    slow = parse("transmitters: [{id: 7, ned: [20, 5, 0]}]\nreceiver: {rate_hz: 0.5}", "test")
    setups = fleet(sessions, ["a", "b"])
    setups[1] = VehicleSetup("v1", "b", sessions[1], slow, [ReceiverSetup("r", "v1/r", slow)])
    emulator, told, now = Emulator(setups, start=0.0), list[tuple[str, float]](), 0.0

    def serve(until: float, every: float) -> None:
        nonlocal now
        while now < until:
            emulator.advance(now)
            emulator.output()
            told.extend((e.vehicle, e.late_s) for e in emulator.events() if isinstance(e, FramesLate))
            now += every

    serve(2.0, 0.01)
    now += 3.0  # the process was stopped once: a second of frames is sent at once
    serve(6.0, 0.01)
    assert not told
    serve(10.0, 0.17)  # a machine with too much to do
    assert [vehicle for vehicle, _ in told] == ["v0"]
    assert told[0][1] > 0.05
    serve(13.0, 0.01)
    serve(17.0, 0.17)
    assert [vehicle for vehicle, _ in told] == ["v0", "v0"]


class Ticking(StepClock):
    """A clock that takes time to be looked at, as everything else does."""

    def now(self) -> float:
        self._now += 0.0002
        return self._now


class Flood(Link):
    """A link that gives as much as is taken."""

    name = "flood"

    def __init__(self) -> None:
        self._chunks = deque[bytes]()

    def begin(self, chunks: int, size: int) -> None:
        self._chunks.extend([heartbeat(1) * (size // len(heartbeat(1)))] * chunks)

    def read(self) -> bytes:
        return self._chunks.popleft() if self._chunks else b""

    def write(self, data: bytes) -> bool:
        return True

    def close(self) -> None: ...

    def ready(self) -> bool:
        return bool(self._chunks)


def test_frames_that_are_due_go_before_the_rest_of_a_flood() -> None:
    """A flooded link is read in pieces, with 0.2 ms for each; frames of the other vehicle are at most 2 ms late."""
    clock, diary, sent = Ticking(), Diary(), list[float]()
    near, far = memory.pair()
    ports = [memory.pair()[0] for _ in range(2)]
    sessions = [Session(target_system=n + 1) for n in range(2)]
    emulator = Emulator(fleet(sessions, ["flood", "calm"]), start=0.0)
    flood = Flood()
    autopilots = {"flood": flood, "calm": near}
    live = Live(emulator, autopilots, {"v0/r": ports[0], "v1/r": ports[1]}, Audience([diary]))
    far.write(heartbeat(2))
    live.service(clock)
    flood.begin(12, 400_000)
    while flood.ready():
        live.service(clock)
        sent.append(clock.now())
    frames = [made for made in diary.frames if made.vehicle == "v1"]
    assert len(frames) > 2
    assert max(b - a for a, b in pairwise(sent)) > 0.02  # while one chunk was read
    assert max(made.late_s for made in frames) < 0.002


def test_frames_of_vehicles_that_are_spread_are_due_one_after_another_each_at_its_own_rate() -> None:
    sessions = [Session(target_system=n + 1) for n in range(4)]
    emulator = Emulator(fleet(sessions, "abcd"), start=10.0, spread=True)
    diary, now = Diary(), 10.0
    while now < 10.35:
        turn(emulator, now, diary)
        now = max(emulator.next_deadline(), now + 1e-6)
    made = [(frame.vehicle, round(frame.instant_s, 6)) for frame in diary.frames]
    assert made == [(f"v{n % 4}", round(n * 0.025, 6)) for n in range(len(made))]
    assert len(made) == 14


def test_a_tenth_of_a_hertz_and_fifty_beside_each_other_are_in_time_and_nobody_waits_for_the_slow_one() -> None:
    setups = []
    for n, rate in enumerate((50, 0.1, 7)):
        own = parse(f"transmitters: [{{id: 7, ned: [20, 5, 0]}}]\nreceiver: {{rate_hz: {rate}}}", "test")
        receiver = ReceiverSetup("r", f"v{n}/r", own)
        setups.append(VehicleSetup(f"v{n}", f"l{n}", Session(target_system=n + 1), own, [receiver]))
    links = {f"l{n}": memory.pair()[0] for n in range(3)}
    ports = {f"v{n}/r": memory.pair()[0] for n in range(3)}
    diary = Diary()
    live = Live(Emulator(setups, start=0.0, spread=True), links, ports, Audience([diary]))
    run([live], StepClock(), until=21.0)
    of = {f"v{n}": [frame for frame in diary.frames if frame.vehicle == f"v{n}"] for n in range(3)}
    assert {name: len(frames) for name, frames in of.items()} == {"v0": 1051, "v1": 3, "v2": 147}
    assert [round(frame.instant_s, 6) for frame in of["v1"]] == [0.033333, 10.033333, 20.033333]
    assert max(frame.late_s for frame in diary.frames) < 1e-3
