"""Extremum seeking: closed loops with the project's receiver, and frames written by hand."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.search.strategies.extremum import Extremum, minimum
from arva_hil.search.strategies.strategy import Observation
from tests.search.world import PAPER, fly


def frame(time_s: float, d_m: float, north: float = 0.0, east: float = 0.0) -> Observation:
    """d_m 0: nothing is heard."""
    return Observation(time_s, (north, east, -1.0), np.eye(3), round(100 * d_m) or -1, 0, 0 < d_m <= 3)


@pytest.mark.parametrize("lag_s", [0.3, 2.0])
def test_the_faster_it_may_fly_the_sooner_it_is_there_though_the_vehicle_is_slow_to_follow(lag_s: float) -> None:
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
        seeker.observe(frame(k, 20 + math.sin(k), north=math.cos(k), east=math.sin(k)))
    assert math.hypot(*seeker.velocity(29 + late_s, (north, east, -1.0))) <= speed * (1 + 1e-9)


def test_goes_back_to_where_it_was_heard_best() -> None:
    seeker = Extremum(1.0)
    for k, d in enumerate([30, 29, 31, 20, 45]):
        seeker.observe(frame(k, d, north=40.0 * k))
    for k in range(5, 12):
        seeker.observe(frame(k, 0, north=120.0, east=200.0))
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
