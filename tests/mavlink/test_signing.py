"""MAVLink 2 signing: who is believed, and what others make of what we sign."""

from __future__ import annotations

import hashlib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.events.vehicles import SignatureRefused, SignaturesUnchecked, VehicleFound
from arva_hil.mavlink.codec import Encoder, Packet, Parser, dialect
from arva_hil.mavlink.signing import Signing, key_of
from tests.every import every
from tests.kept_events import KeepingSession

KEY, OTHER_KEY = bytes(range(32)), bytes(32)
NOW_US = 1_700_000_000_000_000  # since 1970
TICKS = (NOW_US - 1_420_070_400_000_000) // 10  # since 2015
MINUTE = 6_000_000


def heartbeat(armed: bool = False) -> Any:
    return dialect.MAVLink_heartbeat_message(2, 3, 128 if armed else 0, 0, 3, 3)


class Vehicle:
    """Signs as pymavlink does."""

    def __init__(self, key: bytes | None = KEY, ticks: int = TICKS, link: int = 0) -> None:
        self.codec = dialect.MAVLink(None, 1, 1)
        self.codec.signing.secret_key = key
        self.codec.signing.sign_outgoing = key is not None
        self.codec.signing.timestamp = ticks
        self.codec.signing.link_id = link

    def says(self, message: Any) -> bytes:
        return bytes(message.pack(self.codec))


def packet(raw: bytes) -> Packet:
    (found,) = Parser().feed(raw)
    return found


def signed_session(**options: Any) -> KeepingSession:
    return KeepingSession(signing=Signing(KEY, NOW_US), **options)


# -- the key -----------------------------------------------------------------------------------------------


def test_64_hexadecimal_digits_are_the_key() -> None:
    assert key_of(KEY.hex() + "\n") == key_of(KEY.hex().upper()) == KEY


@every("phrase", ["correct horse", "a", "ключ", KEY.hex()[:-1], KEY.hex() + "0", "g" * 64])
def test_other_text_is_a_passphrase_of_which_the_key_is_the_hash(phrase: str) -> None:
    assert key_of(phrase + "\n") == key_of(phrase) == hashlib.sha256(phrase.encode()).digest()


@every("text", ["", "\n", "  \n", "one\ntwo\n", "one\n\n"])
def test_no_line_or_several_are_no_key(text: str) -> None:
    with pytest.raises(ValueError, match=r"lines|empty"):
        key_of(text)


# -- who is believed ---------------------------------------------------------------------------------------


def test_the_vehicle_that_has_the_key_is_followed_and_no_other() -> None:
    session = signed_session()
    for key in (None, OTHER_KEY):
        session.feed(Vehicle(key).says(heartbeat()), 0.0)
        assert session.vehicle is None
    received = session.feed(Vehicle().says(heartbeat()), 0.1)
    assert session.vehicle is not None
    before = session.counts()
    assert (before["packets_unsigned"], before["packets_forged"], before["packets_replayed"]) == (1, 1, 0)
    assert len(received.own) == 1
    for key in (None, OTHER_KEY):
        received = session.feed(Vehicle(key).says(heartbeat(armed=True)), 0.2)
        assert (received.own, len(received.refused)) == ([], 1)
    assert not session.vehicle.armed
    unsigned, forged, found = session.take_events()
    assert isinstance(unsigned, SignatureRefused)
    assert isinstance(forged, SignatureRefused)
    assert isinstance(found, VehicleFound)
    assert (unsigned.verdict, forged.verdict, found.signed) == ("unsigned", "forged", True)


def test_mavlink_1_cannot_be_signed_and_is_not_believed() -> None:
    session = signed_session()
    session.feed(Encoder(1, 1, version=1).pack(heartbeat()), 0.0)
    assert session.vehicle is None
    assert session.counts()["packets_unsigned"] == 1


@given(st.data())
def test_a_signed_packet_with_any_bit_turned_is_not_believed(data: st.DataObject) -> None:
    raw = bytearray(Vehicle().says(heartbeat(armed=True)))
    at = data.draw(st.integers(0, len(raw) * 8 - 1))
    raw[at // 8] ^= 1 << at % 8
    session = signed_session()
    session.feed(bytes(raw), 0.0)
    session.feed(bytes(300), 0.0)
    assert session.vehicle is None


def test_a_packet_is_believed_once() -> None:
    session = signed_session()
    vehicle = Vehicle()
    disarmed, armed, disarmed_again = (vehicle.says(heartbeat(arm)) for arm in (False, True, False))
    for raw in (disarmed, armed, disarmed_again, armed, disarmed, armed):
        session.feed(raw, 1.0)
    assert not session.vehicle.armed
    assert session.counts()["packets_replayed"] == 3
    assert "replayed" in [event.verdict for event in session.take_events() if isinstance(event, SignatureRefused)]


@every(
    "ticks, believed",
    [(TICKS - MINUTE - 1, False), (TICKS - MINUTE, True), (TICKS, True), (TICKS + 10**12, True), (0, False)],
)
def test_a_stream_not_heard_before_may_be_a_minute_behind(ticks: int, believed: bool) -> None:
    session = signed_session()
    session.feed(Vehicle(ticks=ticks).says(heartbeat()), 0.0)
    assert (session.vehicle is not None) is believed


def test_every_link_of_a_vehicle_has_a_time_of_its_own() -> None:
    session = signed_session()
    ahead, behind = Vehicle(ticks=TICKS + 1000, link=1), Vehicle(ticks=TICKS, link=2)
    for vehicle in (ahead, behind, ahead, behind):
        session.feed(vehicle.says(heartbeat()), 0.0)
    assert session.counts()["packets_replayed"] == 0


def test_a_vehicle_whose_clock_is_behind_is_believed_once_it_has_heard_us() -> None:
    """An autopilot without a fix has no time of its own: it takes what it is told by who has the key."""
    session, vehicle = signed_session(), Vehicle(ticks=5)
    vehicle.codec.robust_parsing = True
    session.feed(vehicle.says(heartbeat()), 0.0)
    assert session.vehicle is None
    heard = session.why_no_vehicle()
    assert (heard.reason, dict(heard.refused)) == ("no signature", {"unsigned": 0, "forged": 0, "replayed": 1})
    vehicle.codec.parse_buffer(bytearray(session.poll(0.1)[0]))
    session.feed(vehicle.says(heartbeat()), 0.2)
    assert session.vehicle is not None


# -- what is said ------------------------------------------------------------------------------------------


def test_all_that_goes_out_is_signed_as_pymavlink_wants_it() -> None:
    session, vehicle = signed_session(), Vehicle()
    session.feed(vehicle.says(heartbeat()), 0.0)
    said = b"".join(session.poll(i / 10)[0] for i in range(50))
    assert said
    heard = vehicle.codec.parse_buffer(bytearray(said))
    assert {m.get_type() for m in heard} >= {"HEARTBEAT", "COMMAND_LONG"}
    assert len(heard) == len(Parser().feed(said)) == vehicle.codec.signing.sig_count


def test_two_programs_that_speak_as_one_component_are_told_apart() -> None:
    """Where the vehicle's clock is ahead both take its time, and neither's stamps may hinder the other's."""
    vehicle = Vehicle(ticks=TICKS + 10**9)
    ours = [KeepingSession(signing=Signing(KEY, NOW_US, link)) for link in (0, 1)]
    hello = vehicle.says(heartbeat())
    for session in ours:
        session.feed(hello, 0.0)
    said = [session.poll(now)[0] for now in (0.0, 1.0, 2.0) for session in ours]
    assert sum(len(vehicle.codec.parse_buffer(bytearray(one)) or ()) for one in said) >= 6
    assert vehicle.codec.signing.reject_count == 0


def test_stamps_keep_up_with_the_clock_and_never_go_back() -> None:
    signing = Signing(KEY, NOW_US)
    stamps = []
    for now in (0.0, 0.0, 0.5, 0.4, 60.0):
        signing.advance(now)
        stamps += [signing.stamp() for _ in range(3)]
    assert stamps == sorted(set(stamps))
    assert stamps[0] == TICKS + 1
    assert stamps[-1] - (TICKS + 60 * 100_000) in range(10)


def test_a_clock_that_is_behind_takes_the_vehicles_time() -> None:
    """A companion computer without a battery for its clock believes that it is 1970."""
    session = KeepingSession(signing=Signing(KEY, 5_000_000))
    session.feed(Vehicle().says(heartbeat()), 0.0)
    assert session.vehicle is not None
    (said, *_) = Parser().feed(session.poll(0.1)[0])
    assert int.from_bytes(said.raw[-12:-6], "little") > TICKS


# -- without a key -----------------------------------------------------------------------------------------


def test_without_a_key_signed_packets_are_read_and_it_is_said_so() -> None:
    session = KeepingSession()
    session.feed(Vehicle().says(heartbeat()), 0.0)
    assert session.vehicle is not None
    assert list(map(type, session.take_events())) == [VehicleFound, SignaturesUnchecked]
    assert not any(p.signed for p in Parser().feed(session.poll(0.0)[0]))


def test_in_a_log_signed_packets_are_read_without_a_word_about_keys() -> None:
    session = KeepingSession(passive=True)
    session.feed(Vehicle().says(heartbeat()), 0.0)
    assert list(map(type, session.take_events())) == [VehicleFound]
