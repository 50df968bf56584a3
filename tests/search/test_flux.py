"""The flux line and the cross: closed loops with the project's receiver, and frames written by hand."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.search.strategies.cross import Cross, middle
from arva_hil.search.strategies.extremum import Extremum, minimum
from arva_hil.search.strategies.flux import Flux
from arva_hil.search.strategies.strategy import Observation, Velocity
from tests.search.world import PAPER, fly

NORTH = np.eye(3)
SPEED = 2.0


def frame(time_s: float, d_m: float, north: float = 0.0, east: float = 0.0, delta: int = 0) -> Observation:
    """Heard with the receiver's nose to the north; d_m 0: nothing is heard."""
    inner = 0 < d_m <= 3
    return Observation(time_s, (north, east, -1.0), NORTH, round(100 * d_m) or -1, delta, inner)


def told(flux: Flux, *frames: Observation) -> Velocity:
    """What is flown after these frames."""
    for observation in frames:
        flux.observe(observation)
    return flux.velocity(frames[-1].time_s, frames[-1].position)


def course(velocity: Velocity) -> float:
    """Degrees from north."""
    return math.degrees(math.atan2(velocity[1], velocity[0]))


# -- closed loops ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pitch", [0, 30, 60, 90])
def test_too_deep_for_the_third_antenna(pitch: int) -> None:
    """At an upright dipole d is least on a ring, and nothing is heard amid it."""
    deep = f"{{id: 1, enu: [12, 9, -4], attitude: {{pitch: {pitch}}}}}"
    flight = fly(Flux(1.0), deep)
    assert flight.error_m < 2
    assert not any(observation.inner for observation in flight.heard)


@pytest.mark.parametrize("seed", range(3))
def test_from_where_it_is_hardly_heard(seed: int) -> None:
    flight = fly(Flux(1.0), "{id: 1, enu: [54, 0, 0], attitude: {yaw: 70}}", yaw=-2.0, seed=seed)
    assert sum(not observation.heard for observation in flight.heard) > 3
    assert flight.error_m < 1


# -- along the line ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("delta", [-60, 0, 45])
def test_follows_the_line_with_the_speed_of_equation_10(delta: int) -> None:
    far, near = told(Flux(SPEED), frame(0, 30, delta=delta)), told(Flux(SPEED), frame(0, 4, delta=delta))
    assert course(far) == pytest.approx(delta)
    for velocity, d in [(far, 30), (near, 4)]:
        assert math.hypot(*velocity) == pytest.approx(SPEED * 0.8 * d / math.hypot(1, 0.8 * d))


def test_keeps_its_way_where_the_receiver_says_the_other() -> None:
    flux = Flux(SPEED)
    assert course(told(flux, frame(0, 30, delta=70), frame(1, 29, delta=88))) == pytest.approx(88)
    assert course(told(flux, frame(2, 28, delta=-75))) == pytest.approx(105)
    assert course(told(flux, frame(3, 27, delta=-40))) == pytest.approx(140)


def test_turns_round_when_d_rises_and_not_for_noise() -> None:
    flux = Flux(SPEED)
    noise = [20.5, 19.7, 20.8, 20.1, 20.9, 20.2, 20.6]
    north, _ = told(flux, *(frame(k, d, north=k) for k, d in enumerate(noise)))
    assert north > 0
    north, _ = told(flux, *(frame(10 + k, 21 + k, north=10 + k) for k in range(3)))
    assert north < 0
    north, _ = told(flux, *(frame(20 + k, 23 - k, north=10 - k) for k in range(8)))
    assert north < 0


def test_does_not_turn_round_and_round() -> None:
    """Wherever it flies d rises; in the end it goes back to search crosswise."""
    flux, way = Flux(SPEED), []
    for k in range(80):
        way.append(told(flux, frame(k, 20 + 0.3 * k))[0] > 0)
    assert sum(a != b for a, b in pairwise(way)) == 3


def test_turns_back_when_it_hears_nothing_for_a_while() -> None:
    flux = Flux(SPEED)
    assert told(flux, frame(0, 48), frame(1, 49, north=2), frame(3, 0, north=6))[0] > 0
    ahead = told(flux, frame(5, 0, north=10, east=5))
    assert course(ahead) == pytest.approx(math.degrees(math.atan2(-5, -10)))
    assert told(flux, frame(9, 49, north=4))[0] < 0


def test_swings_ever_wider_when_it_hears_nothing_at_all() -> None:
    flux, north, turns = Flux(SPEED), 0.0, [0.0]
    ahead = told(flux, frame(0, 48))[0]
    for k in range(1, 100):
        north += ahead
        ahead, before = told(flux, frame(k, 0, north=north))[0], ahead
        turns += [north] * (ahead * before < 0)
    assert len(turns) > 4
    assert all(b < 2 * min(turns[:k]) or b > 2 * max(turns[:k]) for k, b in enumerate(turns[2:], 2))


# -- the cross ---------------------------------------------------------------------------------------------


def flown(cross: Cross, d: list[float], place: tuple[float, float] = (0.0, 0.0), least: float = 1.5) -> list[float]:
    """Fly it in steps of half a metre over a d that is least at `place`; d: what is heard, appended."""
    at = cross.centre
    for k in range(400):
        if cross.settled:
            break
        d.append(math.hypot(at[0] - place[0], at[1] - place[1], least))
        cross.observe(k, (*at, -1.0), d[-1])
        north, east = cross.target((*at, -1.0))
        way = math.hypot(north - at[0], east - at[1])
        share = min(1.0, 0.5 / way) if way else 0.0
        at = at[0] + share * (north - at[0]), at[1] + share * (east - at[1])
    return d


@given(st.floats(-8, 8), st.floats(-8, 8), st.floats(0, 6.3), st.floats(0.3, 5))
def test_the_cross_ends_where_d_is_least(north: float, east: float, course: float, least: float) -> None:
    cross = Cross((0.0, 0.0), course)
    heard = flown(cross, [], (north, east), least)
    assert cross.settled
    assert math.dist(cross.centre, (north, east)) < 0.5
    assert len(heard) < 300


@given(st.dictionaries(st.integers(1, 99), st.floats(0.01, 50), min_size=1), st.integers(-99, 99))
def test_the_middle_of_what_is_alike_on_both_sides_is_its_middle(half: dict[int, float], at: int) -> None:
    arm = [(float(at + side * step), d**-6) for step, d in half.items() for side in (-1, 1)]
    assert middle(arm) == pytest.approx(at, abs=1e-6)


def test_silence_is_no_place() -> None:
    cross, at = Cross((0.0, 0.0), 0.0), (0.0, 0.0)
    for k in range(200):
        cross.observe(k, (*at, -1.0), math.inf)
        at = cross.target((*at, -1.0))
        assert math.dist(at, (0.0, 0.0)) < 5
        assert not cross.settled
    assert cross.centre == (0.0, 0.0)


def test_silence_does_not_settle_what_the_arms_before_did_not() -> None:
    cross, at = Cross((0.0, 0.0), 0.0), (0.0, 0.0)
    for k in range(400):
        moved = math.dist(cross.centre, (6, 6)) < 1
        cross.observe(k, (*at, -1.0), math.inf if moved else math.hypot(at[0] - 6, at[1] - 6, 2))
        north, east = cross.target((*at, -1.0))
        share = min(1.0, 0.5 / max(1e-9, math.hypot(north - at[0], east - at[1])))
        at = at[0] + share * (north - at[0]), at[1] + share * (east - at[1])
    assert moved
    assert not cross.settled


def test_fifty_readings_a_second_at_places_that_scatter() -> None:
    rng, cross, at = np.random.default_rng(1), Cross((0.0, 0.0), 0.5), (0.0, 0.0)
    for k in range(50 * 90):
        seen = (at[0] + rng.normal(0, 0.3), at[1] + rng.normal(0, 0.3), -1.0)
        cross.observe(k / 50, seen, math.hypot(at[0] - 1, at[1] + 2, 1.5))
        if cross.settled:
            break
        north, east = cross.target(seen)
        away = max(1.0, math.hypot(north - seen[0], east - seen[1]))
        at = at[0] + (north - seen[0]) / away / 50, at[1] + (east - seen[1]) / away / 50
    assert cross.settled
    assert math.dist(cross.centre, (1, -2)) < 0.25


# -- Extremum seeking: closed loops with the project's receiver, and frames written by hand ---------------


def reading(time_s: float, d_m: float, north: float = 0.0, east: float = 0.0) -> Observation:
    """d_m 0: nothing is heard."""
    return Observation(time_s, (north, east, -1.0), np.eye(3), round(100 * d_m) or -1, 0, 0 < d_m <= 3)


@pytest.mark.parametrize("lag_s", [0.3, 2.0])
def test_a_higher_speed_ends_sooner_though_the_vehicle_is_slow_to_follow(lag_s: float) -> None:
    took = []
    for speed in (1.0, 3.0):
        flights = [fly(Extremum(speed), one, height_m=3.0, lag_s=lag_s, seed=seed) for seed, one in enumerate(PAPER)]
        assert max(flight.error_m for flight in flights) < 1.3
        took.append(sum(flight.time_s for flight in flights))
    assert took[1] < 0.8 * took[0]


def test_needs_no_direction() -> None:
    """Where the receiver's nose points makes no difference while it is level."""
    a, b = (fly(Extremum(1.0), PAPER[0], yaw=yaw) for yaw in (0.0, 2.0))
    assert a.error_m == pytest.approx(b.error_m, abs=0.3)


@given(st.floats(-100, 100), st.floats(-100, 100), st.floats(0, 30), st.floats(0.2, 10))
def test_never_too_fast(north: float, east: float, late_s: float, speed: float) -> None:
    seeker = Extremum(speed)
    for k in range(30):
        seeker.observe(reading(k, 20 + math.sin(k), north=math.cos(k), east=math.sin(k)))
    assert math.hypot(*seeker.velocity(29 + late_s, (north, east, -1.0))) <= speed * (1 + 1e-9)


def test_goes_back_to_where_it_was_heard_best() -> None:
    seeker = Extremum(1.0)
    for k, d in enumerate([30, 29, 31, 20, 45]):
        seeker.observe(reading(k, d, north=40.0 * k))
    for k in range(5, 12):
        seeker.observe(reading(k, 0, north=120.0, east=200.0))
    assert seeker.velocity(11.0, (120.0, 200.0, -1.0)) == pytest.approx((0.0, -1.0), abs=0.05)


def test_no_false_minimum_holds_it() -> None:
    """It lies level and two metres deep: d is least above it and, less so, 3.7 m north and south of that."""
    flight = fly(Extremum(1.0), "{id: 1, enu: [0, 0, -2]}", start=(-28.0, 0.0))
    assert flight.error_m < 1


@pytest.mark.parametrize(
    ("transmitter", "start"),
    [
        ("{id: 1, enu: [0, 0, -1.75], attitude: {roll: 19, pitch: -8, yaw: -136}}", (6.0, -19.0)),
        ("{id: 1, enu: [0, 0, -1.95], attitude: {roll: -108, pitch: 1, yaw: -90}}", (9.0, -18.0)),
    ],
)
def test_a_centre_that_swings_about_the_place_is_there(transmitter: str, start: tuple[float, float]) -> None:
    """From 5 m above it the minimum seen on a round goes to and fro by more than a third of the radius."""
    flight = fly(Extremum(1.0), transmitter, start=start, height_m=3.0)
    assert flight.error_m < 1
    assert flight.time_s < 300


def test_goes_to_what_it_has_found() -> None:
    seeker = Extremum(1.0)
    found = fly(seeker, PAPER[1]).found
    assert found is not None
    assert seeker.velocity(1e3, (found.north + 5, found.east, -1.0)) == pytest.approx((-1.0, 0.0))


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(1, 3), st.floats(0, 6.3))
def test_sees_the_minimum_from_a_circle_round_it(north: float, east: float, least: float, start: float) -> None:
    heard: deque[tuple[float, float, float, float]] = deque()
    for k in range(24):
        n, e = 2 * math.cos(start + k * math.pi / 12), 2 * math.sin(start + k * math.pi / 12)
        heard.append((k * math.pi / 12, n, e, 1 / math.hypot(n - north, e - east, least)))
    n, e, d = minimum(heard)
    off = math.hypot(north, east)
    assert math.hypot(n - north, e - east) <= 0.3 * off + 1e-9
    assert 1 / max(near for *_, near in heard) - 1e-9 <= d <= 1 / min(near for *_, near in heard) + 1e-9
