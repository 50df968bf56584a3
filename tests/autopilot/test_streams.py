"""Which streams are asked for, of vehicles that obey, refuse, do not know how, or never answer."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest

from arva_hil.autopilot.following.streams import Streams
from arva_hil.events import Event
from arva_hil.events.vehicles import (
    StreamAskedOtherwise,
    StreamEvent,
    StreamRateLowered,
    VehicleFound,
    VehicleRebooted,
)
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.simulated.vehicle import SimulatedVehicle
from tests.kept_events import KeepingSession

HOME = (46.5, 11.35, 1800.0)
SET_INTERVAL, REQUEST, GET_HOME = 511, 512, 410
ATTITUDE, QUATERNION, POSITION, HOME_POSITION = 30, 31, 33, 242
POSITION_GROUP, ATTITUDE_GROUP = dialect.MAV_DATA_STREAM_POSITION, dialect.MAV_DATA_STREAM_EXTRA1
ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS = range(6)
ASKED_HOME = (REQUEST, HOME_POSITION)


class Fake:
    """An autopilot that sends what it was asked for by the means it knows.

    `answer(request)` gives the results with which it acknowledges a command, and it is obeyed when the last one
    is ACCEPTED; `groups`: it knows REQUEST_DATA_STREAM; `addressee` of its acknowledgements.
    """

    def __init__(
        self,
        answer: Callable[[Any], list[int]],
        *,
        groups: bool = False,
        addressee: tuple[int, int] | None = None,
        fastest: float = 1e9,
    ) -> None:
        self._answer = answer
        self._groups = groups
        self._addressee = addressee
        self._fastest = fastest
        self._parser = Parser()
        self._encoder = Encoder(1, 1)
        self._period = {0: 1.0}
        self._due = {0: 0.0}
        self._acks: list[Any] = []

    def feed(self, chunk: bytes, now: float) -> None:
        for packet in self._parser.feed(chunk):
            message = decode(packet)
            if packet.msgid == dialect.MAVLINK_MSG_ID_COMMAND_LONG:
                results = self._answer(message)
                to = self._addressee or (packet.system, packet.component)
                self._acks += [dialect.MAVLink_command_ack_message(message.command, r, 0, 0, *to) for r in results]
                if message.command == SET_INTERVAL and results[-1:] == [ACCEPTED]:
                    self._stream(int(message.param1), 1e6 / message.param2, now)
            elif packet.msgid == dialect.MAVLINK_MSG_ID_REQUEST_DATA_STREAM and self._groups:
                group = {POSITION_GROUP: POSITION, ATTITUDE_GROUP: ATTITUDE}[message.req_stream_id]
                self._stream(group, message.req_message_rate, now)

    def _stream(self, msgid: int, rate: float, now: float) -> None:
        self._period[msgid] = 1 / min(rate, self._fastest)
        self._due[msgid] = now + self._period[msgid]

    def poll(self, now: float) -> bytes:
        messages, self._acks = self._acks, []
        for msgid in self._due:
            while self._due[msgid] <= now:
                messages.append(self._message(msgid, self._due[msgid]))
                self._due[msgid] += self._period[msgid]
        return b"".join(self._encoder.pack(m) for m in messages)

    def _message(self, msgid: int, at: float) -> Any:
        boot_ms = round(at * 1e3)
        if msgid == POSITION:
            return dialect.MAVLink_global_position_int_message(boot_ms, 465_000_000, 113_500_000, 0, 0, 0, 0, 0, 0)
        if msgid == ATTITUDE:
            return dialect.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0)
        return dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3)


class Bench:
    """A session and a vehicle, joined in memory, and the clock in the test's hand."""

    def __init__(self, vehicle: SimulatedVehicle | Fake, **options: Any) -> None:
        self.vehicle = vehicle
        self.session = KeepingSession(**options)
        self.now = 0.0
        self.requests: list[tuple[float, Any]] = []
        self.events: list[Event] = []
        self._parser = Parser()

    def run(self, seconds: float) -> Bench:
        for _ in range(round(seconds * 100)):
            self.session.feed(self.vehicle.poll(self.now), self.now)
            said = self.session.poll(self.now)[0]
            self.vehicle.feed(said, self.now)
            for packet in self._parser.feed(said):
                if packet.msgid != dialect.MAVLINK_MSG_ID_HEARTBEAT:
                    self.requests.append((self.now, decode(packet)))
            self.events += self.session.take_events()
            self.now += 0.01
        return self

    @property
    def stream_events(self) -> list[StreamEvent]:
        return [event for event in self.events if isinstance(event, StreamEvent)]

    def asked(self, since: float = 0.0) -> Counter[Any]:
        """How often each was asked for: (command, message id), or a group of REQUEST_DATA_STREAM."""
        return Counter(
            ("group", m.req_stream_id) if m.get_type() == "REQUEST_DATA_STREAM" else (m.command, int(m.param1))
            for at, m in self.requests
            if at >= since
        )

    def rates(self) -> tuple[float, float]:
        rates = self.session.rates(self.now)
        return rates["GLOBAL_POSITION_INT"], rates["ATTITUDE"]


def always(*results: int) -> Callable[[Any], list[int]]:
    return lambda _: list(results)


ONCE = {(SET_INTERVAL, POSITION): 1, (SET_INTERVAL, ATTITUDE): 1, ASKED_HOME: 1}


def test_position_attitude_and_home_are_asked_for_once_and_nothing_else() -> None:
    bench = Bench(SimulatedVehicle(HOME)).run(30)
    assert bench.asked() == ONCE
    assert all((m.target_system, m.target_component) == (1, 1) for _, m in bench.requests)
    assert bench.stream_events == []
    assert bench.session.navigation.home == pytest.approx(HOME)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("hz", [10.0, 50.0, 100.0])
def test_the_rate_wanted_is_there_within_two_seconds(hz: float, version: int) -> None:
    bench = Bench(SimulatedVehicle(HOME, version=version), rate_hz=hz).run(2)
    assert bench.session.navigation.track.newest == pytest.approx(2.0, abs=1.1 / hz + 0.011)
    assert all(at < 0.5 for at, _ in bench.requests)
    bench.run(2)
    assert bench.rates() == pytest.approx((hz, hz), rel=0.05)


@pytest.mark.parametrize("attitude", [ATTITUDE, QUATERNION])
def test_streams_that_flow_fast_are_left_alone(attitude: int) -> None:
    bench = Bench(SimulatedVehicle(HOME, streams={POSITION: 49, attitude: 40})).run(20)
    assert bench.asked() == {ASKED_HOME: 1}
    assert bench.rates() == pytest.approx((49, 40), rel=0.05)


def test_only_the_slow_stream_is_asked_for() -> None:
    bench = Bench(SimulatedVehicle(HOME, streams={POSITION: 10, QUATERNION: 50})).run(20)
    assert bench.asked() == {(SET_INTERVAL, POSITION): 1, ASKED_HOME: 1}
    assert bench.rates()[0] == pytest.approx(50, rel=0.05)


@pytest.mark.parametrize(("wanted", "denials"), [(400.0, 1), (1200.0, 2), (5000.0, 4)])
def test_a_rate_denied_is_halved_until_it_is_accepted(wanted: float, denials: int) -> None:
    bench = Bench(SimulatedVehicle(HOME), rate_hz=wanted).run(5)
    asked = [m.param2 for _, m in bench.requests if m.to_dict().get("param1") == POSITION]
    assert asked == pytest.approx([1e6 / wanted * 2**i for i in range(denials + 1)])
    assert bench.rates() == pytest.approx((wanted / 2**denials,) * 2, rel=0.05)
    told = [event for event in bench.stream_events if isinstance(event, StreamRateLowered)]
    assert len(told) == len(bench.stream_events) == 2 * denials
    assert {event.result for event in told} == {"MAV_RESULT_DENIED"}
    assert {event.next_hz for event in told} == {wanted / 2 ** (n + 1) for n in range(denials)}


@pytest.mark.parametrize("result", [UNSUPPORTED, FAILED])
def test_a_vehicle_that_does_not_know_the_command_is_asked_by_group(result: int) -> None:
    bench = Bench(Fake(always(result), groups=True)).run(20)
    asked = bench.asked()
    assert (asked[SET_INTERVAL, POSITION], asked[SET_INTERVAL, ATTITUDE]) == (1, 1)
    assert (asked["group", POSITION_GROUP], asked["group", ATTITUDE_GROUP]) == (1, 1)
    assert bench.rates() == pytest.approx((50, 50), rel=0.05)
    assert list(map(type, bench.stream_events)) == [StreamAskedOtherwise] * 2


def test_a_vehicle_that_never_answers_is_asked_by_group_after_three_requests() -> None:
    bench = Bench(Fake(always(), groups=True)).run(40)
    asked = bench.asked()
    assert (asked[SET_INTERVAL, POSITION], asked[SET_INTERVAL, ATTITUDE]) == (3, 3)
    assert (asked["group", POSITION_GROUP], asked["group", ATTITUDE_GROUP]) == (1, 1)
    assert bench.rates() == pytest.approx((50, 50), rel=0.05)
    assert list(map(type, bench.stream_events)) == [StreamAskedOtherwise] * 2
    assert {(event.command, event.result) for event in bench.stream_events} == {("SET_MESSAGE_INTERVAL", "")}


@pytest.mark.parametrize("results", [(), (UNSUPPORTED,), (DENIED,), (FAILED,), (REJECTED,), (ACCEPTED,)])
def test_when_nothing_helps_requests_grow_rare_and_it_is_said_once(results: tuple[int, ...]) -> None:
    """Of a vehicle that accepts, too: its streams come at 8 Hz whatever is asked."""
    bench = Bench(Fake(always(*results), fastest=8), rate_hz=50).run(60)
    streams = [at for at, m in bench.requests if getattr(m, "command", 0) not in (REQUEST, GET_HOME)]
    assert len(streams) <= 24
    said = len(bench.stream_events)
    assert said <= 2 * (1 + 4)  # of each stream: the other kind of request, and each time that its rate is halved
    start = bench.now
    bench.run(60)
    assert len([at for at, _ in bench.requests if at >= start]) <= 12 + 30
    assert len(bench.stream_events) == said


def test_rejected_for_now_is_asked_again_in_the_same_way() -> None:
    answers = iter([REJECTED] * 2 + [ACCEPTED] * 10)
    bench = Bench(Fake(lambda m: [next(answers)] if m.command == SET_INTERVAL else [])).run(6)
    assert bench.rates() == pytest.approx((50, 50), rel=0.05)
    asked = bench.asked()
    assert asked[SET_INTERVAL, POSITION] + asked[SET_INTERVAL, ATTITUDE] == 4
    assert bench.stream_events == []


def test_in_progress_is_no_answer_yet() -> None:
    bench = Bench(Fake(always(IN_PROGRESS, ACCEPTED))).run(5)
    assert bench.rates() == pytest.approx((50, 50), rel=0.05)
    assert bench.stream_events == []


@pytest.mark.parametrize("addressee", [(255, 190), (1, 190), (2, 191)])
def test_answers_to_others_are_not_ours(addressee: tuple[int, int]) -> None:
    bench = Bench(Fake(always(DENIED), addressee=addressee)).run(5)
    assert bench.asked()[SET_INTERVAL, POSITION] == 2
    assert {m.param2 for _, m in bench.requests if m.command == SET_INTERVAL} == {20_000}
    assert bench.stream_events == []


def test_answers_to_other_commands_are_not_for_the_streams() -> None:
    bench = Bench(Fake(lambda m: [DENIED] if m.command != SET_INTERVAL else [])).run(5)
    bench.session.feed(Encoder(1, 1).pack(dialect.MAVLink_command_ack_message(400, DENIED)), bench.now)
    bench.run(1)
    assert bench.asked()[SET_INTERVAL, POSITION] == 2
    assert bench.stream_events == []


def test_an_answer_to_everybody_is_ours_too() -> None:
    """MAVLink 1 has no addressee in an acknowledgement."""
    bench = Bench(Fake(always(DENIED), addressee=(0, 0))).run(0.5)
    assert "MAV_RESULT_DENIED" in {event.result for event in bench.stream_events}


def lower(bench: Bench) -> None:
    """Another client wants the position at 2 Hz."""
    request = dialect.MAVLink_command_long_message(1, 1, SET_INTERVAL, 0, POSITION, 500_000, 0, 0, 0, 0, 0)
    bench.vehicle.feed(Encoder(255, 190).pack(request), bench.now)


def test_a_stream_lowered_by_somebody_else_is_asked_for_again_each_time() -> None:
    bench = Bench(SimulatedVehicle(HOME)).run(5)
    for _ in range(8):
        lower(bench)
        bench.run(5)
        assert bench.rates() == pytest.approx((50, 50), rel=0.05)
    assert bench.asked() == ONCE | {(SET_INTERVAL, POSITION): 9}
    assert bench.stream_events == []


def test_after_a_reboot_all_is_asked_for_again() -> None:
    vehicle = SimulatedVehicle(HOME)
    bench = Bench(vehicle).run(20)
    vehicle.reboot(bench.now)
    bench.run(8)
    again = bench.asked(since=20.0)
    assert bench.session.navigation.reboots == 1
    assert {ASKED_HOME, (SET_INTERVAL, POSITION), (SET_INTERVAL, ATTITUDE)} == set(again)
    assert bench.rates() == pytest.approx((50, 50), rel=0.05)
    assert bench.session.navigation.home == pytest.approx(HOME)
    assert list(map(type, bench.events)) == [VehicleFound, VehicleRebooted]


def test_home_is_asked_for_until_it_is_known_by_two_commands_in_turn() -> None:
    bench = Bench(SimulatedVehicle(HOME, fix_after=20.0)).run(19.9)
    asked = bench.asked()
    assert asked[ASKED_HOME] >= 3
    assert asked[GET_HOME, 0] >= 3
    bench.run(10)
    assert bench.session.navigation.home == pytest.approx(HOME)
    assert not {ASKED_HOME, (GET_HOME, 0)} & set(bench.asked(since=22.5))


def test_the_vehicles_answer_is_kept_for_a_person() -> None:
    bench = Bench(Fake(always(REJECTED))).run(1)
    streams = bench.session.why_no_pose().streams
    assert ("GLOBAL_POSITION_INT", "MAV_RESULT_TEMPORARILY_REJECTED") in [(s.name, s.result) for s in streams]


@pytest.mark.parametrize(("sent_hz", "until"), [(10.0, 7.3), (8.0, 7.3), (50.0, 12.0)])
def test_a_stream_that_stops_is_asked_for_as_soon_as_its_rate_is_too_low(sent_hz: float, until: float) -> None:
    """7 of 10 Hz are enough: 14 messages in two seconds. Nothing is asked for before, and no look comes too late."""
    streams, came, asked = Streams(10.0, "", lambda event: None), list[float](), list[float]()
    for step in range(1, 2000):
        now = step / 100
        if now <= until and int(now * sent_hz) > int((now - 0.01) * sent_hz):
            streams.on_message(POSITION, now)
            streams.on_message(ATTITUDE, now)
            came.append(now)
        if streams.poll(now, 1, 1, home=False) and now > 1:
            asked.append(now)
            break
    (first,) = asked
    assert 2.0 < first - came[-14] < 2.21
