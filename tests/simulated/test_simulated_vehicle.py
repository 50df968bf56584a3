"""The built-in vehicle, from outside: bytes in, bytes out, and the truth beside them."""

from __future__ import annotations

import math
from collections import Counter
from itertools import cycle, pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.mavlink.codec import command as order
from arva_hil.simulated.multirotor import STEP_US, Multirotor
from arva_hil.simulated.position import Home, PositionError
from arva_hil.simulated.vehicle import SimulatedVehicle, Truth
from tests.every import every

HOME = (46.5, 11.35, 1800.0)
GUIDED, LOITER, RTL, LAND = 4, 5, 6, 9
SET_MODE, ARM, TAKEOFF, SET_INTERVAL, GET_INTERVAL, REQUEST = 176, 400, 22, 511, 510, 512
ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4
LOCAL, OFFSET, BODY, BODY_OFFSET = 1, 7, 8, 9
NO_POSITION, NO_VELOCITY, NO_YAW, NO_RATE = 0x007, 0x038, 0x400, 0x800
NO_ACCELERATION = 0x1C0
VELOCITY_ONLY = NO_POSITION | NO_ACCELERATION | NO_YAW | NO_RATE
POSITION_ONLY = NO_VELOCITY | NO_ACCELERATION | NO_YAW | NO_RATE

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


def names(messages: list[Any]) -> Counter[str]:
    return Counter(m.get_type() for m in messages)


def of(kind: str, messages: list[Any]) -> list[Any]:
    return [m for m in messages if m.get_type() == kind]


class Client:
    """A ground station with a clock of its own in its hand."""

    def __init__(self, vehicle: SimulatedVehicle | None = None, **options: Any) -> None:
        self.vehicle = vehicle or SimulatedVehicle(HOME, **options)
        self.now = options.get("boot_time", 0.0)
        self.encoder = Encoder(255, 190, options.get("version", 2))
        self.parser = Parser()

    def run(self, seconds: float, step: float = 0.1) -> list[Any]:
        end = self.now + seconds
        messages = self.hear()
        while self.now < end - 1e-9:
            self.now = min(self.now + step, end)
            messages += self.hear()
        return messages

    def after(self, seconds: float) -> Client:
        self.run(seconds)
        return self

    def hear(self) -> list[Any]:
        packets = self.parser.feed(self.vehicle.poll(self.now))
        assert self.parser.bad_crc == self.parser.skipped == 0
        return [decode(p) for p in packets]

    def send(self, message: Any) -> list[Any]:
        self.vehicle.feed(self.encoder.pack(message), self.now)
        return self.hear()

    def command(self, command: int, *params: float, target: tuple[int, int] = (1, 1)) -> int | None:
        """The result in the acknowledgement."""
        acks = of("COMMAND_ACK", self.send(order(*target, command, *params)))
        assert len(acks) <= 1
        if not acks:
            return None
        assert acks[0].command == command
        return int(acks[0].result)

    def steer(
        self,
        velocity: Vector = (0, 0, 0),
        *,
        frame: int = LOCAL,
        mask: int = VELOCITY_ONLY,
        position: Vector = (0, 0, 0),
        yaw: float = 0.0,
        yaw_rate: float = 0.0,
        then_s: float = 0.0,
    ) -> None:
        self.send(
            dialect.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, frame, mask, *position, *velocity, 0, 0, 0, yaw, yaw_rate
            )
        )
        self.run(then_s)

    def keep_steering(self, seconds: float, *velocity: float, frame: int = LOCAL) -> None:
        for _ in range(round(seconds)):
            north, east, down = velocity
            self.steer((north, east, down), frame=frame, then_s=1.0)

    def launched(self) -> Client:
        """In GUIDED, armed."""
        assert self.command(SET_MODE, 1, GUIDED) == ACCEPTED
        assert self.command(ARM, 1) == ACCEPTED
        return self

    def take_off(self, height: float = 3.0) -> Client:
        self.launched()
        assert self.command(TAKEOFF, 0, 0, 0, 0, 0, 0, height) == ACCEPTED
        self.run(4 + height)
        return self

    def truth(self) -> Truth:
        return self.vehicle.truth(self.now)

    def height(self) -> float:
        return -self.truth().ned[2]

    def yaw(self) -> float:
        w, x, y, z = self.truth().quaternion
        return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    def armed(self) -> bool:
        return bool(of("HEARTBEAT", self.run(1.0))[-1].base_mode & 128)


# What it says, and when


def test_only_heartbeats_until_asked() -> None:
    messages = Client().run(10.0)
    assert names(messages) == {"HEARTBEAT": 11}
    beat = messages[0]
    assert (beat.type, beat.autopilot, beat.custom_mode) == (2, 3, 0)
    (packet,) = Parser().feed(SimulatedVehicle(HOME, 7).poll(0.5))
    assert (packet.version, packet.system, packet.component, packet.raw[4]) == (2, 7, 1, 0)


@pytest.mark.parametrize(("msgid", "name"), [(30, "ATTITUDE"), (33, "GLOBAL_POSITION_INT")])
@pytest.mark.parametrize("hz", [0.5, 4, 30, 50, 333])
def test_a_requested_rate_holds(msgid: int, name: str, hz: float) -> None:
    client = Client()
    client.run(1.234)
    assert client.command(SET_INTERVAL, msgid, 1e6 / hz) == ACCEPTED
    messages = of(name, client.run(10.0, step=0.037))
    assert abs(len(messages) - 10 * hz) <= 1
    stamps = [m.time_boot_ms for m in messages]
    assert all(abs(b - a - 1000 / hz) < 1.001 for a, b in pairwise(stamps))
    assert abs(stamps[-1] - (11234 - 11234 % (1000 / hz))) <= 1000 / hz


@every("msgid", [1, 24, 30, 31, 32, 33, 108, 132, 164, 242, 245])
def test_every_stream_can_be_asked_for(msgid: int) -> None:
    client = Client()
    assert client.command(SET_INTERVAL, msgid, 100_000) == ACCEPTED
    assert names(client.run(2.0))[dialect.mavlink_map[msgid].msgname] == 20


def test_all_is_told_in_the_order_of_time() -> None:
    client = Client()
    for msgid, interval in ((30, 10_000), (33, 37_000), (32, 200_000), (31, 50_000)):
        client.command(SET_INTERVAL, msgid, interval)
    client.now = 10.0
    stamps = [m.time_boot_ms for m in client.hear() if hasattr(m, "time_boot_ms")]
    assert stamps == sorted(stamps)
    assert len(stamps) == 1000 + 270 + 50 + 200


def test_a_denied_rate_leaves_the_old_one() -> None:
    client = Client()
    assert client.command(SET_INTERVAL, 30, 100_000) == ACCEPTED
    for denied in ((30, 2_500), (30, -7), (30, math.inf), (9999, 100_000), (math.nan, 100_000), (30, 3e9)):
        assert client.command(SET_INTERVAL, *denied) == DENIED
    assert names(client.run(10.0))["ATTITUDE"] == 100


def test_the_heartbeat_comes_as_often_as_asked_and_never_stops() -> None:
    client = Client()
    assert client.command(SET_INTERVAL, 0, 100_000) == ACCEPTED
    assert names(client.run(10.0))["HEARTBEAT"] == 100
    for interval in (-1, 0):
        assert client.command(SET_INTERVAL, 0, interval) == ACCEPTED
        assert 9 <= names(client.run(10.0))["HEARTBEAT"] <= 11


def test_asking_again_does_not_delay_a_stream() -> None:
    client = Client()
    messages = []
    for _ in range(20):
        client.command(SET_INTERVAL, 30, 1_000_000)
        messages += client.run(0.3)
    assert names(messages)["ATTITUDE"] == 6


def test_streams_at_boot_are_the_default() -> None:
    client = Client(streams={33: 10.0})
    assert names(client.run(5.0))["GLOBAL_POSITION_INT"] == 50
    client.command(SET_INTERVAL, 33, -1)
    assert names(client.run(5.0))["GLOBAL_POSITION_INT"] == 0
    client.command(SET_INTERVAL, 33, 0)
    assert names(client.run(5.0))["GLOBAL_POSITION_INT"] == 50


@pytest.mark.parametrize("streams", [{33: 400.0}, {9999: 1.0}])
def test_streams_it_does_not_have(streams: dict[int, float]) -> None:
    with pytest.raises(ValueError, match="streams"):
        SimulatedVehicle(HOME, streams=streams)


def test_message_interval_is_told() -> None:
    client = Client()
    client.command(SET_INTERVAL, 30, 50_000)
    for msgid, interval in ((30, 50_000), (33, -1), (0, 1_000_000)):
        ack, answer = client.send(order(1, 1, GET_INTERVAL, msgid))
        assert ack.result == ACCEPTED
        assert (answer.message_id, answer.interval_us) == (msgid, interval)
    assert client.command(GET_INTERVAL, 9999) == FAILED


@every(
    "group, kinds",
    [
        (6, {"GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"}),
        (10, {"ATTITUDE"}),
        (
            0,
            {
                *("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "ATTITUDE", "SYS_STATUS", "GPS_RAW_INT"),
                "DISTANCE_SENSOR",
            },
        ),
        (99, set()),
    ],
)
def test_data_streams(group: int, kinds: set[str]) -> None:
    client = Client()
    client.send(dialect.MAVLink_request_data_stream_message(1, 1, group, 4, 1))
    assert names(client.run(5.0)) == {"HEARTBEAT": 5} | dict.fromkeys(kinds, 20)
    client.send(dialect.MAVLink_request_data_stream_message(1, 1, group, 4, 0))
    assert names(client.run(5.0)) == {"HEARTBEAT": 5}


@every("msgid", [0, 1, 24, 30, 31, 32, 33, 108, 132, 148, 164, 242, 245])
def test_a_message_on_request(msgid: int) -> None:
    client = Client()
    client.run(0.5)
    ack, answer = client.send(order(1, 1, REQUEST, msgid))
    assert (ack.command, ack.result, ack.target_system, ack.target_component) == (REQUEST, ACCEPTED, 255, 190)
    assert answer.get_msgId() == msgid
    assert client.command(REQUEST, 9999) == FAILED


def test_next_due_is_when_there_is_something_to_say() -> None:
    client = Client(boot_time=1.7e9, streams={33: 30.0, 30: 7.0})
    for _ in range(500):
        due = client.vehicle.next_due
        assert due >= client.now
        client.now = due - 1e-5
        assert client.hear() == []
        client.now = due
        assert client.hear() != []
    assert 0 < client.now - 1.7e9 < 500 / 30


def test_timesync() -> None:
    client = Client()
    client.run(2.5)
    (answer,) = client.send(dialect.MAVLink_timesync_message(0, 12345))
    assert (answer.tc1, answer.ts1) == (2_500_000_000, 12345)
    assert client.send(dialect.MAVLink_timesync_message(777, 12345)) == []


def test_a_vehicle_of_mavlink_1() -> None:
    client = Client(version=1, streams={33: 5.0})
    client.take_off()
    packets = Parser().feed(client.vehicle.poll(client.now + 5))
    assert {p.version for p in packets} == {1}
    assert len(packets) == 30
    assert client.height() == pytest.approx(3.0, abs=0.2)


def test_all_its_parameters_are_told_to_who_asks_for_the_list() -> None:
    client = Client()
    client.run(0.5)
    told = client.send(dialect.MAVLink_param_request_list_message(1, 1))
    assert [(p.get_type(), p.param_index, p.param_count) for p in told] == [
        ("PARAM_VALUE", index, len(told)) for index in range(len(told))
    ]
    assert len({p.param_id for p in told}) == len(told) > 0


# Whom it obeys


@every(
    "target, obeys",
    [((1, 1), True), ((0, 0), True), ((1, 0), True), ((2, 1), False), ((1, 100), False)],
)
def test_it_obeys_what_is_addressed_to_it(target: tuple[int, int], obeys: bool) -> None:
    client = Client()
    assert client.command(SET_MODE, 1, GUIDED, target=target) == (ACCEPTED if obeys else None)
    assert client.run(1.0)[-1].custom_mode == (GUIDED if obeys else 0)


def test_two_vehicles_do_not_touch_each_other() -> None:
    alone_said = Client(system=7, gps_noise_m=1.0, seed=3, streams={33: 5.0}).run(2.0)
    first = Client(system=7, gps_noise_m=1.0, seed=3, streams={33: 5.0})
    second = Client(system=8, gps_noise_m=1.0, seed=4, wind=(3, 0, 0))
    said = first.hear()
    second.hear()
    for _ in range(20):
        second.command(SET_MODE, 1, GUIDED, target=(8, 1))
        second.command(ARM, 1, target=(8, 1))
        first.now += 0.1
        said += first.hear()
        second.now += 0.1
        second.hear()
    assert [m.to_dict() for m in said] == [m.to_dict() for m in alone_said]


# Commands


def test_acks_on_the_ground() -> None:
    client = Client()
    to_three = TAKEOFF, 0, 0, 0, 0, 0, 0, 3
    for wanted, *asked in (
        (FAILED, *to_three),  # not GUIDED
        (FAILED, SET_MODE, 1, 77),
        (DENIED, SET_MODE, 0, GUIDED),
        (ACCEPTED, SET_MODE, 1, GUIDED),
        (FAILED, *to_three),  # not armed
        (DENIED, ARM, 5),
        (DENIED, ARM, math.nan),
        (ACCEPTED, ARM, 1),
        (ACCEPTED, ARM, 1),
        *((FAILED, *to_three[:-1], height) for height in (0, -3, math.nan, math.inf)),
        (ACCEPTED, ARM, 0),
        *((UNSUPPORTED, command) for command in (178, 16, 20, 42, 65535)),
    ):
        assert client.command(*asked) == wanted, asked


@pytest.mark.parametrize("mode", [LAND, RTL])
def test_no_arming_to_land(mode: int) -> None:
    client = Client()
    client.command(SET_MODE, 1, mode)
    assert client.command(ARM, 1) == FAILED
    assert not client.armed()


def test_set_mode_message() -> None:
    client = Client()
    (ack,) = of("COMMAND_ACK", client.send(dialect.MAVLink_set_mode_message(1, 1, LOITER)))
    assert (ack.command, ack.result) == (11, ACCEPTED)
    assert client.run(1.0)[-1].custom_mode == LOITER


def test_command_int() -> None:
    client = Client().launched()

    def take_off(frame: int) -> int:
        asked = dialect.MAVLink_command_int_message(1, 1, frame, TAKEOFF, 0, 0, 0, 0, 0, 0, 0, 0, 4.0)
        return int(of("COMMAND_ACK", client.send(asked))[0].result)

    assert take_off(0) == DENIED  # altitudes above mean sea level
    assert take_off(3) == ACCEPTED
    assert client.after(10).height() == pytest.approx(4.0, abs=0.2)
    assert take_off(3) == FAILED  # flies already


def test_arming_is_told() -> None:
    client = Client()
    said = client.send(order(1, 1, ARM, 1))
    assert [m.get_type() for m in said[-3:]] == ["COMMAND_ACK", "STATUSTEXT", "HOME_POSITION"]
    home = of("HOME_POSITION", said)[0]
    assert (home.latitude, home.longitude, home.altitude) == (465_000_000, 113_500_000, 1_800_000)
    assert client.armed()


def test_armed_and_idle_it_disarms_after_ten_seconds() -> None:
    client = Client()
    client.run(30)
    client.command(ARM, 1)
    assert client.after(8.5).armed()
    assert "Disarming motors" in [m.text for m in of("STATUSTEXT", client.run(1.0))]
    assert not client.armed()


def test_disarming_in_the_air_takes_force() -> None:
    client = Client(wind=(2, 0, 0)).take_off(10)
    assert client.command(ARM, 0) == FAILED
    assert client.command(ARM, 0, 21196) == ACCEPTED
    client.run(4.0, step=0.01)
    assert 0 <= client.height() < 0.01
    assert of("HEARTBEAT", client.run(1.0))[0].system_status == 3


def test_nothing_before_the_fix() -> None:
    client = Client(fix_after=10.0, streams={33: 5.0, 32: 5.0, 24: 5.0})
    assert client.command(ARM, 1) == FAILED
    assert client.command(REQUEST, 242) == ACCEPTED
    before = client.run(9.95)
    assert names(before).keys() == {"HEARTBEAT", "GLOBAL_POSITION_INT", "GPS_RAW_INT"}
    assert len(of("GLOBAL_POSITION_INT", before)) == 49
    for m in of("GLOBAL_POSITION_INT", before):
        assert m.lat == m.lon == m.alt == m.relative_alt == m.hdg == 0
    assert {m.fix_type for m in of("GPS_RAW_INT", before)} == {1}
    after = client.run(5.0)
    assert names(after)["HOME_POSITION"] == 1
    assert of("HOME_POSITION", after)[0].time_usec == 10_000_000
    assert len(of("LOCAL_POSITION_NED", after)) == 25
    assert {m.lat for m in of("GLOBAL_POSITION_INT", after)} == {465_000_000}
    assert {m.fix_type for m in of("GPS_RAW_INT", after)} == {3}
    assert client.command(ARM, 1) == ACCEPTED


# Flight


@pytest.mark.parametrize("height", [0.5, 3.0, 20.0])
def test_take_off(height: float) -> None:
    client = Client(wind=(4, -3, 0)).take_off(height)
    client.run(10)
    highest = height
    for _ in range(100):
        client.run(0.1)
        highest = max(highest, client.height())
        assert client.height() == pytest.approx(height, abs=0.1)
    assert highest < height + 0.2
    assert math.hypot(*client.truth().ned[:2]) < 0.1


@pytest.mark.parametrize("frame", [LOCAL, OFFSET])
def test_velocity(frame: int) -> None:
    client = Client(wind=(-4, 2, 0)).take_off()
    client.keep_steering(5, 3.0, -1.0, -0.5, frame=frame)
    assert client.truth().velocity == pytest.approx((3.0, -1.0, -0.5), abs=0.02)
    start, height = client.truth().ned, client.height()
    client.keep_steering(4, 3.0, -1.0, -0.5, frame=frame)
    end = client.truth().ned
    assert end[0] - start[0] == pytest.approx(12, abs=0.1)
    assert end[1] - start[1] == pytest.approx(-4, abs=0.1)
    assert client.height() - height == pytest.approx(2, abs=0.1)


@every("frame", [BODY, BODY_OFFSET])
@every("yaw", [0.0, 1.2, 3.0, -2.2])
def test_body_frames_turn_with_the_yaw(frame: int, yaw: float) -> None:
    client = Client().take_off()
    client.steer(mask=NO_POSITION | NO_ACCELERATION | NO_RATE, yaw=yaw, then_s=6)
    assert math.remainder(client.yaw() - yaw, math.tau) == pytest.approx(0, abs=0.01)
    client.keep_steering(5, 2.0, 0.5, 0.0, frame=frame)
    north = 2.0 * math.cos(yaw) - 0.5 * math.sin(yaw)
    east = 2.0 * math.sin(yaw) + 0.5 * math.cos(yaw)
    assert client.truth().velocity == pytest.approx((north, east, 0.0), abs=0.03)
    client.steer(frame=frame, mask=NO_POSITION | NO_RATE, yaw=0.5, then_s=4)
    assert math.remainder(client.yaw() - yaw - 0.5, math.tau) == pytest.approx(0, abs=0.01)


def test_yaw_rate() -> None:
    client = Client().take_off()
    for rate, seconds in ((0.4, 2.0), (-0.4, 2.0)):
        client.steer(mask=NO_POSITION | NO_YAW, yaw_rate=rate, then_s=seconds)
        assert client.truth().rates == pytest.approx((0, 0, rate), abs=0.01)
    client.steer(mask=NO_POSITION | NO_YAW, yaw_rate=20.0, then_s=2)
    assert client.truth().rates[2] == pytest.approx(math.radians(90), abs=0.01)


@pytest.mark.parametrize(
    ("frame", "where"),
    [
        (LOCAL, (10.0, 4.0, -6.0)),
        (OFFSET, (12.0, 3.0, -9.0)),
        (BODY, (1.0, 9.0, -9.0)),
        (BODY_OFFSET, (1.0, 9.0, -9.0)),
    ],
)
def test_positions(frame: int, where: Vector) -> None:
    client = Client().take_off(3.0)
    client.steer(mask=POSITION_ONLY & ~NO_YAW, position=(2, -1, -3), yaw=math.pi / 2, then_s=15)
    assert client.truth().ned == pytest.approx((2, -1, -3), abs=0.03)
    client.steer(frame=frame, mask=POSITION_ONLY, position=(10, 4, -6), then_s=20)
    if frame in (BODY, BODY_OFFSET):  # facing east: forward is east, right is south
        where = (2.0 - 4.0, -1.0 + 10.0, -9.0)
    assert client.truth().ned == pytest.approx(where, abs=0.03)


def test_a_set_point_lasts_three_seconds() -> None:
    client = Client().take_off()
    client.steer((2.0, 0.0, 0.0), mask=NO_POSITION | NO_YAW, yaw_rate=0.3, then_s=2.95)
    assert client.truth().velocity[0] == pytest.approx(2.0, abs=0.02)
    assert client.truth().rates[2] == pytest.approx(0.3, abs=0.02)
    assert client.after(4.0).truth().velocity == pytest.approx((0, 0, 0), abs=0.02)
    assert client.truth().rates == pytest.approx((0, 0, 0), abs=0.01)


def test_velocity_set_points_do_not_take_off() -> None:
    client = Client().launched()
    client.keep_steering(5, 1.0, 0.0, -1.0)
    assert client.truth().ned == (0, 0, 0)
    client.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 3.0)
    client.steer((1.0, 0.0, 0.0), then_s=3)
    assert client.height() < 0.01


@pytest.mark.parametrize("mode", [0, LOITER])
def test_set_points_need_guided(mode: int) -> None:
    client = Client().take_off()
    client.keep_steering(3, 2.0, 0.0, 0.0)
    assert client.command(SET_MODE, 1, mode) == ACCEPTED
    client.keep_steering(5, 2.0, 0.0, 0.0)
    assert client.truth().velocity == pytest.approx((0, 0, 0), abs=0.02)


@every("bad", [math.nan, math.inf, -math.inf])
def test_set_points_that_are_no_numbers(bad: float) -> None:
    client = Client().take_off()
    client.steer((1.0, 0.0, 0.0))
    client.steer((bad, 0.0, 0.0))
    client.steer(mask=POSITION_ONLY, position=(0, bad, 0))
    client.steer(mask=NO_POSITION | NO_RATE, yaw=bad)
    client.steer((2.0, 0.0, 0.0), frame=0, then_s=2.9)
    assert client.truth().velocity[0] == pytest.approx(1.0, abs=0.02)
    client.steer((3.0, 0.0, 0.0), position=(bad, bad, bad), yaw=bad, yaw_rate=bad)  # all masked
    assert client.after(2.9).truth().velocity[0] == pytest.approx(3.0, abs=0.05)


@pytest.mark.parametrize("wind", [(0.0, 0.0, 0.0), (5.0, 5.0, 0.0)])
def test_landing_disarms(wind: Vector) -> None:
    client = Client(wind=wind).take_off(12.0)
    client.keep_steering(4, 2.0, 1.0, 0.0)
    assert client.command(21) == ACCEPTED
    seconds = 0
    while client.armed():
        seconds += 1
        assert seconds < 40
    assert seconds > 12
    assert 0 <= client.height() < 0.01
    assert client.truth().velocity == pytest.approx((0, 0, 0), abs=0.01)
    assert client.after(5).truth().rates == pytest.approx((0, 0, 0), abs=1e-6)
    w, x, y, _ = client.truth().quaternion
    assert (x, y) == pytest.approx((0, 0), abs=1e-6)
    assert abs(w) > 0.99


def test_landed_in_guided_it_may_take_off_again() -> None:
    client = Client().take_off()
    client.keep_steering(8, 0.0, 0.0, 1.0)
    assert client.armed()
    assert client.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 2.0) == ACCEPTED
    assert client.after(8).height() == pytest.approx(2.0, abs=0.1)


def test_return_to_launch() -> None:
    client = Client().take_off(5.0)
    client.keep_steering(10, 4.0, 3.0, 0.0)
    assert client.truth().ned[0] > 30
    client.command(SET_MODE, 1, RTL)
    highest = 0.0
    for _ in range(120):
        client.run(0.5)
        highest = max(highest, client.height())
    assert highest == pytest.approx(15, abs=0.7)
    assert not client.armed()
    assert math.hypot(*client.truth().ned[:2]) < 1.2
    assert client.height() < 0.01


def test_no_order_makes_it_faster_than_a_small_multirotor() -> None:
    vehicle = Multirotor((0.0, 0.0, 0.0))

    def most(velocity: Vector, yaw_rate: float = 0.0) -> tuple[float, ...]:
        """Its greatest horizontal and vertical speed, acceleration [m/s, m/s²] and yaw rate [rad/s] in 6 s."""
        flown = []
        for _ in range(600):
            vehicle.step(velocity, yaw_rate, True)
            flown.append(vehicle.at((vehicle.steps - 1) * STEP_US))
        speeds = np.array([motion.velocity for motion in flown])
        changes = np.diff(speeds, axis=0) * 1e6 / STEP_US
        horizontal, vertical = (np.hypot(v[:, 0], v[:, 1]).max() for v in (speeds, changes))
        return horizontal, vertical, np.abs(speeds[:, 2]).max(), np.abs(changes[:, 2]).max(), abs(flown[-1].rates[2])

    assert most((0.0, 0.0, -1e3)) == pytest.approx((0.0, 0.0, 2.5, 2.5, 0.0), abs=0.1)
    assert most((0.0, 0.0, 0.0), 1e3)[4] == pytest.approx(math.pi / 2, abs=0.01)
    assert most((0.0, 0.0, 1e3))[2] == pytest.approx(1.5, abs=0.1)
    most((0.0, 0.0, 0.0))
    assert most((-6e3, 8e3, 0.0))[:2] == pytest.approx((10.0, 3.0), rel=0.05)


def test_it_leans_against_the_wind() -> None:
    client = Client(wind=(-5.0, 0.0, 0.0), streams={30: 10.0}).take_off()
    attitude = of("ATTITUDE", client.run(1.0))[-1]
    assert attitude.pitch == pytest.approx(-math.atan(0.2 * 5 / 9.80665), abs=1e-3)  # nose down, to the north
    assert attitude.roll == pytest.approx(0, abs=1e-3)
    assert client.truth().ned[:2] == pytest.approx((0, 0), abs=0.05)


def test_landed_states() -> None:
    client = Client(streams={245: 10.0})

    def state() -> int:
        return int(of("EXTENDED_SYS_STATE", client.run(0.2))[-1].landed_state)

    assert state() == 1
    client.launched().command(TAKEOFF, 0, 0, 0, 0, 0, 0, 3.0)
    client.run(1)
    assert state() == 3
    client.run(10)
    assert state() == 2
    client.command(21)
    client.run(1)
    assert state() == 4
    client.run(20)
    assert state() == 1


def test_what_it_says_is_true() -> None:
    streams = dict.fromkeys((24, 30, 31, 32, 33, 132), 7.0)
    client = Client(wind=(2, 1, 0), streams=streams).take_off(4.0)
    client.steer((3.0, 2.0, -0.4), mask=NO_POSITION | NO_YAW, yaw_rate=0.5)
    kinds = Counter[str]()
    for m in client.run(2.9):
        kinds[m.get_type()] += 1
        if m.get_type() == "HEARTBEAT":
            continue
        at = m.time_boot_ms / 1000 if hasattr(m, "time_boot_ms") else m.time_usec / 1e6
        truth = client.vehicle.truth(at)
        w, x, y, z = truth.quaternion
        match m.get_type():
            case "LOCAL_POSITION_NED":
                assert (m.x, m.y, m.z) == pytest.approx(truth.ned, abs=1e-5)
                assert (m.vx, m.vy, m.vz) == pytest.approx(truth.velocity, abs=1e-5)
            case "GLOBAL_POSITION_INT":
                lat, lon, alt = truth.lla
                assert (m.lat / 1e7, m.lon / 1e7) == pytest.approx((lat, lon), abs=0.6e-7)
                assert m.alt / 1e3 == pytest.approx(alt, abs=0.7e-3)
                assert m.relative_alt / 1e3 == pytest.approx(alt - HOME[2], abs=0.7e-3)
                assert (m.vx / 100, m.vy / 100, m.vz / 100) == pytest.approx(truth.velocity, abs=0.0051)
                yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
                assert math.remainder(math.radians(m.hdg / 100) - yaw, math.tau) == pytest.approx(0, abs=1e-4)
            case "ATTITUDE_QUATERNION":
                assert (m.q1, m.q2, m.q3, m.q4) == pytest.approx(truth.quaternion, abs=1e-6)
                assert (m.rollspeed, m.pitchspeed, m.yawspeed) == pytest.approx(truth.rates, abs=1e-6)
            case "ATTITUDE":
                assert math.sin(m.pitch) == pytest.approx(2 * (w * y - z * x), abs=1e-6)
                tangent = 2 * (w * x + y * z) / (1 - 2 * (x * x + y * y))
                assert math.tan(m.roll) == pytest.approx(tangent, abs=1e-6)
                assert (m.rollspeed, m.pitchspeed, m.yawspeed) == pytest.approx(truth.rates, abs=1e-6)
            case "DISTANCE_SENSOR":
                assert m.current_distance / 100 == pytest.approx(-truth.ned[2], abs=0.0051)
                assert m.orientation == 25
            case "GPS_RAW_INT":
                assert m.lat / 1e7 == pytest.approx(truth.lla[0], abs=0.6e-7)
                assert m.vel / 100 == pytest.approx(math.hypot(*truth.velocity[:2]), abs=0.0051)
    assert len(kinds) == 7
    assert min(kinds.values()) >= 2


@given(st.tuples(*[st.floats(-3000, 3000)] * 3))
def test_the_fast_geodesy_is_the_exact_one(ned: Vector) -> None:
    home = Home(*HOME)
    exact, fast = home.lla(ned), home.lla_fast(ned)
    assert fast[0] == pytest.approx(exact[0], abs=1e-9)
    assert fast[1] == pytest.approx(exact[1], abs=1e-9)
    assert fast[2] == pytest.approx(exact[2], abs=1e-4)


# Any flight at all

FALL = -1

set_points = st.tuples(
    st.sampled_from([LOCAL, OFFSET, BODY, BODY_OFFSET]),
    st.integers(0, 0xFFF).map(lambda mask: mask & ~0x200),
    st.tuples(*[st.floats(-40, 40, width=32)] * 3),
    st.tuples(*[st.floats(-15, 15, width=32)] * 3),
    st.floats(-4, 4, width=32),
    st.floats(-3, 3, width=32),
    st.floats(0.02, 4.0),
)
winds = st.tuples(st.floats(-8, 8), st.floats(-8, 8), st.floats(-1, 1))


def fly(client: Client, flight: list[Any]) -> None:
    for frame, mask, position, velocity, yaw, yaw_rate, seconds in flight:
        client.steer(velocity, frame=frame, mask=mask, position=position, yaw=yaw, yaw_rate=yaw_rate)
        client.run(seconds, step=1.0)


@settings(max_examples=8, deadline=None, phases=[Phase.reuse, Phase.generate])  # shrinking takes minutes
@given(st.lists(set_points, min_size=1, max_size=4), winds, st.sampled_from([0, LAND, RTL, FALL]))
def test_the_motion_is_one_motion(flight: list[Any], wind: Vector, end: int) -> None:
    """Velocity is the slope of position, rates of attitude; thrust explains acceleration; ground is hard."""
    client = Client(wind=wind).take_off(2.0)
    fly(client, flight)
    if end == FALL:
        client.command(ARM, 0, 21196)
    elif end:
        client.command(SET_MODE, 1, end)
    start, vehicle = math.ceil(client.now * 100) / 100, client.vehicle
    client.now = start + 8.0
    client.hear()
    flying = 0
    for i in range(0, 790, 7):
        t = start + i * 0.01
        before, truth, after = (vehicle.truth(t + 0.005 + s) for s in (-0.003, 0, 0.003))
        assert all(math.isfinite(x) for group in truth for x in group)
        assert truth.ned[2] <= 0
        assert sum(x * x for x in truth.quaternion) == pytest.approx(1, abs=1e-9)
        slope = [(b - a) / 0.006 for a, b in zip(before.ned, after.ned, strict=True)]
        assert slope == pytest.approx(truth.velocity, abs=1e-6)
        assert turn_rate(before.quaternion, after.quaternion, 0.006) == pytest.approx(truth.rates, abs=1e-6)
        # across a step nothing jumps
        further = vehicle.truth(t + 0.012)
        for k in range(3):
            mean = (truth.velocity[k] + further.velocity[k]) / 2
            assert further.ned[k] - truth.ned[k] == pytest.approx(0.007 * mean, abs=0.007**2 * 200)
            assert abs(further.rates[k] - truth.rates[k]) < 1.0
        if -truth.ned[2] > 1 and not end:
            flying += 1
            a = [(q - p) / 0.006 for p, q in zip(before.velocity, after.velocity, strict=True)]
            assert math.hypot(a[0], a[1]) < 3.01
            assert abs(a[2]) < 2.51
            assert math.hypot(*truth.velocity[:2]) < 10.6
            push = [a[k] + 0.2 * (truth.velocity[k] - wind[k]) - (0, 0, 9.80665)[k] for k in range(3)]
            length = math.hypot(*push)
            for have, want in zip(turned(truth.quaternion).as_matrix()[:, 2], push, strict=True):
                assert have == pytest.approx(-want / length, abs=0.02)
    if end == FALL:
        assert vehicle.truth(start + 7.9).ned[2] > -0.01


def turned(q: Quaternion) -> Rotation:
    w, x, y, z = q
    return Rotation.from_quat([x, y, z, w])


def turn_rate(a: Quaternion, b: Quaternion, seconds: float) -> np.ndarray:
    """Body rates of the turn from a to b."""
    return (turned(a).inv() * turned(b)).as_rotvec() / seconds


def said_when(script: list[tuple[Any, float]], pace: list[float]) -> bytes:
    """What a vehicle says that is told these messages, each so many seconds before the next, and polled at a pace."""
    vehicle = SimulatedVehicle(HOME, gps_noise_m=0.7, streams={33: 7.0, 31: 3.0}, fix_after=1.0)
    encoder, now, out = Encoder(255, 190), 0.0, b""
    for message, seconds in script:
        vehicle.feed(encoder.pack(message), now)
        end, paces = now + seconds, cycle(pace)
        while now < end:
            now = min(end, now + next(paces))
            out += vehicle.poll(now)
    return out


@settings(max_examples=12, deadline=None)
@given(st.lists(set_points, min_size=1, max_size=3), st.lists(st.floats(0.001, 3.0), min_size=1, max_size=9))
def test_how_often_it_is_polled_changes_nothing(flight: list[Any], steps: list[float]) -> None:
    launch = ((SET_MODE, 1, GUIDED), 2.0), ((ARM, 1), 0.0), ((TAKEOFF, 0, 0, 0, 0, 0, 0, 2.0), 4.0)
    script = [(order(1, 1, *asked), seconds) for asked, seconds in launch]
    for frame, mask, position, velocity, yaw, yaw_rate, seconds in flight:
        rest = (0, 1, 1, frame, mask, *position, *velocity, 0, 0, 0, yaw, yaw_rate)
        script.append((dialect.MAVLink_set_position_target_local_ned_message(*rest), seconds))
    said = said_when(script, [1000.0])
    assert said == said_when(script, steps)
    assert len(said) > 1000


ORDERS = [order(1, 1, *asked) for asked in ((SET_MODE, 1, GUIDED), (ARM, 1), (TAKEOFF, *[0] * 6, 3))]
TAKES_OFF = b"".join(map(Encoder(255, 190).pack, ORDERS))


@settings(max_examples=15, deadline=None)
@given(st.lists(st.integers(0, len(TAKES_OFF)), max_size=12), st.binary(max_size=30))
def test_bytes_may_be_cut_anywhere(cuts: list[int], garbage: bytes) -> None:
    whole, cut = SimulatedVehicle(HOME), SimulatedVehicle(HOME)
    whole.feed(garbage.replace(b"\xfd", b"").replace(b"\xfe", b"") + TAKES_OFF, 0.5)
    for a, b in pairwise([0, *sorted(cuts), len(TAKES_OFF)]):
        cut.feed(TAKES_OFF[a:b], 0.5)
    assert whole.poll(8.0) == cut.poll(8.0)
    assert whole.truth(8.0) == cut.truth(8.0)
    assert -cut.truth(8.0).ned[2] == pytest.approx(3.0, abs=0.2)


@given(st.lists(st.binary(max_size=80), max_size=5))
def test_garbage_is_dropped(chunks: list[bytes]) -> None:
    vehicle = SimulatedVehicle(HOME)
    for chunk in chunks:
        vehicle.feed(chunk, 1.0)
    assert names(Client(vehicle).run(4.0)) == {"HEARTBEAT": 5}


@given(
    st.sampled_from([SET_MODE, ARM, TAKEOFF, 21, SET_INTERVAL, GET_INTERVAL, REQUEST]),
    st.lists(st.floats(width=32), min_size=7, max_size=7),
)
def test_any_parameters_are_answered(command: int, params: list[float]) -> None:
    client = Client().launched()
    assert client.command(command, *params) in (ACCEPTED, DENIED, FAILED)
    client.run(2.0)
    assert all(math.isfinite(x) for group in client.truth() for x in group)


# Restart, noise, memory


def test_reboot() -> None:
    client = Client(boot_time=100.0, streams={33: 4.0}).take_off()
    client.command(SET_INTERVAL, 30, 100_000)
    client.command(SET_MODE, 1, LOITER)
    client.run(1.0)
    ned = client.truth().ned
    client.vehicle.reboot(client.now)
    assert client.truth().ned == ned
    raw = client.vehicle.poll(client.now)
    assert raw[4] == 0  # the sequence number
    messages = [decode(p) for p in client.parser.feed(raw)] + client.run(2.0)
    assert names(messages) == {"HEARTBEAT": 3, "GLOBAL_POSITION_INT": 8}
    assert [m.time_boot_ms for m in of("GLOBAL_POSITION_INT", messages)] == list(range(250, 2001, 250))
    beat = of("HEARTBEAT", messages)[0]
    assert (beat.custom_mode, beat.base_mode & 128) == (0, 0)
    assert client.after(5.0).height() < 0.01
    client.take_off()
    assert client.height() == pytest.approx(3.0, abs=0.2)


def test_a_reboot_waits_for_a_new_fix() -> None:
    client = Client(fix_after=5.0, streams={33: 2.0})
    client.run(20)
    client.vehicle.reboot(client.now)
    lats = [m.lat for m in of("GLOBAL_POSITION_INT", client.run(10.0))]
    assert lats == [0] * 9 + [465_000_000] * 11


def test_boot_time_is_when_the_stamps_begin() -> None:
    client = Client(boot_time=50.25, streams={33: 10.0})
    client.now = 50.0
    assert client.hear() == []
    client.now = 51.0
    assert [m.time_boot_ms for m in of("GLOBAL_POSITION_INT", client.hear())] == list(range(100, 701, 100))


def test_the_same_seed_gives_the_same_bytes() -> None:
    def said(seed: int) -> bytes:
        client = Client(gps_noise_m=1.0, seed=seed, wind=(1, 2, 0), streams={33: 20.0, 30: 20.0})
        client.take_off()
        return client.vehicle.poll(60.0)

    assert said(1) == said(1)
    assert said(1) != said(2)


def test_noise_is_in_the_report_and_not_in_the_truth() -> None:
    client = Client(gps_noise_m=2.0, seed=5, streams={32: 5.0}).take_off()
    away_m = []
    for _ in range(100):
        for told in of("LOCAL_POSITION_NED", client.run(0.2)):
            truth = client.vehicle.truth(told.time_boot_ms / 1000)
            assert (told.vx, told.vy, told.vz) == pytest.approx(truth.velocity, abs=1e-6)
            away_m.append(math.dist((told.x, told.y, told.z), truth.ned))
    assert max(away_m) - min(away_m) > 0.5  # it drifts
    assert max(away_m) < 10


def test_the_height_held_is_the_height_reported() -> None:
    client = Client(gps_noise_m=1.0, seed=132, streams={33: 5.0, 32: 5.0}).take_off(3.0)
    heights = [-told.z for told in of("LOCAL_POSITION_NED", client.run(60.0))]
    assert heights == pytest.approx([3.0] * len(heights), abs=0.4)


def test_it_tells_its_true_pose_when_asked_whatever_its_gps_says() -> None:
    client = Client(gps_noise_m=5.0, seed=3)
    client.command(SET_INTERVAL, 108, 100_000)
    client.command(SET_INTERVAL, 164, 100_000)
    client.take_off(5)
    client.steer((2.0, 1.0, 0.0))
    said = client.run(2.0)
    exact, old = of("SIM_STATE", said)[-1], of("SIMSTATE", said)[-1]
    truth = client.vehicle.truth(client.now)
    lat, lon, alt = truth.lla
    assert math.hypot(*truth.velocity) > 1.5
    assert (exact.lat_int, exact.lon_int) == pytest.approx((lat * 1e7, lon * 1e7), abs=2)
    assert exact.alt == pytest.approx(alt, abs=0.01)
    assert (exact.q1, exact.q2, exact.q3, exact.q4) == pytest.approx(truth.quaternion, abs=1e-3)
    assert (exact.vn, exact.ve, exact.vd) == pytest.approx(truth.velocity, abs=0.01)
    assert (old.lat, old.lng) == (exact.lat_int, exact.lon_int)
    assert (old.roll, old.pitch, old.yaw) == (exact.roll, exact.pitch, exact.yaw)


def test_the_error_of_the_reported_position_has_the_size_asked_for_and_drifts() -> None:
    sigma, seconds = 1.5, 60_000
    error = PositionError(sigma, seed=1)
    track = np.array([error.at(round(t * 1e6)) for t in range(seconds)])
    centred = track - track.mean(axis=0)
    variance = (centred**2).mean(axis=0)
    later = (centred[30:] * centred[:-30]).mean(axis=0)
    assert track.mean(axis=0) == pytest.approx(np.zeros(3), abs=0.2)
    assert np.sqrt(variance) == pytest.approx(np.full(3, sigma), rel=0.07)
    assert later / variance == pytest.approx(np.full(3, 0.44), abs=0.06)  # (τ₁e^(−30/τ₁) − τ₂e^(−30/τ₂)) / (τ₁ − τ₂)
    speed = np.diff(track, axis=0)
    assert np.sqrt((speed**2).mean()) == pytest.approx(0.081 * sigma, rel=0.05)  # a raw process would have 0.26
    turns = np.diff(speed, axis=0)
    assert np.sqrt((turns**2).mean()) < 0.7 * np.sqrt((speed**2).mean())  # of one that jitters it is 1.4


def test_truth_is_remembered_for_a_while() -> None:
    client = Client().take_off()
    client.steer((2.0, 0.0, 0.0))
    path = []
    for _ in range(50):
        client.run(0.1)
        path.append((client.now, client.truth()))
    for at, truth in path:
        assert client.vehicle.truth(at) == truth
    client.run(10.0)
    with pytest.raises(ValueError, match="not known"):
        client.vehicle.truth(path[0][0])
    with pytest.raises(ValueError, match="not known"):
        client.vehicle.truth(-1.0)
