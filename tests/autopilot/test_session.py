"""The session: which vehicle is followed, what it may say, and what is said to it."""

from __future__ import annotations

import math
import random
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.generator.mavcrc import x25crc

from arva_hil.events import Event
from arva_hil.events.reasons import NoPose, NoVehicle
from arva_hil.events.vehicles import (
    ClockLeapt,
    OtherAutopilotIgnored,
    PositionJumped,
    VehicleBack,
    VehicleFound,
    VehicleLost,
    VehicleRebooted,
)
from arva_hil.events.words.reasons import no_vehicle
from arva_hil.links.tlog import TlogReader
from arva_hil.mavlink.codec import Encoder, Packet, Parser, decode, dialect
from arva_hil.model.field import LocalFrame
from tests.every import every
from tests.kept_events import KeepingSession
from tools.fuzz.autopilot import BURST, KEY, Bench, Enemy, unsigned

HOME = (46.5, 11.35, 1800.0)
FRAME = LocalFrame(*HOME)
IDS = st.integers(0, 255)
OTHERS = st.one_of(  # than 1/1
    st.tuples(IDS, IDS), st.tuples(st.just(1), IDS), st.tuples(IDS, st.just(1))
).filter(lambda source: source != (1, 1))
NAN = math.nan
QUADROTOR, GCS, GIMBAL, COMPANION = (
    dialect.MAV_TYPE_QUADROTOR,
    dialect.MAV_TYPE_GCS,
    dialect.MAV_TYPE_GIMBAL,
    dialect.MAV_TYPE_ONBOARD_CONTROLLER,
)
ARDUPILOT, NONE = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, dialect.MAV_AUTOPILOT_INVALID
SET_INTERVAL, DENIED = dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAV_RESULT_DENIED


def heartbeat(kind: int = QUADROTOR, autopilot: int = ARDUPILOT, *, armed: bool = False) -> Any:
    return dialect.MAVLink_heartbeat_message(kind, autopilot, 128 if armed else 0, 0, 3, 3)


def position(boot: float, lat: float = HOME[0], lon: float = HOME[1], alt: float = HOME[2]) -> Any:
    where = round(lat * 1e7), round(lon * 1e7), round(alt * 1e3)
    return dialect.MAVLink_global_position_int_message(round(boot * 1e3), *where, 0, 100, -200, 50, 0)


def attitude(boot: float, *values: float) -> Any:
    return dialect.MAVLink_attitude_message(round(boot * 1e3), *(values or (0.1, 0.2, 0.3, 0.0, 0.0, 0.0)))


def quaternion(boot: float, *values: float) -> Any:
    return dialect.MAVLink_attitude_quaternion_message(round(boot * 1e3), *values)


def home(lat: float = HOME[0], lon: float = HOME[1], alt: float = HOME[2]) -> Any:
    where = round(lat * 1e7), round(lon * 1e7), round(alt * 1e3)
    return dialect.MAVLink_home_position_message(*where, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)


def ack(command: int, result: int, target: tuple[int, int] = (0, 0)) -> Any:
    return dialect.MAVLink_command_ack_message(command, result, 0, 0, *target)


def tell(session: KeepingSession, message: Any, now: float, source: tuple[int, int] = (1, 1), version: int = 2) -> None:
    session.feed(Encoder(*source, version).pack(message), now)


def hearing(now: float, *messages: Any, source: tuple[int, int] = (1, 1), **options: Any) -> KeepingSession:
    """A session that was told these messages."""
    session = KeepingSession(**options)
    for message in messages:
        tell(session, message, now, source)
    return session


def following(now: float = 100.0, source: tuple[int, int] = (1, 1), **options: Any) -> KeepingSession:
    """A session that has a vehicle and all that it can know of it; boot time is 90 s behind."""
    known = heartbeat(), position(now - 90), attitude(now - 90), home()
    session = hearing(now, *known, source=source, **options)
    assert session.vehicle is not None
    session.take_events()
    return session


@pytest.fixture
def session() -> KeepingSession:
    return following(100.0)


def knowledge(session: KeepingSession, now: float) -> str:
    """All that a session tells about its vehicle."""
    known = (
        session.vehicle,
        session.navigation.home,
        session.navigation.track.newest,
        next(iter(session.navigation.track.positions), None),
        session.navigation.reboots,
    )
    counts = (
        session.navigation.refused,
        session.navigation.unpositioned,
        session.rates(now),
        session.navigation.clock.boot(now),
    )
    return repr((known, counts, session.navigation.state_at(now, FRAME)))


def packets(data: bytes) -> list[Packet]:
    found = Parser().feed(data)
    assert sum(len(p.raw) for p in found) == len(data)
    return found


# -- which vehicle -----------------------------------------------------------------------------------------


@every(
    "source, kind, autopilot",
    [
        ((255, 190), GCS, NONE),
        ((1, 1), GCS, NONE),
        ((255, 1), GCS, ARDUPILOT),
        ((1, 154), GIMBAL, NONE),
        ((1, 1), GIMBAL, ARDUPILOT),
        ((1, 191), COMPANION, NONE),
        ((1, 1), COMPANION, ARDUPILOT),
        ((1, 100), dialect.MAV_TYPE_CAMERA, NONE),
        ((1, 156), dialect.MAV_TYPE_ADSB, NONE),
        ((1, 1), dialect.MAV_TYPE_ANTENNA_TRACKER, ARDUPILOT),
        ((1, 1), QUADROTOR, NONE),
        ((1, 2), QUADROTOR, ARDUPILOT),
        ((0, 1), QUADROTOR, ARDUPILOT),
    ],
)
def test_these_are_no_vehicle(source: tuple[int, int], kind: int, autopilot: int) -> None:
    session = KeepingSession()
    tell(session, heartbeat(kind, autopilot), 0.0, source)
    assert session.vehicle is None
    tell(session, heartbeat(), 1.0, (9, 1))
    assert session.vehicle.system == 9


@given(st.integers(1, 255), st.integers(0, 40).filter(lambda k: k not in (GCS, GIMBAL, COMPANION, 5, 27, 30)))
def test_the_first_autopilot_is_the_vehicle(system: int, kind: int) -> None:
    session = KeepingSession()
    tell(session, heartbeat(kind), 0.0, (system, 1))
    vehicle = session.vehicle
    assert (vehicle.system, vehicle.component, vehicle.kind, vehicle.autopilot) == (system, 1, kind, ARDUPILOT)
    assert not vehicle.armed
    (event,) = session.take_events()
    assert isinstance(event, VehicleFound)
    assert event.label.endswith(f"{system}/1")


@every(
    "options, chosen",
    [
        ({}, (1, 1)),
        ({"target_system": 2}, (2, 1)),
        ({"target_component": 2}, (1, 2)),
        ({"target_system": 2, "target_component": 2}, (2, 2)),
        ({"target_system": 3}, None),
    ],
)
def test_the_target_can_be_chosen(options: dict[str, int], chosen: tuple[int, int] | None) -> None:
    session = KeepingSession(**options)
    for source in ((1, 1), (1, 2), (2, 1), (2, 2), (1, 1)):
        tell(session, heartbeat(), 0.0, source)
    vehicle = session.vehicle
    assert (vehicle and (vehicle.system, vehicle.component)) == chosen


def test_the_chosen_one_is_obeyed() -> None:
    session = following(100.0, (7, 1))
    tell(session, heartbeat(armed=True), 101.0, (7, 1))
    assert session.vehicle.armed
    assert session.navigation.home == HOME
    state = session.navigation.state_at(100.0, FRAME)
    assert state.boot_s == pytest.approx(10.0)
    np.testing.assert_allclose(state.position, 0, atol=0.01)
    np.testing.assert_allclose(state.velocity, [1.0, -2.0, 0.5])
    tell(session, heartbeat(), 102.0, (7, 1))
    assert not session.vehicle.armed
    assert session.ignored == session.navigation.refused == 0


@given(OTHERS, st.sampled_from([{}, {"target_system": 1}]))
def test_what_anybody_else_says_changes_nothing_and_is_counted(
    source: tuple[int, int], options: dict[str, int]
) -> None:
    session = following(**options)
    request = session.poll(101.0)[0]
    assert any(p.msgid == dialect.MAVLINK_MSG_ID_COMMAND_LONG for p in packets(request))
    before = knowledge(session, 101.0)
    strange = [
        position(0.1),
        position(99.0, 10.0, 10.0),
        attitude(99.0),
        quaternion(99.0, 1, 0, 0, 0, 0, 0, 0),
        quaternion(99.0, 0, 0, 0, 0, 0, 0, 0),
        home(10.0, 10.0),
        ack(SET_INTERVAL, DENIED),
        ack(SET_INTERVAL, DENIED, (1, 191)),
        heartbeat(armed=True),
        heartbeat(GCS, NONE, armed=True),
    ]
    for message in strange:
        tell(session, message, 101.0, source)
    assert knowledge(session, 101.0) == before
    assert session.ignored == len(strange)
    assert {type(event) for event in session.take_events()} <= {OtherAutopilotIgnored}


def test_another_autopilot_is_named_once() -> None:
    session = following()
    for _ in range(5):
        tell(session, heartbeat(), 101.0, (2, 1))
    (event,) = session.take_events()
    assert isinstance(event, OtherAutopilotIgnored)
    assert (event.system, event.component, event.same_ids) == (2, 1, False)


def test_anothers_heartbeats_do_not_keep_the_vehicle_alive(session: KeepingSession) -> None:
    for i in range(10):
        tell(session, heartbeat(), 101.0 + i, (2, 1))
        tell(session, heartbeat(GCS, NONE), 101.0 + i, (255, 190))
    session.poll(110.0)
    assert VehicleLost in map(type, session.take_events())


def test_the_vehicles_own_packets_are_those_it_sent_and_is_believed_in(session: KeepingSession) -> None:
    own = [heartbeat(), attitude(11.0), ack(SET_INTERVAL, DENIED, (255, 190)), position(11.0)]
    mixed = b""
    for message in own:
        mixed += Encoder(1, 1).pack(message) + Encoder(1, 2).pack(message) + Encoder(1, 1).pack(heartbeat(GCS, NONE))
    received = session.feed(mixed, 101.0)
    assert [packet.raw for packet in received.own] == [Encoder(1, 1).pack(message) for message in own]
    assert len(received.others) == 8


# -- what is no pose ---------------------------------------------------------------------------------------

ODD = {
    "NaN roll": attitude(11.0, NAN, 0, 0, 0, 0, 0),
    "NaN yaw rate": attitude(11.0, 0, 0, 0, 0, 0, NAN),
    "infinite pitch": attitude(11.0, 0, math.inf, 0, 0, 0, 0),
    "infinities that cancel": attitude(11.0, math.inf, -math.inf, 0, 0, 0, 0),
    "quaternion of zeros": quaternion(11.0, 0, 0, 0, 0, 0, 0, 0),
    "NaN quaternion": quaternion(11.0, NAN, NAN, NAN, NAN, 0, 0, 0),
    "long quaternion": quaternion(11.0, 2, 0, 0, 0, 0, 0, 0),
    "quaternion with NaN rate": quaternion(11.0, 1, 0, 0, 0, NAN, 0, 0),
    "latitude": position(11.0, lat=90.1),
    "south": position(11.0, lat=-90.1),
    "longitude": position(11.0, lon=180.1),
    "west": position(11.0, lon=-180.1),
    "far above": position(11.0, alt=100_001.0),
    "far below": position(11.0, alt=-1_001.0),
    "many turns": attitude(11.0, 0, 0, 8.0, 0, 0, 0),
    "a giant angle": attitude(11.0, 1e30, 0, 0, 0, 0, 0),
    "a spin": attitude(11.0, 0, 0, 0, 0, 0, -101.0),
    "quaternion with a spin": quaternion(11.0, 1, 0, 0, 0, 0, 1e20, 0),
    "home in space": home(alt=200_000.0),
    "home of zeros": home(0.0, 0.0, 0.0),
    "home's latitude": home(lat=91.0),
    "home's longitude": home(lon=-181.0),
}


@every("message", ODD.values())
def test_values_that_are_no_pose_are_refused_and_counted(message: Any) -> None:
    session = following()
    before = session.navigation.state_at(101.0, FRAME)
    tell(session, message, 101.0)
    after = session.navigation.state_at(101.0, FRAME)
    assert session.navigation.refused == 1
    assert repr(after) == repr(before)
    assert session.navigation.home == HOME


def test_zero_latitude_and_longitude_are_no_position() -> None:
    session = hearing(100.0, heartbeat(), attitude(10.0), position(10.0, 0.0, 0.0, 0.0))
    assert not session.navigation.track.positions
    assert session.navigation.state_at(100.0, FRAME) is None
    assert (session.navigation.unpositioned, session.navigation.refused) == (1, 0)


@every("lat, lon", [(0.0, 11.0), (46.0, 0.0), (90.0, 180.0), (-90.0, -180.0)])
def test_a_place_on_the_equator_or_the_edge_is_a_position(lat: float, lon: float) -> None:
    session = hearing(100.0, heartbeat(), position(10.0, lat, lon))
    assert session.navigation.track.positions
    assert session.navigation.refused == session.navigation.unpositioned == 0


def test_an_unknown_message_is_counted_as_a_packet_and_changes_nothing() -> None:
    session = following()
    before = knowledge(session, 101.0)
    count = session.reader.parser.packets
    (found,) = session.feed(b"\xfd\x03\x00\x00\x00\x01\x01\x9f\x86\x01abc\x12\x34", 101.0).own
    assert not found.known
    assert session.reader.parser.packets == count + 1
    assert knowledge(session, 101.0) == before


HANDLED = [0, 30, 31, 33, 77, 242]


@given(st.lists(st.tuples(st.sampled_from(HANDLED), st.binary(max_size=60)), max_size=8))
def test_no_values_of_the_vehicle_make_it_raise(said: list[tuple[int, bytes]]) -> None:
    session = following()
    for i, (msgid, payload) in enumerate(said):
        now = 101.0 + i
        head = bytes([len(payload), 0, 0, 0, 1, 1]) + msgid.to_bytes(3, "little")
        crc = x25crc(head + payload + bytes([dialect.mavlink_map[msgid].crc_extra])).crc
        assert len(session.feed(b"\xfd" + head + payload + crc.to_bytes(2, "little"), now).accepted) == 1
        session.poll(now)
        state = session.navigation.state_at(now, FRAME)
        assert state is None or (np.isfinite(state.position).all() and np.isfinite(state.attitude).all())


# -- reboot ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("message", [position, attitude])
@pytest.mark.parametrize(("back", "rebooted"), [(0.2, 0), (0.49, 0), (0.51, 1), (9.9, 1)])
def test_time_that_goes_back_for_good_is_a_reboot(
    session: KeepingSession, message: Any, back: float, rebooted: int
) -> None:
    tell(session, message(10.0 - back), 100.6)
    tell(session, message(10.005 - back), 100.62)
    assert session.navigation.reboots == rebooted
    if rebooted:
        assert session.navigation.home is None
        assert session.navigation.track.newest is None
        assert session.navigation.state_at(100.62, FRAME) is None
        assert session.navigation.clock.boot(100.62) == pytest.approx(10.005 - back)
        assert list(map(type, session.take_events())) == [VehicleRebooted]
    else:
        assert session.navigation.home == HOME
        assert session.navigation.track.newest == 10.0
        assert session.take_events() == []


def test_a_reboot_is_reckoned_from_the_newest_time_heard(session: KeepingSession) -> None:
    for back in (0.2, 0.45, 0.3):
        tell(session, attitude(10.0 - back), 100.1)
    assert session.navigation.reboots == 0
    for now in (100.7, 100.8):
        tell(session, attitude(10.0 - 0.6), now)
    assert session.navigation.reboots == 1


@pytest.mark.parametrize("stray", [0.0, 3.0, 9.4, 25.0, 1000.0, 4294967.0])
def test_one_time_out_of_line_changes_nothing_and_is_counted(session: KeepingSession, stray: float) -> None:
    before = session.navigation.state_at(100.02, FRAME)
    for message in (attitude, position, attitude):
        tell(session, message(stray), 100.02)
        assert repr(session.navigation.state_at(100.02, FRAME)) == repr(before)
        tell(session, attitude(10.0), 100.02)
    assert session.navigation.times.strays == 3
    assert session.navigation.reboots == 0
    assert session.take_events() == []


@pytest.mark.parametrize("ahead", [41.0, 447.0])
def test_a_time_that_leaps_ahead_for_good_is_no_reboot(session: KeepingSession, ahead: float) -> None:
    """A radio that first delivers what it had in its buffer."""
    far = (HOME[0] + 0.01, *HOME[1:])  # where it has flown meanwhile
    for i in range(60):
        now = 0.02 * i
        tell(session, attitude(10.0 + ahead + now), 100.0 + now)
        tell(session, position(10.0 + ahead + now, *far), 100.0 + now)
        state = session.navigation.state_at(100.0 + now, FRAME)
        assert abs(state.position[0] - (1111.9 if now >= 0.5 else now)) < 2
    assert session.navigation.home == HOME
    assert session.navigation.clock.boot(101.2) == pytest.approx(11.2 + ahead)
    counts = session.counts()
    assert (counts["reboots"], counts["clock_leaps"], counts["position_jumps"]) == (0, 1, 0)
    (event,) = session.take_events()
    assert isinstance(event, ClockLeapt)
    assert event.ahead_s == pytest.approx(ahead + 0.52, abs=0.5)


@pytest.mark.parametrize("other", [2.0, 5000.0])
def test_of_two_clocks_at_once_the_first_is_believed(session: KeepingSession, other: float) -> None:
    """Another device with the vehicle's ids on the same link, as lively as the vehicle."""
    for i in range(500):
        now = 0.02 * i
        tell(session, attitude(10.0 + now), 100.0 + now)
        for late in (0.005, 0.01):
            tell(session, attitude(other + now + late), 100.0 + now + late)
    assert session.navigation.reboots == 0
    assert session.navigation.times.strays == 1000
    assert session.navigation.clock.boot(110.0) == pytest.approx(20.0)


def test_after_a_reboot_there_is_a_pose_again(session: KeepingSession) -> None:
    for message in (attitude(0.28), position(0.3), attitude(0.3), home(46.6)):
        tell(session, message, 101.0)
    assert session.navigation.state_at(101.1, FRAME).boot_s == pytest.approx(0.4)
    assert session.navigation.home == (46.6, HOME[1], HOME[2])
    assert session.navigation.reboots == 1


# -- a position that jumps ---------------------------------------------------------------------------------

NEAR, FAR = (HOME[0] + 0.0005, *HOME[1:]), (HOME[0] + 0.05, *HOME[1:])  # 56 m, 5.6 km north


def northing(session: KeepingSession, now: float) -> float:
    return float(session.navigation.state_at(now, FRAME).position[0])


@pytest.mark.parametrize("stray", [FAR, (HOME[0], HOME[1] - 0.05, HOME[2]), (*HOME[:2], HOME[2] + 5000)])
def test_one_position_far_off_changes_nothing_and_is_counted(
    session: KeepingSession, stray: tuple[float, float, float]
) -> None:
    tell(session, position(10.02, *stray), 100.02)
    assert session.navigation.places.strays == 1
    assert abs(northing(session, 100.02)) < 1
    tell(session, position(10.04), 100.04)
    assert session.navigation.places.strays == 1
    assert abs(northing(session, 100.04)) < 1
    assert session.take_events() == []


def test_an_estimator_may_correct_itself_by_some_metres(session: KeepingSession) -> None:
    tell(session, position(10.02, *NEAR), 100.02)
    assert northing(session, 100.02) == pytest.approx(55.6, abs=0.1)
    assert session.navigation.places.strays == 0


def test_a_position_that_stays_far_off_is_believed_after_half_a_second(session: KeepingSession) -> None:
    """A simulator that was moved, or an estimator that was badly wrong."""
    for i in range(1, 30):
        now = 0.02 * i
        tell(session, position(10.0 + now, *FAR), 100.0 + now)
        assert (northing(session, 100.0 + now) > 5000) == (now >= 0.5)
    assert session.navigation.places.strays == 24
    (event,) = session.take_events()
    assert isinstance(event, PositionJumped)
    assert event.by_m == pytest.approx(5566, abs=0.5)
    assert session.counts()["position_jumps"] == 1


def test_between_the_two_sides_of_a_jump_there_is_no_pose(session: KeepingSession) -> None:
    for i in range(1, 30):
        now = 0.02 * i
        tell(session, attitude(10.0 + now), 100.0 + now)
        tell(session, position(10.0 + now, *FAR), 100.0 + now)
    norths = [session.navigation.state_at(99.9 + 0.005 * i, FRAME) for i in range(160)]
    assert all(state is None or state.position[0] > 5500 for state in norths)
    assert norths[-1] is not None


# -- the vehicle's own ids from somebody else ---------------------------------------------------------------


@pytest.mark.parametrize(("kind", "autopilot"), [(GCS, NONE), (QUADROTOR, NONE), (GIMBAL, ARDUPILOT), (QUADROTOR, 12)])
def test_a_heartbeat_with_its_ids_that_is_not_its_own_changes_nothing(
    session: KeepingSession, kind: int, autopilot: int
) -> None:
    before = knowledge(session, 101.0)
    for i in range(70):
        tell(session, heartbeat(kind, autopilot, armed=True), 100.0 + i / 10)
    assert knowledge(session, 101.0) == before
    assert session.ignored == 70
    session.poll(107.0)
    assert list(map(type, session.take_events())) == [OtherAutopilotIgnored, VehicleLost]
    assert session.lost


def test_when_the_vehicle_is_lost_another_autopilot_may_take_its_place(session: KeepingSession) -> None:
    """The board was flashed with the other firmware."""
    session.poll(106.0)
    tell(session, heartbeat(autopilot=12), 107.0)
    assert (session.vehicle.autopilot, session.lost) == (12, False)


@pytest.mark.parametrize("boot", [5.0, 25.0, 1e5])
def test_nothing_of_the_lost_vehicle_is_used_for_another_one(session: KeepingSession, boot: float) -> None:
    """Its home neither, whatever the clock of the other one says: that is asked for."""
    session.poll(106.0)
    tell(session, heartbeat(autopilot=12), 107.0)
    assert session.navigation.home is None
    assert session.navigation.state_at(107.0, FRAME) is None
    asked = [p for p in packets(session.poll(107.0)[0]) if p.msgid == dialect.MAVLINK_MSG_ID_COMMAND_LONG]
    assert dialect.MAVLINK_MSG_ID_HOME_POSITION in [decode(p).param1 for p in asked]
    tell(session, position(boot, 47.0), 107.1)
    tell(session, attitude(boot), 107.1)
    assert session.navigation.state_at(107.1, FRAME).position[0] > 55_000


# -- what is said to the vehicle ---------------------------------------------------------------------------


def beats(data: bytes) -> list[Packet]:
    return [p for p in packets(data) if p.msgid == dialect.MAVLINK_MSG_ID_HEARTBEAT]


def test_it_is_an_onboard_computer_of_the_vehicle() -> None:
    session = following(source=(42, 1))
    (beat,) = beats(session.poll(100.0)[0])
    assert (beat.system, beat.component, beat.version) == (42, 191, 2)
    message = decode(beat)
    assert (message.type, message.autopilot) == (COMPANION, NONE)
    assert {(p.system, p.component) for p in packets(session.poll(101.0)[0])} == {(42, 191)}


def test_it_speaks_before_it_has_heard_anything() -> None:
    """PX4's USB port is silent until somebody speaks."""
    (beat,) = packets(KeepingSession().poll(0.0)[0])
    assert (beat.system, beat.component) == (1, 191)
    (beat,) = packets(KeepingSession(target_system=7).poll(0.0)[0])
    assert (beat.system, beat.component) == (7, 191)


@every("known", [False, True])
@every("step", [0.004, 0.01, 0.1, 0.37])
def test_its_heart_beats_once_a_second(known: bool, step: float) -> None:
    session = following(100.0) if known else KeepingSession()
    times = [100.0 + i * step for i in range(round(20.9 / step))]
    sent = [now for now in times for _ in beats(session.poll(now)[0])]
    assert sent[0] == 100.0
    assert sent == pytest.approx(range(100, 121), abs=step + 1e-6)  # lateness does not add up


def test_after_a_stall_it_does_not_make_up_for_lost_heartbeats() -> None:
    session = KeepingSession()
    session.poll(0.0)
    sent = [now for now in np.arange(7.3, 10.0, 0.01) for _ in beats(session.poll(now)[0])]
    assert sent == pytest.approx([7.3, 8.3, 9.3], abs=0.02)


def test_it_says_when_it_wants_to_be_called() -> None:
    session = KeepingSession()
    for now in (5.0, 5.01, 7.0):
        session.poll(now)
        assert now < session.next_due <= now + 1.0


def test_mavlink_1_is_answered_in_mavlink_1() -> None:
    session = KeepingSession()
    tell(session, heartbeat(), 0.0, version=1)
    assert session.vehicle.version == 1
    said = packets(session.poll(0.0)[0] + session.poll(0.5)[0])
    assert {p.version for p in said} == {1}
    assert {p.msgid for p in said} == {0, dialect.MAVLINK_MSG_ID_COMMAND_LONG}


def test_a_passive_session_is_silent() -> None:
    session = KeepingSession(passive=True)
    for i in range(200):
        if i % 20 == 0:
            tell(session, heartbeat(), i / 20)
        assert session.poll(i / 20)[0] == b""
    assert session.vehicle is not None
    assert session.next_due == math.inf


# -- for a person ------------------------------------------------------------------------------------------


@every(
    "options, came, why",
    [
        ({}, b"", NoVehicle("silence")),
        ({}, b"\x00\x80\x78" * 50, NoVehicle("no packets", bytes=150)),
    ],
)
def test_what_was_heard_when_it_was_no_packet(options: dict[str, int], came: bytes, why: NoVehicle) -> None:
    session = KeepingSession(**options)
    session.feed(came, 0.0)
    assert session.why_no_vehicle() == why


def test_what_was_heard_when_it_was_a_ground_station() -> None:
    session = KeepingSession()
    for i in range(3):
        tell(session, heartbeat(GCS, NONE), float(i), (255, 190))
    tell(session, attitude(1.0), 3.0, (1, 1))
    heard = session.why_no_vehicle()
    assert (heard.reason, heard.packets) == ("no heartbeat", 4)
    assert heard.sources == (("heartbeats of gcs", 255, 190, 3), ("packets", 1, 1, 1))


def test_what_was_heard_when_it_was_another_vehicle() -> None:
    heard = hearing(0.0, heartbeat(), target_system=5).why_no_vehicle()
    assert (heard.reason, heard.sources) == ("other vehicles", (("heartbeats of quadrotor", 1, 1, 1),))


def test_a_vehicle_lost_and_back_is_said_once_each(session: KeepingSession) -> None:
    events: list[Event] = []
    for i in range(500):
        now = 100.0 + i / 10
        if now >= 130.0 and i % 10 == 0:
            tell(session, heartbeat(), now)
        session.poll(now)
        events += [event for event in session.take_events() if isinstance(event, VehicleLost | VehicleBack)]
    lost, back = events
    assert isinstance(lost, VehicleLost)
    assert isinstance(back, VehicleBack)
    assert lost.time_s == pytest.approx(105.0, abs=0.11)
    assert back.time_s == 130.0


def test_nothing_is_asked_of_a_lost_vehicle(session: KeepingSession) -> None:
    for i in range(60):
        session.poll(100.0 + i / 10)
    said = b"".join(session.poll(106.0 + i / 10)[0] for i in range(200))
    assert {p.msgid for p in packets(said)} == {dialect.MAVLINK_MSG_ID_HEARTBEAT}


@every(
    "said, why, missing",
    [
        ([], "no vehicle", []),
        ([heartbeat()], "streams missing", ["GLOBAL_POSITION_INT", "ATTITUDE"]),
        ([heartbeat(), position(1.0)], "streams missing", ["ATTITUDE"]),
        ([heartbeat(), position(1.0, 0.0, 0.0), attitude(1.0)], "zero position", []),
        ([heartbeat(), position(1.0, 0.0, 0.0)], "zero position", ["ATTITUDE"]),
        ([heartbeat(), position(1.0), attitude(1.0)], "streams stopped", []),
    ],
)
def test_why_there_is_no_pose(said: list[Any], why: str, missing: list[str]) -> None:
    lacking = hearing(1.0, *said).why_no_pose()
    assert (lacking.reason, [stream.name for stream in lacking.streams]) == (why, missing)


def test_positions_of_zeros_are_named_though_they_are_slow() -> None:
    """One every 3 s, with a boot time of 0 as well."""
    session = hearing(100.0, heartbeat(), passive=True)
    for i in range(60):
        tell(session, attitude(50.0 + i / 10), 100.0 + i / 10)
        if i % 30 == 10:
            tell(session, dialect.MAVLink_global_position_int_message(*[0] * 9), 100.0 + i / 10)
        session.rates(100.0 + i / 10)
    assert session.why_no_pose() == NoPose("zero position")
    assert session.counts()["positions_before_fix"] == 2


@pytest.mark.parametrize(
    ("result", "waits"), [(dialect.MAV_RESULT_ACCEPTED, True), (dialect.MAV_RESULT_TEMPORARILY_REJECTED, False)]
)
def test_a_position_that_is_promised_and_does_not_come_waits_for_a_fix(result: int, waits: bool) -> None:
    """As PX4 does; what is refused waits for something else."""
    session = hearing(100.0, heartbeat(), attitude(1.0))
    for n in range(30):
        session.poll(100.0 + n / 10)
        tell(session, ack(SET_INTERVAL, result), 100.05 + n / 10)
    (stream,) = session.why_no_pose().streams
    asked = stream.name, stream.command, stream.asked_hz, stream.result
    result_name = dialect.enums["MAV_RESULT"][result].name
    assert asked == ("GLOBAL_POSITION_INT", "SET_MESSAGE_INTERVAL", 50.0, result_name)
    assert stream.promised == waits


def test_of_a_log_it_does_not_say_that_something_was_not_asked_for() -> None:
    (stream,) = hearing(100.0, heartbeat(), attitude(1.0), passive=True).why_no_pose().streams
    assert (stream.name, stream.command, stream.recorded) == ("GLOBAL_POSITION_INT", "", True)


@pytest.mark.parametrize("known", [False, True])
def test_a_hostile_link_does_not_fill_the_memory(known: bool) -> None:
    """Heartbeats and other messages of 255 systems, each with dozens of components."""
    session = following() if known else KeepingSession()
    kind = (QUADROTOR, ARDUPILOT) if known else (GCS, NONE)
    beat, other = bytearray(Encoder(0, 0).pack(heartbeat(*kind))), attitude(1.0)
    assert beat[0] == 0xFD

    def hear(components: range) -> None:
        for system in range(2, 256, 4):
            for component in components:
                encoder = Encoder(system, component)
                session.feed(encoder.pack(heartbeat(*kind)) + encoder.pack(other), 100.0)

    tracemalloc.start()
    try:
        hear(range(1, 5))
        before = tracemalloc.get_traced_memory()[0]
        hear(range(5, 15))
        assert tracemalloc.get_traced_memory()[0] < before + 20_000
    finally:
        tracemalloc.stop()
    assert len(session.take_events()) < 50
    assert len(no_vehicle(session.why_no_vehicle())) < 5000


# -- recorded flights --------------------------------------------------------------------------------------

# of each recorded piece: packets; those of others, heard once there was a vehicle; instants up to which a pose
# was known; the home at its end
RECORDED = {
    "arducopter": (3276, 0, 119, (-35.363262, 149.1652369, 584.08)),
    "px4": (9273, 25, 1587, (47.3977433, 8.5455946, 489.455)),
}


def test_a_recorded_flight_is_read_in_full(flight: Path) -> None:
    count, others, instants, at = RECORDED[flight.stem]
    session = KeepingSession(passive=True)
    poses = set()
    seen = 0
    for record in TlogReader(flight):
        seen += len(session.feed(record.raw, record.time_s).accepted)
        poses.add(session.navigation.track.newest)
    vehicle = session.vehicle
    assert seen == session.reader.parser.packets == count
    assert session.reader.parser.bad_crc == session.reader.parser.skipped == 0
    assert session.navigation.refused == session.navigation.unpositioned == session.navigation.reboots == 0
    assert not any(session.disbelieved().values())
    assert (vehicle.system, vehicle.component, vehicle.version) == (1, 1, 2)
    assert str(vehicle) == f"{'px4' if flight.stem == 'px4' else 'ardupilotmega'} quadrotor 1/1"
    assert session.navigation.home == at
    assert session.ignored == others
    assert len(poses - {None}) == instants


def test_its_poses_are_fresh_while_it_plays(flight: Path) -> None:
    """At any instant of the recording the pose is no older than two periods of its streams."""
    session = KeepingSession(passive=True)
    frame = LocalFrame(*RECORDED[flight.stem][3])
    oldest = {"arducopter": 0.55, "px4": 0.2}[flight.stem]
    ages = []
    for record in TlogReader(flight):
        state = session.navigation.state_at(record.time_s, frame)
        if state is not None:
            ages.append(state.age_s)
        session.feed(record.raw, record.time_s)
    assert len(ages) > 3000
    assert min(ages) >= 0
    assert max(ages) < oldest


# -- A short run of what tools/fuzz/autopilot.py does ten million times -----------------------------------


@pytest.mark.parametrize("key", [None, KEY])
def test_nothing_hostile_is_believed(key: bytes | None) -> None:
    bench = Bench(random.Random(7), key)
    enemy = Enemy(bench.numbers, bench.past, signing=key is not None)
    for _ in range(10):
        bench.hear(b"".join(enemy(bench.boot) for _ in range(BURST)))
        bench.fly()
    assert not bench.wrong
    assert len(enemy.made) == len(enemy.kinds)
    counts = bench.session.counts()
    ignored = ["packets_incompatible", "bad_checksums"]
    ignored += (
        ["packets_forged", "packets_unsigned", "packets_replayed"]
        if key
        else ["packets_ignored", "stray_times", "stray_positions"]
    )
    assert all(counts[name] > 100 for name in ignored)


def test_a_lie_that_is_believed_is_noticed() -> None:
    """Without a key, who says just what the vehicle might say is believed."""
    bench = Bench(random.Random(7), None)
    bench.hear(unsigned(bench.boot))
    assert bench.wrong["believed others"] == 1
