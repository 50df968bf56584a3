"""A search that begins in the air: only on request, only from a hover, and by the pilot's leave."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from arva_hil.mavlink.codec import Encoder, Parser, command, decode, dialect
from arva_hil.simulated.autopilot import Mode
from tests.search.test_client import BOTH, World, ardupilot, px4
from tests.simulated_px4 import HOLD, POSITION, Px4

MISSION = 4 << 16 | 4 << 24
BEFORE_S = 60.0


def airborne(
    make: Callable[..., Any], *, height: float = 6.0, at: tuple[float, float] = (0.0, 0.0), mode: int | None = None
) -> Any:
    """A vehicle that somebody has flown there, up to second 0, and left in this mode; default: LOITER, or hold."""
    vehicle = make(boot_time=-BEFORE_S)
    now, encoder = -BEFORE_S, Encoder(255, 190)
    is_px4 = isinstance(vehicle, Px4)

    def tell(message: Any, then_s: float) -> None:
        nonlocal now
        vehicle.feed(encoder.pack(message), now)
        for _ in range(round(then_s * 10)):
            now += 0.1
            vehicle.poll(now)

    def order(number: int, *params: float, then_s: float = 0.1) -> None:
        tell(command(1, 1, number, *params), then_s)

    def enter(wanted: int, then_s: float = 0.1) -> None:
        main, sub = (wanted >> 16 & 255, wanted >> 24) if is_px4 else (wanted, 0)
        order(dialect.MAV_CMD_DO_SET_MODE, 1, main, sub, then_s=then_s)

    if is_px4:
        nowhere = (math.nan,) * 3
        order(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        order(dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, *nowhere, vehicle._ground_amsl + height, then_s=20)
    else:
        enter(Mode.GUIDED)
        order(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        order(dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height, then_s=15)
        place = (*at, -height)
        tell(
            dialect.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0xFF8, *place, 0, 0, 0, 0, 0, 0, 0, 0),
            15,
        )
    tell(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), -now - 0.5)
    enter((HOLD if is_px4 else Mode.LOITER) if mode is None else mode, then_s=0.5)
    return vehicle


def taking_over(vehicle: Any, **client: Any) -> World:
    return World(vehicle, {"take_over": True} | client)


@BOTH
def test_a_vehicle_that_is_armed_is_left_alone_unless_asked_for(make: Callable[..., Any]) -> None:
    world = World(airborne(make))
    kind, how = world.end()
    assert (kind, how.partition(":")[0]) == ("failed", "the vehicle is armed already")
    assert world.orders() == []


@BOTH
def test_a_vehicle_that_hovers_is_taken_over_searches_and_lands(make: Callable[..., Any]) -> None:
    world = taking_over(airborne(make))
    assert world.end() == ("found", "found")
    assert not world.armed
    commands = {getattr(m, "command", None) for m in world.orders()}
    assert not commands & {dialect.MAV_CMD_COMPONENT_ARM_DISARM, dialect.MAV_CMD_NAV_TAKEOFF}
    assert "taking over" in " ".join(world.said)


def test_heights_are_above_home_and_places_from_where_it_hovered() -> None:
    world = taking_over(airborne(ardupilot, at=(10.0, -4.0)))
    world.reach("flying")
    world.until(lambda: len(world.rows) > 2)
    first = world.rows[0]
    assert (first.north_m, first.east_m) == pytest.approx((0.0, 0.0), abs=0.3)
    assert first.down_m == pytest.approx(-6.0, abs=0.3)
    world.until(lambda: world.ned[2] > -1.6)
    assert world.client.origin is not None
    assert world.client.origin.lla([0.0, 0.0, 0.0])[2] == pytest.approx(1650.0, abs=0.1)


@pytest.mark.parametrize(
    ("make", "mode", "named"),
    [(ardupilot, Mode.RTL, "RTL"), (ardupilot, Mode.STABILIZE, "STABILIZE"), (px4, POSITION, "position")],
)
def test_it_is_not_taken_from_the_pilots_hands_or_a_failsafe(make: Callable[..., Any], mode: int, named: str) -> None:
    world = taking_over(airborne(make, mode=mode), timeout_s=4.0)
    assert world.end() == ("failed", f"the vehicle is not taken over: it is in {named}")
    assert world.orders() == []


def test_it_is_not_taken_over_low_above_home() -> None:
    world = taking_over(airborne(ardupilot, height=0.7), timeout_s=4.0)
    kind, how = world.end()
    assert (kind, "m above home, less than 1 m" in how) == ("failed", True)
    assert world.orders() == []


def test_it_is_waited_for_until_it_hovers() -> None:
    world = taking_over(airborne(ardupilot, mode=Mode.GUIDED))
    onward = dialect.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0xDC7, 0, 0, 0, 1.5, 0, 0, 0, 0, 0, 0, 0)
    encoder = Encoder(1, 195)
    for _ in range(8):
        world.others.write(encoder.pack(onward))
        world.pass_s(1.0)
    assert world.orders() == []
    assert "waiting for a hover" in world.said
    world.until(world.orders)


def test_what_stands_on_the_ground_is_not_armed() -> None:
    world = taking_over(ardupilot(), timeout_s=4.0)
    assert world.end() == ("failed", "the vehicle is not taken over: it is not armed")
    assert world.orders() == []


@BOTH
def test_the_pilot_has_the_last_word_from_the_first_moment_on(make: Callable[..., Any]) -> None:
    world = taking_over(airborne(make))
    world.reach("flying")
    world.until(lambda: world.client._commander.authority.in_mode)
    world.pilot(POSITION if isinstance(world.vehicle, Px4) else Mode.LOITER)
    kind, how = world.end()
    assert kind == "failed"
    assert "the pilot or a failsafe has taken over" in how


@BOTH
def test_a_pilot_who_takes_it_before_it_has_come_hears_no_order(make: Callable[..., Any]) -> None:
    world = taking_over(airborne(make))
    world.reach("flying")
    world.pilot(POSITION if isinstance(world.vehicle, Px4) else Mode.RTL)
    kind, how = world.end()
    assert kind == "failed"
    assert "the pilot or a failsafe has taken over" in how
    assert {m.get_type() for m in world.orders()} <= {"SET_POSITION_TARGET_LOCAL_NED"}


@BOTH
def test_a_vehicle_that_does_not_come_is_left_to_whoever_has_it(make: Callable[..., Any]) -> None:
    vehicle = airborne(make)
    feed, parser = vehicle.feed, Parser()

    def deaf(chunk: bytes, now: float, link: int = 0) -> None:
        """It carries out no order for another mode."""
        for packet in parser.feed(chunk):
            if getattr(decode(packet), "command", None) != dialect.MAV_CMD_DO_SET_MODE:
                feed(packet.raw, now)

    vehicle.feed = deaf
    world = taking_over(vehicle)
    kind, how = world.end()
    assert kind == "failed"
    assert "the vehicle does not follow velocities" in how
    assert dialect.MAV_CMD_NAV_LAND not in {getattr(m, "command", None) for m in world.orders()}
    assert world.armed


@BOTH
def test_ctrl_c_before_it_has_come_leaves_it_where_it_was(make: Callable[..., Any]) -> None:
    world = taking_over(airborne(make))
    mode = world.vehicle.mode if isinstance(world.vehicle, Px4) else world.vehicle._pilot.mode
    world.reach("flying")
    world.client.stop()
    world.end()
    ended = world.clock.now()
    world.pass_s(10.0)
    assert world.orders(ended + 0.01) == []
    now = world.vehicle.mode if isinstance(world.vehicle, Px4) else world.vehicle._pilot.mode
    assert now == mode
