"""The flux line, the cross, the fit of dipoles, and when a place agrees with what was heard."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise

import magpylib
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from arva_hil.model.field import Transmitters
from arva_hil.model.receiver import Antennas, Zone
from arva_hil.search.strategies.agreement import Evidence
from arva_hil.search.strategies.dipole import (
    MOST,
    POSE_ERRORS,
    DipoleReadings,
    Reading,
    evaluate,
    likely_pose_errors,
    of_receiver,
    refine,
    seeds,
)
from arva_hil.search.strategies.estimate import Estimate
from arva_hil.search.strategies.extremum import Extremum, minimum
from arva_hil.search.strategies.flux import Cross, Flux, middle
from arva_hil.search.strategies.strategy import Observation, Strategy, Velocity
from tests.every import every
from tests.paper_receiver import Receiver
from tests.search.world import PAPER, fly, fly_to_buried

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


@every("pitch", [0, 30, 60, 90])
def test_too_deep_for_the_third_antenna(pitch: int) -> None:
    """At an upright dipole d is least on a ring, and nothing is heard amid it."""
    deep = f"{{id: 1, enu: [12, 9, -4], attitude: {{pitch: {pitch}}}}}"
    flight = fly(Flux(1.0), deep)
    assert flight.error_m < 2
    assert not any(observation.inner for observation in flight.heard)


@every("seed", range(3))
def test_from_where_it_is_hardly_heard(seed: int) -> None:
    flight = fly(Flux(1.0), "{id: 1, enu: [54, 0, 0], attitude: {yaw: 70}}", yaw=-2.0, seed=seed)
    assert sum(not observation.heard for observation in flight.heard) > 3
    assert flight.error_m < 1


# -- along the line ----------------------------------------------------------------------------------------


@every("delta", [-60, 0, 45])
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


def test_a_higher_speed_ends_sooner_though_the_vehicle_is_slow_to_follow() -> None:
    took = []
    for speed in (1.0, 3.0):
        flights = [fly(Extremum(speed), one, height_m=3.0, lag_s=2.0, seed=seed) for seed, one in enumerate(PAPER)]
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


def test_its_circle_drifts_to_a_far_minimum_no_faster_than_it_can_follow() -> None:
    """The minimum is 40 m north."""
    seeker, drifts = Extremum(1.0), []
    for k in range(60):
        north, east = 3 * math.cos(0.25 * k), 3 * math.sin(0.25 * k)
        seeker.observe(reading(k, math.hypot(40 - north, east), north=north, east=east))
        drifts.append(math.hypot(*seeker._drift))
    assert max(drifts) == pytest.approx(0.8)


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


# -- A place agrees with what was heard, or it does not, whatever strategy has found it -------------------


def agrees(heard: list[Observation], place: tuple[float, float], height_m: float = 1.0) -> bool:
    evidence = Evidence()
    for observation in heard:
        evidence.add(observation)
    judgement = evidence.judge(place)
    return judgement is not None and judgement.agrees(height_m)


@pytest.mark.parametrize(
    ("strategy", "gps_m", "aside_m"),
    [
        (Flux, 0.1, (0.0, -15.0)),
        (Estimate, 0.0, (7.7, 0.0)),
    ],
)
def test_what_was_found_agrees_and_what_lies_elsewhere_does_not(
    strategy: type[Strategy], gps_m: float, aside_m: tuple[float, float]
) -> None:
    flight = fly(strategy(1.0), PAPER[1], height_m=3.0, gps_m=gps_m, seed=1)
    north, east = flight.found[:2]
    assert agrees(flight.heard, (north, east), 3.0)
    assert not agrees(flight.heard, (north + aside_m[0], east + aside_m[1]), 3.0)


def test_below_a_slope_the_depth_counts_from_the_ground() -> None:
    """The ground is 20 m below the take-off point there."""
    fall = 0.8
    transmitter = f"{{id: 1, enu: [-4, 25, {-25 * fall - 1}], attitude: {{roll: 20, pitch: 30, yaw: 50}}}}"
    flight = fly(Estimate(1.5), transmitter, height_m=13.0, fall=fall)
    assert flight.found is not None
    assert flight.error_m < 0.5
    assert flight.found.down == pytest.approx(25 * fall + 1, abs=0.3)
    assert agrees(flight.heard, flight.found[:2], 3.0)


class Late(Flux):
    """Told what was heard some frames ago as if that were now; `told`: all of that."""

    def __init__(self, speed: float, frames: int) -> None:
        super().__init__(speed)
        self.told: list[Observation] = []
        self._late = deque[Observation](maxlen=frames + 1)

    def observe(self, observation: Observation) -> None:
        self._late.append(observation)
        then = self._late[0]
        now = observation._replace(d_cm=then.d_cm, delta_deg=then.delta_deg, inner=then.inner)
        self.told.append(now)
        super().observe(now)


def test_what_readings_of_five_seconds_ago_lead_to_does_not_agree() -> None:
    late = Late(1.0, 5)
    flight = fly(late, PAPER[0], height_m=3.0)
    assert flight.found is not None
    assert flight.error_m > 2
    assert not agrees(late.told, flight.found[:2], 3.0)


def test_the_same_d_everywhere_is_no_transmitter() -> None:
    """Whatever the direction: such a one would have to lie deep, or be stronger or weaker than any."""
    rng, heard = np.random.default_rng(1), []
    for k in range(60):
        at = (3 * math.cos(k / 4), 3 * math.sin(k / 4), -3.0)
        heard.append(Observation(k, at, np.eye(3), 3000, int(rng.integers(-89, 90)), False))
    assert not agrees(heard, (0.0, 0.0), 3.0)


def test_readings_that_are_no_numbers_say_nothing() -> None:
    nowhere = [Observation(k, (math.nan, k, -1.0), np.eye(3), 500, 0, False) for k in range(9)]
    odd = [Observation(k, (k, 0.0, -1.0), np.full((3, 3), math.inf), 500, 0, False) for k in range(9)]
    assert not agrees(nowhere + odd, (0.0, 0.0))


def test_readings_of_one_that_has_moved_contradict_the_place_judged_before() -> None:
    """What is read at the end of the circle is told again, as if that were 4 m beside."""
    flight = fly_to_buried(0, Estimate(1.0), height_m=3.0)
    assert flight.found is not None
    evidence, newest = Evidence(), flight.heard[-5:]
    for o in flight.heard:
        evidence.add(o)
    assert evidence.contradictions(newest) == []
    evidence.judge(flight.found[:2])
    assert evidence.contradictions(newest) == [False] * 5
    beside = [o._replace(time_s=o.time_s + 9, position=(o.position[0] + 4, *o.position[1:])) for o in newest]
    for o in beside:
        evidence.pose(o)
    assert evidence.contradictions(beside) == [True] * 5


def test_the_attitude_of_a_reading_is_that_of_its_own_pose() -> None:
    evidence, turned = Evidence(), np.diag([1.0, -1.0, -1.0])
    for time_s, rotation in ((0.0, np.eye(3)), (1.0, turned)):
        evidence.add(Observation(time_s, (time_s, 0.0, -3.0), rotation, 500, 0, False))
    assert (evidence.at(0.0)[1] == np.eye(3)).all()
    assert (evidence.at(0.9)[1] == turned).all()


# The fit of a dipole: against magpylib, finite differences, and readings made up by the receiver's own model


KAPPA_EQ = 1.542


def readings(rng: np.random.Generator, n: int, inner: bool = False) -> DipoleReadings:
    """Anything, heard by a receiver at any attitude."""
    o = DipoleReadings()
    for at, R in zip(rng.uniform(-20, 20, (n, 3)), Rotation.random(n, rng).as_matrix(), strict=True):
        o.add(at, R, rng.uniform(3, 40), rng.uniform(-1.5, 1.5), inner)
    return o


def hypotheses(rng: np.random.Generator, k: int) -> np.ndarray:
    place, moment = rng.uniform((30, -20, -20), (70, 20, 20), (k, 3)), rng.normal(size=(k, 3))
    return np.concatenate([place, moment, np.zeros((k, 1))], axis=1)


@pytest.mark.parametrize("inner", [False, True])
def test_unequal_antennas_change_readings_as_the_fit_assumes(inner: bool) -> None:
    rng = np.random.default_rng(8)
    (x,), places, turns = hypotheses(rng, 1), rng.uniform(-20, 20, (9, 3)), Rotation.random(9, rng)
    exact, unequal = DipoleReadings(), DipoleReadings()
    gains = np.array([1.002, 0.997, 1.001])
    for at, turn in zip(places, turns, strict=True):
        rho, m = np.linalg.norm(at - x[:3]), x[3:6]
        n = (at - x[:3]) / rho
        h = turn.inv().apply((3 * (m @ n) * n - m) / rho**3)
        for o, (hx, hy, hz) in (exact, h), (unequal, gains * h):
            size = math.hypot(hx, hy, hz if inner else 0.0)
            o.add(at, turn.as_matrix(), size ** (-1 / 3), math.atan2(hy, hx), inner)
    slopes = of_receiver(x[None], exact)[:, :3]
    changed = evaluate(x[None], exact, 0.0).error - evaluate(x[None], unequal, 0.0).error
    expected = (np.log(gains) @ slopes)[0]
    told = exact.told.copy()
    told[:2] = False  # number 0 is the prior
    np.testing.assert_allclose(changed[0, told], expected[told], atol=2e-5)
    assert np.abs(expected[told]).max() > 1e-3


def lying(seed: int) -> tuple[Receiver, np.ndarray, np.ndarray]:
    """A reference transmitter at any attitude; also the hypothesis that is true, and the way of a vehicle past it."""
    rng = np.random.default_rng(seed)
    place, R = np.array([*rng.uniform(-5, 5, 2), rng.uniform(0, 1.5)]), Rotation.random(rng=rng).as_matrix()
    receiver = Receiver(Transmitters((1,), place[None], R[None], np.ones(1)), Antennas(), seed=seed)
    azimuth, across = rng.uniform(0, 2 * math.pi), rng.uniform(1, 3)
    along = np.linspace(-20, 8, 29)
    c, s = math.cos(azimuth), math.sin(azimuth)
    way = np.stack([place[0] + along * c - across * s, place[1] + along * s + across * c, 0 * along - 1], axis=1)
    return receiver, np.array([*place, *R[:, 0] / KAPPA_EQ, 0.0]), way


def listen(receiver: Receiver, way: np.ndarray, pose_error: float = 0.0, seed: int = 0) -> DipoleReadings:
    rng = np.random.default_rng(seed)
    o = DipoleReadings()
    for at in way:
        slot = receiver.read(at, np.eye(3)).channels[0]
        told = at + rng.normal(scale=pose_error, size=3) if pose_error else at
        o.add(told, np.eye(3), slot.d_cm / 100, math.radians(slot.delta_deg), slot.zone == Zone.INNER)
    return o


@pytest.mark.parametrize("inner", [False, True])
def test_the_field_is_the_one_of_magpylib(inner: bool) -> None:
    rng = np.random.default_rng(1)
    x, n = hypotheses(rng, 4), 30
    at, R = rng.uniform(-20, 20, (n, 3)), Rotation.random(n, rng)
    o = DipoleReadings()
    for place, matrix in zip(at, R.as_matrix(), strict=True):
        o.add(place, matrix, 10.0, 0.0, inner)
    error = evaluate(x, o, 0.1).error.reshape(4, n + 1, 2)[:, 1:]
    for k in range(4):
        h = R.inv().apply(magpylib.misc.Dipole(x[k, :3], moment=x[k, 3:6]).getH(at)) * 4 * math.pi
        size = np.linalg.norm(h, axis=1) if inner else np.hypot(h[:, 0], h[:, 1])
        assert error[k, :, 0] == pytest.approx(np.log(size) + 3 * math.log(10), abs=1e-9)
        angle = np.zeros(n) if inner else np.arctan(h[:, 1] / h[:, 0])
        assert np.sin(error[k, :, 1] - angle) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("inner", [False, True])
def test_its_derivatives_are_those_of_its_errors(inner: bool) -> None:
    rng = np.random.default_rng(2)
    o, x = readings(rng, 20, inner), hypotheses(rng, 3)
    now, step = evaluate(x, o, 0.1), 1e-6
    for i in range(7):
        aside = np.zeros(7)
        aside[i] = step
        difference = evaluate(x + aside, o, 0.1).error - evaluate(x - aside, o, 0.1).error
        difference = np.remainder(difference + math.pi / 2, math.pi) - math.pi / 2  # over the edge at ±90°
        gradient = np.sum(now.weight * now.error * difference, axis=1) / (2 * step)
        assert now.gradient[:, i] == pytest.approx(gradient, rel=1e-4, abs=1e-4)


def leans_with(step: tuple[float, float, float], attitudes: Rotation, inner: bool) -> None:
    """Its slope over roll, pitch, or a turn of the compass in place of one of the mount, is that of its errors."""
    rng = np.random.default_rng(2)
    at, x, size = rng.uniform(-20, 20, (20, 3)), hypotheses(rng, 3), max(step)

    def turned(roll: float, pitch: float, compass: float) -> DipoleReadings:
        o, by_compass = DipoleReadings(), Rotation.from_rotvec([0, 0, compass])
        by_mount = Rotation.from_rotvec([roll, pitch, -compass])
        for place, matrix in zip(at, (by_compass * attitudes * by_mount).as_matrix(), strict=True):
            o.add(place, matrix, 10.0, 0.0, inner)
        return o

    x[:, 6] = 1.0
    difference = evaluate(x, turned(*step), 0.1).error - evaluate(x, turned(*(-one for one in step)), 0.1).error
    difference = np.remainder(difference + math.pi / 2, math.pi) - math.pi / 2  # over the edge at ±90°
    slopes = of_receiver(x, turned(0.0, 0.0, 0.0))[:, 3 + step.index(size)]
    assert slopes == pytest.approx(difference / (2 * size), rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("inner", [False, True])
def test_its_slopes_over_roll_and_pitch_are_those_of_its_errors(inner: bool) -> None:
    attitudes = Rotation.random(20, np.random.default_rng(3))
    leans_with((1e-6, 0.0, 0.0), attitudes, inner)
    leans_with((0.0, 1e-6, 0.0), attitudes, inner)


@pytest.mark.parametrize("inner", [False, True])
def test_its_slope_over_a_compass_in_place_of_a_mount_is_that_of_its_errors(inner: bool) -> None:
    rng = np.random.default_rng(3)
    leans = Rotation.from_rotvec(rng.uniform(-0.01, 0.01, (20, 3)) * (1, 1, 0))
    leans_with((0.0, 0.0, 1e-6), Rotation.from_rotvec(rng.uniform(-3, 3, (20, 3)) * (0, 0, 1)) * leans, inner)


def test_the_moment_and_its_opposite_sound_alike() -> None:
    rng = np.random.default_rng(3)
    o, x = readings(rng, 20), hypotheses(rng, 5)
    assert evaluate(x, o, 0.1).cost == pytest.approx(evaluate(x * [1, 1, 1, -1, -1, -1, 1], o, 0.1).cost)


def test_a_receiver_that_hears_delta_turned_round_is_the_same() -> None:
    x = hypotheses(np.random.default_rng(4), 3)
    costs = []
    for delta in (0.4, 0.4 - math.pi):
        o = DipoleReadings()
        o.add((3.0, 2.0, -1.0), np.eye(3), 12.0, delta, False)
        costs.append(evaluate(x, o, 0.1).cost)
    assert costs[0] == pytest.approx(costs[1])


def test_finds_the_place_and_says_how_well() -> None:
    normalised, errors = [], []
    for seed in range(60):
        receiver, truth, way = lying(seed)
        o = listen(receiver, way, pose_error=0.1, seed=seed)
        fit, _ = refine(truth[None], np.full(1, 1e-3), o, 0.1, 10)
        off = fit.x[0, :2] - truth[:2]
        covariance = np.linalg.inv(fit.information[0])[:2, :2]
        normalised.append(off @ np.linalg.solve(covariance, off))
        errors.append(math.hypot(*off))
    assert np.median(errors) < 0.15
    assert 0.5 < np.median(normalised) < 2.5  # 1.39 for two dimensions
    assert np.mean(np.array(normalised) < 9.2) > 0.9  # 0.99


@every("seed", range(6))
def test_from_the_seeds_it_comes_to_the_truth(seed: int) -> None:
    receiver, truth, way = lying(seed)
    o = listen(receiver, way)
    x = seeds(way[0], *[noticed(receiver, way[0])[i] for i in (1, 0)])
    fit, _ = refine(x, np.full(len(x), 1e-2), o, 0.05, 20)
    assert math.dist(fit.x[np.argmin(fit.cost), :2], truth[:2]) < 0.1


def noticed(receiver: Receiver, at: np.ndarray) -> tuple[float, float]:
    """d and δ in metres and radians."""
    slot = receiver.read(at, np.eye(3)).channels[0]
    return slot.d_cm / 100, math.radians(slot.delta_deg)


@given(st.floats(0, 6.28), st.floats(4, 45), st.floats(-4, -0.5))
def test_seeds_say_what_was_heard(bearing: float, d: float, down: float) -> None:
    at = (7.0, -3.0, down)
    o = DipoleReadings()
    o.add(at, np.eye(3), d, bearing, False)
    x = seeds(at, bearing, d)
    fit = evaluate(x, o, 0.1)
    assert np.abs(fit.error[:, 2:]).max() < 1e-6
    assert np.linalg.norm(x[:, 3:6], axis=1) == pytest.approx(1 / KAPPA_EQ)
    assert np.linalg.matrix_rank(x[:, :2] - at[:2]) == 2


@pytest.mark.parametrize("wrong", [0.03, 0.3])
def test_hears_how_wrong_its_poses_are(wrong: float) -> None:
    guesses = []
    for seed in range(20):
        receiver, truth, way = lying(seed)
        o = listen(receiver, way, wrong, seed)
        fit, _ = refine(truth[None], np.full(1, 1e-3), o, wrong, 10)
        (guess,), _ = likely_pose_errors(fit, np.zeros(1, int), o, POSE_ERRORS)
        guesses.append(guess)
    assert wrong / 2 < np.median(guesses) < 2 * wrong


def test_silence_speaks_against_a_transmitter_near_by_and_for_nothing() -> None:
    o = DipoleReadings()
    far, near = np.array([[200.0, 0, 0.5, 0.65, 0, 0, 0]]), np.array([[12.0, 0, 0.5, 0.65, 0, 0, 0]])
    before = [evaluate(x, o, 0.1).cost[0] for x in (far, near)]
    o.add((0.0, 0.0, -1.0), np.eye(3), -0.01, 0.0, False)
    assert evaluate(far, o, 0.1).cost[0] == pytest.approx(before[0])
    assert evaluate(near, o, 0.1).cost[0] > before[1] + 3


def test_one_reading_that_is_nonsense_moves_little() -> None:
    receiver, truth, way = lying(5)
    o = listen(receiver, way)
    o.add(way[10], np.eye(3), 4.0, 1.2, False)
    fit, _ = refine(truth[None], np.full(1, 1e-3), o, 0.05, 10)
    assert math.dist(fit.x[0, :2], truth[:2]) < 0.2


def test_keeps_the_strongest_readings_of_too_many() -> None:
    o = DipoleReadings()
    for d in [*np.linspace(49, 4, 100), -0.01]:
        o.add((0.0, 0.0, -1.0), np.eye(3), d, 0.0, False)
    assert len(o.said) < 101
    silence, *kept = np.exp(-np.sort(o.said[1:].real) / 3)
    assert silence == pytest.approx(50)
    assert min(kept) == pytest.approx(4)
    assert max(kept) < 40
    for _ in range(100):
        o.add((0.0, 0.0, -1.0), np.eye(3), 0.5, 0.0, True)
    assert o.said[0] == 0  # still what is known beforehand


@every("near_m", [0.5, 1.0, 3.0])
def test_an_exact_reading_has_the_variance_of_its_rounding(near_m: float) -> None:
    d, delta = np.random.default_rng(5).uniform((near_m, 0.0), (near_m + 0.1, 60.0), (20_000, 2)).T
    of_field = -3 * np.log(np.round(d, 2) / d)
    of_angle = np.radians(np.round(delta) - delta)
    o = DipoleReadings()
    o.add((0.0, 0.0, -1.0), NORTH, near_m + 0.05, 0.5, inner=False)
    assert o.variance[1] == pytest.approx([of_field.var(), of_angle.var()], rel=0.05)


@given(
    st.lists(
        st.tuples(*[st.floats(-1e6, 1e6)] * 3, st.floats(-1, 700), st.floats(-2, 2), st.booleans()),
        min_size=1,
        max_size=6,
    )
)
def test_whatever_it_hears_it_stays_finite(said: list[tuple[float, float, float, float, float, bool]]) -> None:
    o = DipoleReadings()
    for north, east, down, d, delta, inner in said:
        o.add((north, east, down), np.eye(3), d, delta, inner)
    fit, damping = refine(seeds(said[0][:3], 0.3, 20.0), np.full(24, 1e-2), o, 0.1, 3)
    for part in (*fit, damping):
        assert np.isfinite(part).all()


@every("count", [0, 1, 63, 100])
@every("gains", [(1.0, 1.0), (0.5, 1.0)])
def test_readings_added_together_are_those_added_one_by_one(count: int, gains: tuple[float, float]) -> None:
    """With more than there is room for, the weakest are left out; some are silent, or above unknown ground."""
    rng = np.random.default_rng(5)
    turns, every = Rotation.random(100, rng).as_matrix(), list[Reading]()
    for k in range(count):
        d, ground = (-1.0 if k % 7 == 3 else rng.uniform(1, 60)), (None if k % 3 else rng.uniform(-2, 2))
        every.append((rng.uniform(-20, 20, 3).tolist(), turns[k], d, rng.uniform(-1, 1), k % 5 == 0, 0.5 * k, ground))
    one_by_one, together = DipoleReadings(gains), DipoleReadings(gains)
    for reading in every:
        one_by_one.add(*reading)
    together.add_all(every)
    x = hypotheses(rng, 3)
    assert len(together.said) == min(count + 1, MOST)
    assert (together.time_s == one_by_one.time_s).all()
    assert (together.level(x) == one_by_one.level(x)).all()
    for a, b in zip(evaluate(x, together, 0.1), evaluate(x, one_by_one, 0.1), strict=True):
        assert (a == b).all()


@every("degrees", [-10, 0, 10])
def test_a_receiver_that_is_turned_is_noticed(degrees: int) -> None:
    """By a compass or a mount that is off: the angle is a part of the fit, and the place is right."""
    off = []
    for seed in range(6):
        receiver, truth, way = lying(seed)
        o, turned = DipoleReadings(), Rotation.from_euler("z", degrees, degrees=True).as_matrix()
        for at in way:
            slot = receiver.read(at, turned).channels[0]
            o.add(at, np.eye(3), slot.d_cm / 100, math.radians(slot.delta_deg), slot.zone == Zone.INNER)
        fit, _ = refine(truth[None], np.full(1, 1e-3), o, 0.05, 20)
        assert math.dist(fit.x[0, :2], truth[:2]) < 0.15
        off.append(math.degrees(fit.x[0, 6]))
    assert np.median(off) == pytest.approx(degrees, abs=1.5)
