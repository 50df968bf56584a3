"""Which streams are asked for, which of several senders is the vehicle, and what it says of itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.autopilot.commanding.complaints import Complaints, unwell
from arva_hil.autopilot.following.streams import Streams
from arva_hil.events import Event
from arva_hil.events.vehicles import (
    OtherAutopilotIgnored,
    StreamAskedOtherwise,
    StreamEvent,
    StreamRateLowered,
    VehicleFound,
    VehicleRebooted,
)
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.mavlink.signing import Signing
from arva_hil.simulated.vehicle import SimulatedVehicle
from tests.every import every
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


class Stepped:
    """A session and a vehicle, joined in memory, and the clock in the test's hand."""

    def __init__(self, vehicle: SimulatedVehicle | Fake, **options: Any) -> None:
        self.vehicle = vehicle
        self.session = KeepingSession(**options)
        self.now = 0.0
        self.requests: list[tuple[float, Any]] = []
        self.events: list[Event] = []
        self._parser = Parser()

    def run(self, seconds: float) -> Stepped:
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
    bench = Stepped(SimulatedVehicle(HOME)).run(30)
    assert bench.asked() == ONCE
    assert all((m.target_system, m.target_component) == (1, 1) for _, m in bench.requests)
    assert bench.stream_events == []
    assert bench.session.navigation.home == pytest.approx(HOME)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("hz", [10.0, 50.0, 100.0])
def test_the_rate_wanted_is_there_within_two_seconds(hz: float, version: int) -> None:
    bench = Stepped(SimulatedVehicle(HOME, version=version), rate_hz=hz).run(2)
    assert bench.session.navigation.track.newest == pytest.approx(2.0, abs=1.1 / hz + 0.011)
    assert all(at < 0.5 for at, _ in bench.requests)
    bench.run(2)
    assert bench.rates() == pytest.approx((hz, hz), rel=0.05)


@pytest.mark.parametrize("attitude", [ATTITUDE, QUATERNION])
def test_streams_that_flow_fast_are_left_alone(attitude: int) -> None:
    bench = Stepped(SimulatedVehicle(HOME, streams={POSITION: 49, attitude: 40})).run(20)
    assert bench.asked() == {ASKED_HOME: 1}
    assert bench.rates() == pytest.approx((49, 40), rel=0.05)


def test_the_rate_of_a_stream_of_a_kilohertz_is_measured() -> None:
    streams = Streams(50.0, lambda *event: None)
    for n in range(3000):
        streams.on_message(dialect.MAVLINK_MSG_ID_ATTITUDE, n / 1000)
    assert streams.rates(3.0)["ATTITUDE"] == pytest.approx(1000, rel=0.01)


def test_only_the_slow_stream_is_asked_for() -> None:
    bench = Stepped(SimulatedVehicle(HOME, streams={POSITION: 10, QUATERNION: 50})).run(20)
    assert bench.asked() == {(SET_INTERVAL, POSITION): 1, ASKED_HOME: 1}
    assert bench.rates()[0] == pytest.approx(50, rel=0.05)


@pytest.mark.parametrize(("wanted", "denials"), [(400.0, 1), (1200.0, 2), (5000.0, 4)])
def test_a_rate_denied_is_halved_until_it_is_accepted(wanted: float, denials: int) -> None:
    bench = Stepped(SimulatedVehicle(HOME), rate_hz=wanted).run(5)
    asked = [m.param2 for _, m in bench.requests if m.to_dict().get("param1") == POSITION]
    assert asked == pytest.approx([1e6 / wanted * 2**i for i in range(denials + 1)])
    assert bench.rates() == pytest.approx((wanted / 2**denials,) * 2, rel=0.05)
    told = [event for event in bench.stream_events if isinstance(event, StreamRateLowered)]
    assert len(told) == len(bench.stream_events) == 2 * denials
    assert {event.result for event in told} == {"MAV_RESULT_DENIED"}
    assert {event.next_hz for event in told} == {wanted / 2 ** (n + 1) for n in range(denials)}


@pytest.mark.parametrize(
    ("answers", "requests", "result"),
    [((UNSUPPORTED,), 1, "MAV_RESULT_UNSUPPORTED"), ((FAILED,), 1, "MAV_RESULT_FAILED"), ((), 3, "")],
)
def test_a_vehicle_that_does_not_know_the_command_or_never_answers_is_asked_by_group(
    answers: tuple[int, ...], requests: int, result: str
) -> None:
    bench = Stepped(Fake(always(*answers), groups=True)).run(40)
    asked = bench.asked()
    assert (asked[SET_INTERVAL, POSITION], asked[SET_INTERVAL, ATTITUDE]) == (requests, requests)
    assert (asked["group", POSITION_GROUP], asked["group", ATTITUDE_GROUP]) == (1, 1)
    assert bench.rates() == pytest.approx((50, 50), rel=0.05)
    assert list(map(type, bench.stream_events)) == [StreamAskedOtherwise] * 2
    assert {(event.command, event.result) for event in bench.stream_events} == {("SET_MESSAGE_INTERVAL", result)}


@pytest.mark.parametrize("results", [(), (DENIED,), (REJECTED,), (ACCEPTED,)])
def test_when_nothing_helps_requests_grow_rare_and_it_is_said_once(results: tuple[int, ...]) -> None:
    """Of a vehicle that accepts, too: its streams come at 8 Hz whatever is asked."""
    bench = Stepped(Fake(always(*results), fastest=8), rate_hz=50).run(60)
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
    bench = Stepped(Fake(lambda m: [next(answers)] if m.command == SET_INTERVAL else [])).run(6)
    assert bench.rates() == pytest.approx((50, 50), rel=0.05)
    asked = bench.asked()
    assert asked[SET_INTERVAL, POSITION] + asked[SET_INTERVAL, ATTITUDE] == 4
    assert bench.stream_events == []


def test_in_progress_is_no_answer_yet() -> None:
    bench = Stepped(Fake(always(IN_PROGRESS, ACCEPTED))).run(5)
    assert bench.rates() == pytest.approx((50, 50), rel=0.05)
    assert bench.stream_events == []


@every("addressee", [(255, 190), (1, 190), (2, 191)])
def test_answers_to_others_are_not_ours(addressee: tuple[int, int]) -> None:
    bench = Stepped(Fake(always(DENIED), addressee=addressee)).run(5)
    assert bench.asked()[SET_INTERVAL, POSITION] == 2
    assert {m.param2 for _, m in bench.requests if m.command == SET_INTERVAL} == {20_000}
    assert bench.stream_events == []


def test_answers_to_other_commands_are_not_for_the_streams() -> None:
    bench = Stepped(Fake(lambda m: [DENIED] if m.command != SET_INTERVAL else [])).run(5)
    bench.session.feed(Encoder(1, 1).pack(dialect.MAVLink_command_ack_message(400, DENIED)), bench.now)
    bench.run(1)
    assert bench.asked()[SET_INTERVAL, POSITION] == 2
    assert bench.stream_events == []


def test_an_answer_to_everybody_is_ours_too() -> None:
    """MAVLink 1 has no addressee in an acknowledgement."""
    bench = Stepped(Fake(always(DENIED), addressee=(0, 0))).run(0.5)
    assert "MAV_RESULT_DENIED" in {event.result for event in bench.stream_events}


def lower(bench: Stepped) -> None:
    """Another client wants the position at 2 Hz."""
    request = dialect.MAVLink_command_long_message(1, 1, SET_INTERVAL, 0, POSITION, 500_000, 0, 0, 0, 0, 0)
    bench.vehicle.feed(Encoder(255, 190).pack(request), bench.now)


def test_a_stream_lowered_by_somebody_else_is_asked_for_again_each_time() -> None:
    bench = Stepped(SimulatedVehicle(HOME)).run(5)
    for _ in range(8):
        lower(bench)
        bench.run(5)
        assert bench.rates() == pytest.approx((50, 50), rel=0.05)
    assert bench.asked() == ONCE | {(SET_INTERVAL, POSITION): 9}
    assert bench.stream_events == []


def test_after_a_reboot_all_is_asked_for_again() -> None:
    vehicle = SimulatedVehicle(HOME)
    bench = Stepped(vehicle).run(20)
    vehicle.reboot(bench.now)
    bench.run(8)
    again = bench.asked(since=20.0)
    assert bench.session.navigation.reboots == 1
    assert {ASKED_HOME, (SET_INTERVAL, POSITION), (SET_INTERVAL, ATTITUDE)} == set(again)
    assert bench.rates() == pytest.approx((50, 50), rel=0.05)
    assert bench.session.navigation.home == pytest.approx(HOME)
    assert list(map(type, bench.events)) == [VehicleFound, VehicleRebooted]


def test_what_has_waited_during_a_stall_is_not_taken_for_a_rate() -> None:
    bench = Stepped(SimulatedVehicle(HOME)).run(5)
    bench.now += 7.0
    assert bench.run(0.5).rates() == pytest.approx((50, 50), rel=0.1)


def test_home_is_asked_for_until_it_is_known_by_two_commands_in_turn() -> None:
    bench = Stepped(SimulatedVehicle(HOME, fix_after=20.0)).run(19.9)
    asked = bench.asked()
    assert asked[ASKED_HOME] >= 3
    assert asked[GET_HOME, 0] >= 3
    bench.run(10)
    assert bench.session.navigation.home == pytest.approx(HOME)
    assert not {ASKED_HOME, (GET_HOME, 0)} & set(bench.asked(since=22.5))


def test_the_vehicles_answer_is_kept_for_a_person() -> None:
    streams = Stepped(Fake(always(REJECTED))).run(1).session.why_no_pose().streams
    assert ("GLOBAL_POSITION_INT", "MAV_RESULT_TEMPORARILY_REJECTED") in [(s.name, s.result) for s in streams]


@every("sent_hz, until", [(10.0, 7.3), (8.0, 7.3), (50.0, 12.0)])
def test_a_stream_that_stops_is_asked_for_as_soon_as_its_rate_is_too_low(sent_hz: float, until: float) -> None:
    """7 of 10 Hz are enough: 14 messages in two seconds. Nothing is asked for before, and no look comes too late."""
    streams, came, asked = Streams(10.0, lambda *event: None), list[float](), list[float]()
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


# -- Several senders on one link: which of them is the vehicle, and who gets answers ----------------------


QUADROTOR, GCS = dialect.MAV_TYPE_QUADROTOR, dialect.MAV_TYPE_GCS
PX4, NONE = dialect.MAV_AUTOPILOT_PX4, dialect.MAV_AUTOPILOT_INVALID
KEY = bytes(32)
HERE, THERE = ("127.0.0.1", 1), ("127.0.0.1", 2)


class Bench:
    """A session on a link with several senders; time passes only in `wait`."""

    def __init__(self, **options: Any) -> None:
        self.session = KeepingSession(**options)
        self.now = 100.0
        self.said: list[str] = []

    def send(self, sender: Any, *messages: Any, system: int = 1) -> list[Any]:
        encoder = Encoder(system, 1)
        own = []
        for message in messages:
            own += self.session.feed(encoder.pack(message), self.now, sender).own
        return own

    def wait(self, seconds: float, meanwhile: Callable[[], object] = lambda: None) -> None:
        """As the loop does, which looks ten times a second; `meanwhile` is what happens each time."""
        for _ in range(round(seconds * 10)):
            self.now += 0.1
            meanwhile()
            self.session.poll(self.now)

    @property
    def answered(self) -> list[Any]:
        senders = self.session.senders
        return senders.candidates if senders.vehicle is None else [senders.vehicle]

    @property
    def boot_ms(self) -> float:
        newest = self.session.navigation.track.newest
        return -1 if newest is None else round(newest * 1e3)


def heartbeat(kind: int = QUADROTOR, autopilot: int = PX4) -> Any:
    return dialect.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 3, 3)


def position(boot_ms: int) -> Any:
    return dialect.MAVLink_global_position_int_message(boot_ms, 460000000, 70000000, 500000, 0, 0, 0, 0, 0)


def attitude(boot_ms: int) -> Any:
    return dialect.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def signer(bench: Bench) -> Encoder:
    """Who has the key, and a clock that is right."""
    signing = Signing(KEY, 0)
    signing.advance(bench.now)
    return Encoder(1, 1, signing=signing)


@pytest.fixture
def bench() -> Bench:
    """A vehicle is followed that speaks from HERE."""
    made = Bench()
    made.send(HERE, heartbeat(), position(1000), attitude(1000))
    assert made.answered == [HERE]
    return made


@every("junk", [b"x", b"\xfd", b"\xfe\xff", Encoder(255, 190).pack(heartbeat(GCS, NONE))])
def test_who_speaks_first_but_no_autopilots_mavlink_keeps_no_vehicle_out(junk: bytes) -> None:
    bench = Bench()
    bench.session.feed(junk, bench.now, THERE)
    assert bench.answered == []
    bench.send(HERE, heartbeat())
    assert bench.session.vehicle is not None
    assert bench.answered == [HERE]


def test_bytes_of_two_senders_are_not_joined_in_a_packet(bench: Bench) -> None:
    raw = Encoder(1, 1).pack(position(1200))
    bench.session.feed(raw[:20], bench.now, HERE)
    bench.session.feed(b"\xfd\xff", bench.now, THERE)
    bench.session.feed(raw[20:], bench.now, HERE)
    bench.send(HERE, attitude(1200))
    assert bench.boot_ms == 1200
    assert bench.session.reader.parser.skipped == bench.session.reader.parser.bad_crc == 0


def test_ever_new_senders_cost_no_memory_and_no_packet_of_the_vehicle(bench: Bench) -> None:
    raw = Encoder(1, 1).pack(position(1200))
    bench.session.feed(raw[:20], bench.now, HERE)
    for port in range(10_000):
        bench.session.feed(b"\xfd\xff\x00", bench.now, ("10.0.0.1", port))
    bench.session.feed(raw[20:], bench.now, HERE)
    bench.send(HERE, attitude(1200))
    assert bench.boot_ms == 1200
    for parser in (bench.session.reader.parser, bench.session.reader._strangers):
        assert len(parser._rests) <= 8


def test_ten_thousand_senders_of_packets_are_not_all_answered() -> None:
    bench = Bench()
    for port in range(10_000):
        bench.send(("10.0.0.1", port), dialect.MAVLink_system_time_message(0, 0))
    assert len(bench.answered) == 8


def test_who_shows_itself_to_be_somebody_else_gets_no_answers() -> None:
    """A radio may need to be spoken to before it lets the vehicle's heartbeat pass; a ground station does not."""
    bench = Bench(target_system=2)
    bench.send("radio", dialect.MAVLink_radio_status_message(0, 0, 0, 0, 0, 0, 0), system=51)
    bench.send("station", dialect.MAVLink_system_time_message(0, 0), heartbeat(GCS, NONE), system=255)
    bench.send("another vehicle", heartbeat(), dialect.MAVLink_system_time_message(0, 0))
    assert bench.answered == ["radio"]


@pytest.mark.parametrize(("options", "followed"), [({}, HERE), ({"target_system": 2}, THERE)])
def test_two_vehicles_on_one_port_are_told_apart(options: dict[str, int], followed: Any) -> None:
    bench = Bench(**options)
    for boot_ms in range(1000, 9000, 100):
        bench.send(HERE, heartbeat(), position(boot_ms), attitude(boot_ms), system=1)
        bench.send(THERE, heartbeat(), position(boot_ms + 50), attitude(boot_ms + 50), system=2)
        bench.wait(0.1)
    assert bench.answered == [followed]
    assert bench.boot_ms == (8900 if followed == HERE else 8950)
    others = [event for event in bench.session.take_events() if isinstance(event, OtherAutopilotIgnored)]
    assert [(other.system, other.component, other.same_ids) for other in others] == ([] if options else [(2, 1, False)])


def test_another_vehicle_with_the_same_ids_changes_nothing_and_is_named_once(bench: Bench) -> None:
    bench.session.take_events()
    for _ in range(3):
        assert bench.send(THERE, heartbeat(), position(9000), attitude(9000)) == []
    assert bench.boot_ms == 1000
    assert bench.answered == [HERE]
    (event,) = bench.session.take_events()
    assert isinstance(event, OtherAutopilotIgnored)
    assert (event.system, event.component, event.same_ids) == (1, 1, True)


def test_a_ground_station_does_not_take_the_place_of_a_vehicle_that_pauses(bench: Bench) -> None:
    bench.wait(4.5, lambda: bench.send(THERE, heartbeat(GCS, NONE), system=255))
    assert bench.answered == [HERE]
    bench.send(HERE, heartbeat(), position(5600), attitude(5600))
    assert bench.boot_ms == 5600
    assert bench.answered == [HERE]


def test_a_restarted_simulator_comes_back_from_another_port_once_the_old_one_is_silent(bench: Bench) -> None:
    own = []

    def restarted() -> None:
        own[:] = bench.send(THERE, heartbeat(), position(500), attitude(500))

    bench.wait(2.8, restarted)
    assert bench.answered == [HERE]
    bench.wait(0.5, restarted)
    assert bench.answered == [THERE]
    assert own


def test_only_a_heartbeat_lets_another_sender_take_the_place_of_a_silent_one(bench: Bench) -> None:
    bench.wait(4.0, lambda: bench.send(THERE, position(9000), attitude(9000)))
    assert bench.answered == [HERE]
    assert bench.boot_ms == 1000


@pytest.mark.parametrize("first", [HERE, THERE])
def test_a_program_that_was_held_up_does_not_take_that_for_the_vehicles_silence(bench: Bench, first: Any) -> None:
    bench.now += 14.0
    for sender in (first, HERE if first == THERE else THERE):
        bench.send(sender, heartbeat())
    assert bench.answered == [HERE]


def test_a_lost_link_may_bring_the_vehicle_back_from_anywhere_at_once(bench: Bench) -> None:
    bench.session.interrupt("lost")
    bench.send(THERE, heartbeat())
    assert bench.answered == [THERE]
    bench.session.resume(bench.now)
    bench.send(HERE, heartbeat())
    assert bench.answered == [THERE]


def test_without_the_key_nobody_takes_a_silent_vehicles_place() -> None:
    bench = Bench(signing=Signing(KEY, 0))
    signs = signer(bench)
    bench.session.feed(signs.pack(heartbeat()), bench.now, HERE)
    bench.wait(4.0, lambda: bench.send(THERE, heartbeat()))
    assert bench.answered == [HERE]
    bench.session.feed(signs.pack(heartbeat()), bench.now, THERE)
    assert bench.answered == [THERE]


def test_copies_of_signed_packets_from_elsewhere_cost_the_vehicle_none_of_its_own() -> None:
    bench = Bench(signing=Signing(KEY, 0))
    signs = signer(bench)
    bench.session.feed(signs.pack(heartbeat()), bench.now, HERE)
    for message in (heartbeat(), position(2000), attitude(2000)):
        raw = signs.pack(message)
        for sender in (THERE, HERE):
            bench.session.feed(raw, bench.now, sender)
    assert bench.boot_ms == 2000
    assert bench.session.disbelieved_signatures() == {"unsigned": 0, "forged": 0, "replayed": 0}


def test_a_sender_that_is_cut_short_loses_only_its_own_rest() -> None:
    parser = Parser()
    raw = Encoder(1, 1).pack(heartbeat())
    for sender in range(9):
        assert parser.feed(raw[:10], sender) == []
    assert [len(parser.feed(raw[10:], sender)) for sender in range(1, 9)] == [1] * 8
    assert parser.feed(raw[10:], 0) == []


# -- What an autopilot says of itself, whole or in chunks -------------------------------------------------


WORDS = st.text("abc :_-", min_size=1, max_size=170).filter(lambda text: text == text.strip())


def said_by(messages: Iterable[Any]) -> list[str]:
    """The texts that these messages complete."""
    texts = Complaints()
    return [text for message in messages if (text := texts.on_text(message))]


def chunks(text: str, id_: int) -> list[Any]:
    """As they are decoded; a text that fills its last chunk is ended by an empty one."""
    encoder, parser = Encoder(1, 1), Parser()
    raw = text.encode()
    messages = [
        dialect.MAVLink_statustext_message(4, raw[at : at + 50], id_, seq)
        for seq, at in enumerate(range(0, len(raw) + 1, 50))
    ]
    return [decode(packet) for message in messages for packet in parser.feed(encoder.pack(message))]


@given(st.lists(WORDS, min_size=1, max_size=4, unique=True), st.randoms())
def test_chunks_of_several_texts_may_come_mixed(said: list[str], random: Any) -> None:
    waiting = [chunks(text, id_) for id_, text in enumerate(said, 1)]
    mixed = []
    while waiting:
        mixed.append(random.choice(waiting).pop(0))
        waiting = [rest for rest in waiting if rest]
    assert sorted(said_by(mixed)) == sorted(said)


def test_a_short_text_comes_at_once_and_only_once() -> None:
    assert said_by(chunks("PreArm: no", id_)[0] for id_ in (0, 0, 5)) == ["PreArm: no"]


def test_the_last_four_are_remembered() -> None:
    texts = Complaints()
    assert all(texts.on_text(chunks(f"text {n}", 0)[0]) for n in range(9))
    assert texts.recent == ["text 5", "text 6", "text 7", "text 8"]


@pytest.mark.parametrize(("lost", "text"), [(0, "…" + "b" * 50 + "c"), (1, "a" * 50 + "…c")])
def test_a_lost_chunk_is_marked(lost: int, text: str) -> None:
    came = [chunk for seq, chunk in enumerate(chunks("a" * 50 + "b" * 50 + "c", 3)) if seq != lost]
    assert said_by(came) == [text]


def test_a_text_without_its_end_is_not_mixed_with_the_next_of_its_number() -> None:
    assert said_by([chunks("a" * 60, 3)[0], *chunks("b" * 60, 3)]) == ["b" * 60]


def test_texts_without_an_end_do_not_pile_up() -> None:
    texts = Complaints()
    for id_ in range(1, 1000):
        texts.on_text(chunks("a" * 60, id_)[0])
    assert len(texts._open) < 20
    assert [texts.on_text(chunk) for chunk in chunks("b" * 60, 2000)] == ["", "b" * 60]


def test_an_empty_text_is_none() -> None:
    assert said_by([chunks("", 0)[0], chunks("   ", 1)[0]]) == []


@every(
    "enabled, health, names",
    [
        (0xFFFF, 0xFFFF, []),
        (dialect.MAV_SYS_STATUS_SENSOR_GPS, 0, ["gps"]),
        (0, 0, []),
        (dialect.MAV_SYS_STATUS_PREARM_CHECK | 1, 1, ["prearm check"]),
        (dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER | 32, 0xF, ["gps", "rc receiver"]),
    ],
)
def test_sys_status_in_words(enabled: int, health: int, names: list[str]) -> None:
    assert unwell(dialect.MAVLink_sys_status_message(0, enabled, health, *[0] * 10)) == names


def test_every_bit_is_survived() -> None:
    message = dialect.MAVLink_sys_status_message(0, 2**32 - 1, 0, *[0] * 10)
    assert len(set(unwell(message))) > 20
