"""A vehicle that does not follow its set-points is noticed within seconds; one that is slow or blown about is not."""

from __future__ import annotations

import cmath
import math
import re
from collections.abc import Callable
from typing import Any

import pytest

from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.search.flight.airborne import Deviation, SetPointCheck
from firmware_proto import Channel, Frame, encode
from tests.search.test_client import BOTH, World, ardupilot, px4

SET_POINT = dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
NOT_FOLLOWED = "the vehicle does not follow its set-points"

Change = Callable[[World, Any], bool]  # of a set-point on its way up; returns whether it arrives


def uplink(world: World, change: Change) -> None:
    """Let `change` have each set-point before the vehicle gets it."""
    feed, parser, encoder = world.vehicle.feed, Parser(), Encoder(1, 193)

    def fed(chunk: bytes, now: float, link: int = 0) -> None:
        for packet in parser.feed(chunk):
            if packet.msgid != SET_POINT:
                feed(packet.raw, now, link)
                continue
            message: Any = decode(packet)
            if change(world, message):
                feed(encoder.pack(message), now, link)

    world.vehicle.feed = fed  # type: ignore[method-assign]


def nothing_heard(now: float) -> bytes:
    return encode(Frame(round(now * 5) % 256, 1, (Channel(),)))


def lost(world: World, message: Any) -> bool:
    return world.client._commander.phase.name != "FLYING"


def fence_ahead(world: World, message: Any) -> bool:
    """As AVOID_ENABLE stops it: 4 m north of the take-off point."""
    if world.ned[0] > 4.0:
        message.vx = min(message.vx, 0.0)
    return True


def turned(degrees: float, share: float = 1.0) -> Change:
    def turn(_: World, message: Any) -> bool:
        v = cmath.rect(share, math.radians(degrees)) * complex(message.vx, message.vy)
        message.vx, message.vy = v.real, v.imag
        return True

    return turn


def slower(share: float) -> Change:
    return turned(0.0, share)


@BOTH
@pytest.mark.parametrize("change", [lost, fence_ahead])
def test_one_that_does_not_move_is_said_flown_another_way_once_and_landed(
    make: Callable[[], Any], change: Change
) -> None:
    world = World(make())
    world.reach("flying")
    begun = world.clock.now()
    uplink(world, change)
    kind, how = world.end(60.0)
    if change is lost and make is px4:  # it leaves OFFBOARD by itself
        assert how.startswith("the mode is position")
        return
    assert kind == "failed"
    assert not world.armed
    if change is lost:  # the first order that is not followed may be one to sink
        assert how.startswith((NOT_FOLLOWED, "it is on the ground, or"))
        return
    assert how.startswith(NOT_FOLLOWED)
    (said,) = [text for text in world.said if text.startswith(NOT_FOLLOWED)]
    assert "a fence or an obstacle ahead" in said
    landing = min(row.time_s for row in world.rows if row.phase == "landing")
    assert landing - begun < 30.0
    assert math.hypot(*world.ned[:2]) < 12.0


@pytest.mark.parametrize(("make", "degrees"), [(ardupilot, 90.0), (px4, -90.0), (ardupilot, 180.0)])
def test_one_that_flies_another_way_than_ordered_is_landed_at_once(make: Callable[[], Any], degrees: float) -> None:
    world = World(make())
    uplink(world, turned(degrees))
    how = world.fail(60.0)
    off = re.match(rf"{NOT_FOLLOWED}: it flies (\d+)° off \(", how)
    assert off, how
    assert float(off[1]) == pytest.approx(abs(degrees), abs=10.0)
    flown = [row for row in world.rows if row.phase == "flying"]
    assert flown[-1].time_s - flown[0].time_s < 10.0
    assert math.hypot(*world.ned[:2]) < 10.0
    assert not world.armed


FAR = {"area": (-30.0, -10.0, 30.0, 10.0), "limit_s": 40.0}


@pytest.mark.parametrize(
    ("make", "options", "change", "plan"),
    [
        pytest.param(px4, {}, slower(0.3), {}, id="slow"),
        pytest.param(ardupilot, {"wind": (-9.0, 6.0, 0.0)}, slower(0.5), {}, id="wind"),
        pytest.param(px4, {"gps_noise_m": 3.0, "seed": 3}, slower(0.6), {}, id="walk"),
        pytest.param(px4, {}, None, {"take_off": 2.0, "height": 12.0}, id="climb"),
        pytest.param(ardupilot, {}, None, {"speed": 8.0}, id="fast"),
        pytest.param(px4, {}, None, {"speed": 0.2}, id="creeping"),
    ],
)
def test_one_that_is_slow_blown_about_or_climbs_is_let_fly(
    make: Callable[..., Any], options: dict[str, Any], change: Change | None, plan: dict[str, Any]
) -> None:
    world = World(make(**options), **FAR | plan)
    world.port.says = nothing_heard
    if change:
        uplink(world, change)
    kind, how = world.end(300.0)
    assert kind == "not found", how
    assert NOT_FOLLOWED not in " ".join(world.said)


# -- The check of set-points against the motion reported, on motions made up ------------------------------


STEP_S = 0.2


def first(
    flown: Callable[[float, complex], complex],
    *,
    order: Callable[[float], complex] = lambda t: 1 + 0j,
    jump_m: float = 0.0,
    reported: float = 1.0,
    until_s: float = 60.0,
) -> tuple[float, Deviation] | None:
    """The first deviation of a vehicle that flies `flown(t, order)`, and when.

    `jump_m`: of its position, each 10 s. `reported`: the share of its velocity that it reports.
    """
    check, place = SetPointCheck(), 0j
    for step in range(round(until_s / STEP_S)):
        t = step * STEP_S
        ordered = order(t)
        moving = flown(t, ordered) if step else 0j
        place += moving * STEP_S + (jump_m if step % 50 == 49 else 0.0)
        velocity = reported * moving
        vectors = ((v.real, v.imag, 0.0) for v in (ordered, place, velocity))
        if deviation := check.observe(t, *vectors):
            return t, deviation
    return None


def aside(degrees: float, share: float = 1.0) -> Callable[[float, complex], complex]:
    return lambda t, order: order * cmath.rect(share, math.radians(degrees))


@pytest.mark.parametrize("degrees", [90.0, -90.0, 120.0, 180.0])
def test_a_vehicle_that_flies_elsewhere_is_known_after_its_window_with_its_direction(degrees: float) -> None:
    found = first(aside(degrees))
    assert found is not None
    after_s, deviation = found
    assert 5.0 <= after_s < 7.0
    assert deviation.off_deg == pytest.approx(degrees, abs=1.0)
    assert deviation.seconds == pytest.approx(5.0, abs=0.3)
    assert deviation.ordered_m == pytest.approx(5.0, abs=0.3)
    assert deviation.flown_m == pytest.approx(5.0, abs=0.3)


@pytest.mark.parametrize(("speed", "at_most_s"), [(1.0, 7.0), (0.5, 12.0), (4.0, 10.0)])
def test_a_vehicle_that_stands_hardly_moves(speed: float, at_most_s: float) -> None:
    found = first(lambda t, order: 0j, order=lambda t: complex(0.0, speed))
    assert found is not None
    assert found[0] < at_most_s
    assert found[1].off_deg is None
    assert found[1].flown_m == pytest.approx(0.0)


def test_one_that_stops_later_is_known_too() -> None:
    found = first(lambda t, order: order if t < 30.0 else 0j)
    assert found is not None
    assert 33.5 < found[0] < 36.0


def ramp(acceleration: float) -> Callable[[float, complex], complex]:
    """The velocity of a vehicle whose acceleration is limited."""
    velocity = 0j

    def flown(t: float, order: complex) -> complex:
        nonlocal velocity
        lag = order - velocity
        velocity += lag * min(1.0, acceleration * STEP_S / max(abs(lag), 1e-9))
        return velocity

    return flown


@pytest.mark.parametrize(
    ("flown", "order"),
    [
        pytest.param(aside(0.0), lambda t: 1 + 0j, id="follows"),
        pytest.param(aside(0.0, 0.3), lambda t: 1 + 0j, id="slow"),
        pytest.param(aside(0.0, 0.06), lambda t: 5 + 0j, id="limited to 0.3 m/s"),
        pytest.param(aside(45.0), lambda t: 1 + 0j, id="blown aside"),
        pytest.param(ramp(0.5), lambda t: complex(1.0 if t % 12 < 6 else -1.0), id="back and forth"),
        pytest.param(ramp(1.0), lambda t: complex(5.0 if t % 60 < 30 else -5.0), id="fast, back and forth"),
        pytest.param(ramp(0.5), lambda t: cmath.rect(1.0, t / 2), id="circle"),
        pytest.param(aside(0.0, 0.0), lambda t: 0j, id="hover"),
        pytest.param(lambda t, order: order + cmath.rect(0.4, t), lambda t: 0.4 + 0j, id="gusts"),
    ],
)
def test_no_vehicle_that_does_what_it_can_deviates(
    flown: Callable[[float, complex], complex], order: Callable[[float], complex]
) -> None:
    assert first(flown, order=order, until_s=120.0) is None


def test_a_position_that_jumps_and_a_velocity_that_is_not_reported_are_no_deviation() -> None:
    assert first(aside(0.0), jump_m=-9.0) is None
    assert first(aside(0.0), reported=0.0) is None


def test_after_a_gap_or_a_restart_it_begins_again() -> None:
    check = SetPointCheck()
    for gap, restarted in ((1.2, False), (STEP_S, True)):
        for begin in (0.0, 4.6 + gap):
            for step in range(24):
                assert check.observe(begin + step * STEP_S, (1.0, 0.0, 0.0), (0.0,) * 3, (0.0,) * 3) is None
            if restarted:
                check.restart()
        check.restart()
