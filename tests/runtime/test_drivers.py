"""A run whose links are lost and come back: what the session does, what the frames say, what a person is told."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import pytest

from arva_hil.autopilot.following.session import Session
from arva_hil.clock import Clock, StepClock
from arva_hil.config import parse
from arva_hil.events.words.sentences import sentence
from arva_hil.links import Link, LinkError
from arva_hil.links.base import Sender
from arva_hil.links.memory import MemoryLink, pair
from arva_hil.links.reconnecting import Barred, ReconnectingLink
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.runtime.link_monitor import LinkMonitor
from arva_hil.runtime.loop import run
from arva_hil.simulated import HOME
from arva_hil.simulated.vehicle import SimulatedVehicle
from firmware_proto import Decoder, Frame
from tests.one_receiver import Diary, OneReceiver

SCENARIO = parse("receiver: {noise: {kind: off}, rate_hz: 20}\ntransmitters: [{id: 7, ned: [20, 5, 0]}]", "test")
SET_INTERVAL, REQUEST_MESSAGE = dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAV_CMD_REQUEST_MESSAGE


class Socket:
    """Where a far end is plugged in: `far` is None while it is not, and `bars` says what keeps it from being opened."""

    def __init__(self, name: str, clock: Clock) -> None:
        self._name = name
        self.far: MemoryLink | None = None
        self.bars = ""  # what a person has to see to
        self.link = ReconnectingLink(self.open(plug=True), self.open, clock, start=lambda job: job())

    def open(self, *, plug: bool = False) -> Link:
        if self.bars:
            raise Barred(self._name, self.bars)
        if self.far is None and not plug:
            raise LinkError(self._name, "is not there")
        near, self.far = pair()
        near.name = self._name
        return near

    def pull(self) -> None:
        self.far.close()
        self.far = None

    def plug(self) -> None:
        self.far, _ = pair()  # until it is opened

    def read(self) -> bytes:
        return self.far.read() if self.far and self.far.ready() else b""


class Bench:
    """A vehicle, a run and a consumer; a task, too: the vehicle's part. `heard`: what was said to the vehicle."""

    def __init__(self, **options: float) -> None:
        self.clock = StepClock()
        self.vehicle = SimulatedVehicle(HOME)
        self.autopilot, self.port = Socket("autopilot", self.clock), Socket("port", self.clock)
        self.heard: list[tuple[float, Any]] = []
        self.links: Sequence[Link] = ()
        self.diary = Diary()
        self.session = Session()
        self._parser = Parser()
        self._decoder = Decoder()
        self.frames: list[Frame] = []
        link, port = self.autopilot.link, self.port.link
        self.emulator = OneReceiver(
            SCENARIO, self.session, link, port, start=0.0, observers=[self.diary], **{"max_age_s": 1.0, **options}
        )

    def service(self, clock: Clock) -> float:
        now = clock.now()
        chunk = self.autopilot.read()
        self.heard += [(now, decode(packet)) for packet in self._parser.feed(chunk)]
        self.vehicle.feed(chunk, now)
        if (said := self.vehicle.poll(now)) and self.autopilot.far:
            self.autopilot.far.write(said)
        self.frames += self._decoder.feed(self.port.read(), now)
        return now + 0.01

    def run(self, seconds: float) -> None:
        run([self, self.emulator], self.clock, until=self.clock.now() + seconds)

    def asked(self, since: float, command: int, param1: float | None = None) -> list[float]:
        """When a command came."""
        return [
            at - since
            for at, message in self.heard
            if at >= since and getattr(message, "command", None) == command and param1 in (None, message.param1)
        ]

    @property
    def posed(self) -> bool:
        return self.diary.frames[-1].pose is not None


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    made.run(5.0)
    assert made.posed
    yield made
    for side in (made.autopilot, made.port):
        side.link.close()


def test_the_autopilots_link_goes_and_comes_while_frames_keep_their_rhythm(bench: Bench) -> None:
    bench.autopilot.pull()
    bench.run(3.0)
    assert not bench.posed
    bench.autopilot.plug()
    bench.run(1.0)
    assert bench.posed
    times = [s.instant_s for s in bench.diary.frames]
    assert times == pytest.approx([n / 20 for n in range(len(times))])
    absent = [s.instant_s for s in bench.diary.frames if s.pose is None and s.instant_s > 5]
    assert absent[0] == pytest.approx(6.0, abs=0.11)  # the pose is too old
    assert absent[-1] < 8.0 + 1.0
    assert [frame.sequence for frame in bench.frames] == [n % 256 for n in range(len(bench.frames))]
    assert all(s.sent for s in bench.diary.frames)
    assert (bench.session.navigation.reboots, bench.emulator.counters.skipped) == (0, 0)


def test_one_line_for_lost_and_one_for_back(bench: Bench) -> None:
    before = len(bench.diary.notices)
    for n, side in enumerate((bench.autopilot, bench.port), 1):
        side.pull()
        bench.run(8.0)  # longer than any patience with a silent vehicle
        side.plug()
        bench.run(1.0)
        name = side.link.name
        of_links = [notice for notice in bench.diary.notices[before:] if "pose" not in notice.text]
        assert [notice.level for notice in of_links] == ["warning", "info"] * n
        assert of_links[-2].text == f"{name}: lost: closed by the far end, searching for it"
        assert of_links[-1].text.startswith(f"{name}: back after 8.")
    counts = {"losses": 1, "returns": 1, "strangers": 0}
    both = {f"{side}_link_{what}": n for side in ("autopilot", "port") for what, n in counts.items()}
    both |= {f"{name}_link_dropped": link.dropped for name, link in bench.emulator.sinks.items()}
    assert bench.emulator.counts() == both
    assert both["port_link_dropped"] == bench.emulator.counters.dropped
    assert sum(link.losses > 0 for link in bench.emulator.sinks.values()) == 2


def test_what_a_person_has_to_see_to_is_one_more_line(bench: Bench) -> None:
    before = len(bench.diary.notices)
    bench.port.pull()
    bench.run(2.0)
    bench.port.bars = "busy: held by 1234 (mavproxy)"
    bench.run(8.0)
    bench.port.bars = ""
    bench.run(2.0)
    bench.port.plug()
    bench.run(1.0)
    lost, busy, back = bench.diary.notices[before:]
    assert (lost.level, lost.text) == ("warning", "port: lost: closed by the far end, searching for it")
    assert (busy.level, busy.text) == ("warning", "port: busy: held by 1234 (mavproxy)")
    assert back.text.startswith("port: back after 1")
    bench.port.pull()
    bench.run(1.0)
    assert bench.diary.notices[-1] == lost


def test_a_link_that_was_never_lost_has_no_line() -> None:
    bench = Bench()
    bench.run(1.0)
    assert not any(link.losses for link in bench.emulator.sinks.values())
    assert set(bench.emulator.counts().values()) == {0}


@pytest.mark.parametrize("rebooted", [False, True])
def test_streams_are_asked_for_again_at_once(bench: Bench, rebooted: bool) -> None:
    """An autopilot keeps its intervals over an absence or, when it has started again, has none."""
    bench.autopilot.pull()
    bench.run(2.0)
    if rebooted:
        bench.vehicle.reboot(bench.clock.now())
    bench.autopilot.plug()
    at = bench.clock.now()
    bench.run(2.0)
    for msgid in (dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, dialect.MAVLINK_MSG_ID_ATTITUDE):
        assert bench.asked(at, SET_INTERVAL, msgid)[0] < 0.8
    assert bench.asked(at, REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_HOME_POSITION)[0] < 0.8
    assert bench.session.navigation.home is not None
    assert bench.posed
    assert bench.session.navigation.reboots == rebooted
    assert bench.diary.said("has rebooted") == rebooted
    assert min(bench.session.rates(bench.clock.now()).values()) > 40


def test_whose_boot_time_is_a_little_less_on_a_new_link_has_rebooted(bench: Bench) -> None:
    """On the same link it may be a packet that comes late."""
    boot = bench.session.navigation.clock.boot(bench.clock.now())
    late = dialect.MAVLink_attitude_message(round(boot * 1e3) - 300, 0, 0, 0, 0, 0, 0)
    packet = Encoder(1, 1).pack(late)
    now = bench.clock.now()
    for later in (0.0, 0.6, 0.7):
        bench.session.feed(packet, now + later)
    assert bench.session.navigation.reboots == 0
    bench.session.interrupt("")
    bench.session.resume(now + 1.3)
    for later in (1.3, 1.4):
        bench.session.feed(packet, now + later)
    assert bench.session.navigation.reboots == 1


def test_nothing_is_asked_twice_of_one_that_stayed(bench: Bench) -> None:
    at = bench.clock.now()
    bench.run(10.0)
    assert not bench.asked(at, SET_INTERVAL)


def test_a_packet_torn_by_the_loss_costs_nothing_of_the_next_session(bench: Bench) -> None:
    torn = bench.vehicle.poll(bench.clock.now() + 1.0)[:100]
    bench.autopilot.far.write(torn[:-3])
    bench.run(0.05)
    bench.autopilot.pull()
    bench.run(1.0)
    bench.autopilot.plug()
    bench.run(2.0)
    assert bench.session.reader.parser.bad_crc == 0
    assert bench.session.reader.parser.skipped < 100
    assert bench.posed


def test_a_loss_between_two_looks_costs_nothing_of_the_next_session(bench: Bench) -> None:
    clock, parser = bench.clock, bench.session.reader.parser
    packet = Encoder(1, 1).pack(dialect.MAVLink_statustext_message(4, b"low battery"))
    skipped = parser.skipped

    def read(data: bytes) -> None:
        if data:
            bench.autopilot.far.write(data)
        bench.emulator._read("autopilot", clock, clock.now())

    read(packet[:10])
    bench.autopilot.pull()
    read(b"")
    bench.autopilot.plug()
    clock.wait(clock.now() + 0.06)
    read(b"")
    read(packet[:15])
    bench.emulator._check_links(clock.now())
    read(packet[15:])
    bench.emulator.finish(clock)
    assert parser.skipped == skipped + 10
    assert bench.diary.packets[-1].packets[-1].raw == packet


def test_at_the_end_of_a_run_the_last_bytes_are_used_and_what_is_due_is_done_and_told(bench: Bench) -> None:
    clock, made = bench.clock, len(bench.diary.frames)
    clock.wait(bench.emulator.schedule.deadline)
    bench.autopilot.far.write(last := Encoder(1, 1).pack(dialect.MAVLink_statustext_message(4, b"low battery")))
    bench.emulator._read("autopilot", clock, clock.now())
    bench.emulator.finish(clock)
    assert len(bench.diary.frames) == made + 1
    assert bench.diary.packets[-1].packets[-1].raw == last
    assert Decoder().feed(bench.port.read(), 0.0)[-1].sequence == made


def test_what_a_consumer_says_is_read_and_forgotten(bench: Bench) -> None:
    bench.port.far.write(b"hello?")
    bench.run(0.3)
    assert not bench.port.link.ready()
    assert bench.session.reader.parser.skipped == 0


def test_a_lost_port_is_noticed_and_found_between_two_frames() -> None:
    bench = Bench()
    bench.emulator.schedule._rate = 0.1  # one frame in 10 s
    bench.run(1.0)
    bench.port.pull()
    bench.run(0.2)
    assert bench.emulator.counts()["port_link_losses"] == 1
    bench.port.plug()
    bench.run(1.0)
    assert bench.emulator.counts()["port_link_returns"] == 1


def test_frames_inside_mavlink_survive_an_absence() -> None:
    bench = Bench()
    tunnel = replace(SCENARIO, output_format="tunnel")
    bench.emulator = OneReceiver(tunnel, bench.session, bench.autopilot.link, None, start=0.0, observers=[bench.diary])
    bench.run(3.0)
    bench.autopilot.pull()
    bench.run(1.0)
    bench.autopilot.plug()
    bench.run(1.0)
    at = bench.clock.now()
    bench.run(1.0)
    assert sum(when >= at and message.get_type() == "TUNNEL" for when, message in bench.heard) in (19, 20, 21)
    assert bench.diary.said("no program takes") == 0
    assert bench.emulator.counts()["autopilot_link_returns"] == 1
    assert "port_link_losses" not in bench.emulator.counts()


def test_a_link_lost_before_any_vehicle_was_heard_is_what_the_end_tells() -> None:
    bench = Bench(timeout_s=2.0)
    bench.autopilot.pull()
    bench.run(5.0)
    (heard,) = bench.diary.missing
    assert heard.startswith("no autopilot was found: autopilot: lost: closed by the far end")


def test_a_vehicle_that_was_silent_for_some_seconds_is_asked_again_at_once(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As over UDP, where nothing is ever lost: it may have started again, and then streams nothing."""
    poll = bench.vehicle.poll
    monkeypatch.setattr(bench.vehicle, "poll", lambda now: poll(now) and b"")
    bench.run(4.5)  # between two tries of the usual kind
    bench.vehicle.reboot(bench.clock.now())
    monkeypatch.setattr(bench.vehicle, "poll", poll)
    at = bench.clock.now()
    bench.run(1.0)
    assert bench.asked(at, SET_INTERVAL)[0] < 0.3
    assert bench.posed
    assert bench.session.navigation.reboots == 1


@pytest.mark.parametrize("within", [False, True])
def test_after_a_stall_all_that_waits_is_read_before_a_frame_is_made(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, within: bool
) -> None:
    """A process that was stopped for some seconds finds them in its link, a piece at a read, the oldest first.

    `within`: it was stopped while it read, in time for the next frame.
    """
    link, clock = bench.autopilot.link, bench.clock
    take, pieces = link.receive, deque[tuple[Sender, bytes]]()
    stops = iter([within])

    def receive() -> list[tuple[Sender, bytes]]:
        for sender, data in take():
            pieces.extend((sender, data[at : at + 4096]) for at in range(0, len(data), 4096))
        if next(stops, False):
            run([bench], clock, until=clock.now() + 3.0)  # the vehicle goes on, the emulator does not
        return [pieces.popleft()] if pieces else []

    monkeypatch.setattr(link, "receive", receive)
    made, stopped = len(bench.diary.frames), clock.now()
    run([bench], clock, until=stopped + (0.0 if within else 3.0))
    while len(bench.diary.frames) == made:
        assert clock.now() < stopped + 4.0
        clock.wait(bench.emulator.service(clock))
    late = bench.diary.frames[made:]
    assert len(late) > 10
    assert all(frame.age_s is not None and frame.age_s < 0.2 for frame in late)


def test_where_more_arrives_than_can_be_read_frames_are_late_but_are_sent(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A computer with too much to do: there is always more to read, and each read takes a while."""

    def receive() -> list[tuple[Sender, bytes]]:
        bench.clock.wait(bench.clock.now() + 0.01)
        return [(None, bytes(4096))]

    stopped = bench.clock.now()
    run([bench], bench.clock, until=stopped + 3.0)
    monkeypatch.setattr(bench.autopilot.link, "receive", receive)
    made, begun = len(bench.diary.frames), bench.clock.now()
    bench.emulator.service(bench.clock)
    assert len(bench.diary.frames) > made
    assert bench.clock.now() - begun < 0.3


class Still(Link):
    """A link whose counters are set by the test."""

    name = "still"

    def read(self) -> bytes:
        return b""

    def write(self, data: bytes) -> bool:
        return True

    def close(self) -> None: ...


@pytest.mark.parametrize(
    ("happens", "lines"),
    [
        (lambda link: link._gone(LinkError("still", "lost")), ["still: lost"]),
        (lambda link: (link._gone(LinkError("still", "lost")), link._renewed()), ["still: lost", "still: back"]),
    ],
)
def test_what_happens_between_two_looks_is_told_too(happens: Callable[[Still], None], lines: list[str]) -> None:
    link = Still()
    monitor = LinkMonitor("autopilot", link)
    assert not monitor.poll(1.0)
    happens(link)
    told = [sentence(event) for now in (2.0, 3.0) for event in monitor.poll(now)]
    assert [notice.text for notice in told if notice] == lines
