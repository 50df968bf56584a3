"""Several senders on one link: which of them is the vehicle, and who gets answers."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.autopilot.commanding.complaints import Complaints, unwell
from arva_hil.events.vehicles import OtherAutopilotIgnored
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.mavlink.signing import Signing
from tests.kept_events import KeepingSession

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


@pytest.mark.parametrize("junk", [b"x", b"\xfd", b"\xfe\xff", Encoder(255, 190).pack(heartbeat(GCS, NONE))])
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


@pytest.mark.parametrize(
    ("enabled", "health", "names"),
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
