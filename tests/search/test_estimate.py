"""The search by estimation, its causes and drifts; and what all strategies do in closed loops."""

from __future__ import annotations

import functools
import itertools
import math
import random
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from arva_hil.autopilot.following.session import Received, Session
from arva_hil.campaign import trial
from arva_hil.campaign.plan import draw
from arva_hil.cli.search_report import as_dict, result
from arva_hil.clock import StepClock
from arva_hil.config import parse
from arva_hil.config.campaign import Random
from arva_hil.events import Event
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import FromSearch, SearchPaused
from arva_hil.events.words.reasons import in_words
from arva_hil.mavlink.codec import Encoder, Parser, dialect
from arva_hil.registry import STRATEGIES
from arva_hil.runtime.loop import run
from arva_hil.search.mission.accuracy import Accuracy, PositionAccuracy
from arva_hil.search.mission.outcome import Outcome
from arva_hil.search.strategies import dipole, estimate
from arva_hil.search.strategies.agreement import Evidence, beginning
from arva_hil.search.strategies.analysis import TransmitterReadings
from arva_hil.search.strategies.circle import RADIUS_M, Circle
from arva_hil.search.strategies.dipole import Array
from arva_hil.search.strategies.drift import (
    ANY,
    DriftFit,
    ErrorSizes,
    PlaceNow,
    fitted,
    fitted_again,
    fitted_beside,
    place_now,
)
from arva_hil.search.strategies.estimate import Estimate, Hypotheses
from arva_hil.search.strategies.extremum import Extremum
from arva_hil.search.strategies.flux import Flux
from arva_hil.search.strategies.history import NOTHING, Cause, Explanation, Track
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import STILL, Found, Observation, Position, Strategy, Velocity, sigma_of
from arva_hil.simulated.closed_loop import ClosedLoop
from tests.every import every
from tests.search.world import PAPER, Flight, fly, fly_to_buried

LONGEST_S = 60.0  # above a place, instead of four minutes


def frame(time_s: float, d_cm: int, delta_deg: int = 0, north: float = 0.0, east: float = 0.0) -> Observation:
    return Observation(time_s, (north, east, -1.0), np.eye(3), d_cm, delta_deg, 0 < d_cm <= 300)


@pytest.mark.parametrize(("rate_hz", "speed"), [(0.5, 1.0), (50.0, 2.0)])
def test_at_any_rate(rate_hz: float, speed: float) -> None:
    flight = fly(Estimate(speed), PAPER[0], rate_hz=rate_hz, seed=1)
    assert flight.error_m < 0.3
    assert flight.fastest <= speed + 1e-9


@pytest.mark.parametrize(("seed", "strength"), [(0, 0.6), (1, 1.6)])
def test_however_it_lies_buried_and_however_strong_it_is(seed: int, strength: float) -> None:
    flight = fly_to_buried(seed, Estimate(1.0), strength=strength, seed=seed)
    assert flight.error_m < 0.5
    assert flight.time_s < 90


def test_with_an_uncertain_position_it_reports_a_place_from_a_reading_beside_it() -> None:
    flight = fly(Estimate(1.0), PAPER[1], gps_m=0.1, seed=2)
    assert flight.error_m < 0.5
    nn, ne, ee = flight.found.covariance
    assert 0 < nn < 0.09
    assert 0 < ee < 0.09
    assert nn * ee > ne * ne
    newest = flight.heard[-1].position
    assert math.dist(newest[:2], flight.found.goal) < RADIUS_M + 0.5
    assert flight.found.now != flight.found[:2]


class Late(Estimate):
    """Told what was heard some readings ago as if that were now."""

    def __init__(self, speed: float, readings: int) -> None:
        super().__init__(speed)
        self._behind = deque[Observation](maxlen=readings + 1)

    def observe(self, observation: Observation) -> None:
        self._behind.append(observation)
        then = self._behind[0]
        super().observe(observation._replace(d_cm=then.d_cm, delta_deg=then.delta_deg, inner=then.inner))


def test_readings_that_are_late_are_put_where_they_were_made() -> None:
    flight = fly(Late(1.0, 2), PAPER[1], height_m=3.0)
    assert flight.error_m < 0.5


def test_a_position_that_drifts_is_averaged_above_the_transmitter() -> None:
    scenario = replace(draw(Random(5.0, (0.0, 2.0)), 180), seed=180)
    result = trial.fly(trial.Trial("estimate", scenario, gps_noise_m=1.0))
    assert result.outcome == "found"
    assert result.error_m < 2.0
    assert result.relative_m < 2 * result.relative_sigma_m < 1.0


@pytest.mark.parametrize(("sigmas_m", "late"), [((0.1, 0.1), False), ((0.1, 1.0), True)])
def test_one_certain_reading_among_uncertain_ones_reports_no_place(
    sigmas_m: tuple[float, ...], late: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    sigmas = itertools.cycle(sigmas_m)

    def scripted(*arguments: Any) -> PlaceNow:
        variance = next(sigmas) ** 2
        return place_now(*arguments)._replace(covariance=(variance, 0.0, variance))

    monkeypatch.setattr(estimate, "place_now", scripted)
    monkeypatch.setattr(estimate, "_LONGEST_S", LONGEST_S)
    flight = fly(Estimate(1.0), PAPER[1], rate_hz=0.2)
    assert (flight.time_s > LONGEST_S + 30) == late
    assert flight.error_m < 0.3


def test_a_place_that_is_not_exact_is_reported_after_another_circle(monkeypatch: pytest.MonkeyPatch) -> None:
    """Errors that are alike within seconds make sigma too small: of 200 places 3 were farther than three sigmas."""
    times_s = []
    for sigma_m in (0.01, 0.1):

        def scripted(*arguments: Any, variance: float = sigma_m**2) -> PlaceNow:
            return place_now(*arguments)._replace(covariance=(variance, 0.0, variance))

        monkeypatch.setattr(estimate, "place_now", scripted)
        times_s.append(fly(Estimate(1.0), PAPER[1]).time_s)
    assert times_s[1] > times_s[0] + 5.0


def test_a_place_that_is_reported_late_is_less_certain(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is one of many: of 135 places that were reported after three minutes 5 were farther than three sigmas."""

    def scripted(*arguments: Any) -> PlaceNow:
        return place_now(*arguments)._replace(covariance=(0.01, 0.0, 0.01))

    monkeypatch.setattr(estimate, "place_now", scripted)
    for patience_s, sigma_m in ((180.0, 0.1), (1.0, 0.1 * math.sqrt(1.5))):
        monkeypatch.setattr(estimate, "_PATIENCE_S", patience_s)
        fly(search := Estimate(1.0), PAPER[1])
        assert sigma_of(search.found and search.found.now_covariance) == pytest.approx(sigma_m)


def test_a_place_is_not_certain_under_the_largest_drift_or_if_places_wander_without_one() -> None:
    evidence = Evidence()
    for k in range(24):
        at = np.array([*circle(k), -3.0])
        d, delta = heard(at)
        evidence.add(Observation(k, tuple(at), np.eye(3), round(100 * d), round(math.degrees(delta)), False))
    dipoles = estimate.Hypotheses(evidence)
    dipoles.x = np.array([[*PLACE, *MOMENT, 0.0]])
    for drift_m, pose_error, least_m, most_m in (
        (1, 0.1, 0, 0.3),
        (3, 0.1, 1, 1.3),
        (0, 0.1, 0, 0.1),
        (0, 0.5, 1, 1.1),
    ):
        dipoles.cause, dipoles.pose_error = Cause(drift_m=drift_m), pose_error
        assert least_m < (sigma_of(dipoles.now(Found(0.0, 0.0), 23.0).now_covariance) or 0.0) < most_m


def test_a_position_that_wanders_within_seconds_is_searched_by_its_mean(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimate, "_LONGEST_S", LONGEST_S)
    flight = fly(Estimate(1.0), PAPER[1], gps_m=1.0, rate_hz=0.2)
    assert flight.error_m < 1.5
    assert (sigma_of(flight.found.now_covariance) or 0.0) > 0.5


class Deaf(Estimate):
    """Every fourth frame is blank."""

    count = 0

    def observe(self, observation: Observation) -> None:
        self.count += 1
        blank = self.count % 4 == 0
        super().observe(observation._replace(d_cm=-1, delta_deg=-1, inner=False) if blank else observation)


def test_blanks_and_readings_of_another_transmitter_with_its_id_do_not_lead_astray() -> None:
    r = random.Random(0)
    flight = fly(Deaf(1.0), PAPER[1], "{id: 2, enu: [15, -10, 0]}", wrong=lambda _: r.random() < 0.2)
    assert flight.error_m < 0.3


def test_says_how_deep() -> None:
    found = of_paper(Estimate, 2).found
    assert found.down == pytest.approx(1.0, abs=0.3)


def test_after_the_first_signal_it_follows_the_flux_line() -> None:
    seeker = Estimate(1.0)
    seeker.observe(frame(0.0, 2500, 40))
    north, east = seeker.velocity(0.5, (0.0, 0.0, -1.0))
    assert math.hypot(north, east) == pytest.approx(1.0)
    assert abs(math.sin(math.atan2(east, north) - math.radians(40))) < 0.5


def test_what_lies_behind_it_is_found_behind_it() -> None:
    """The field is the same 28 m ahead and behind: which, only the way flown tells."""
    found = fly(Estimate(1.0), "{id: 1, ned: [-28, 0, 1]}").found
    assert found.north == pytest.approx(-28.0, abs=0.3)


def test_goes_back_to_where_it_was_heard_best() -> None:
    seeker = Estimate(1.0)
    for k in range(3):
        seeker.observe(frame(k, 4700 + 100 * k, 10, north=-k))
    for k in range(3, 12):
        seeker.observe(frame(k, -1, -1, north=-10.0 * k))
    assert seeker.velocity(12.0, (-110.0, 0.0, -1.0)) == pytest.approx((1.0, 0.0), abs=0.1)


def test_goes_to_what_it_has_found_and_stays_with_it() -> None:
    seeker = Estimate(1.0)
    found = fly(seeker, PAPER[1]).found
    assert found is not None
    for k in range(5):
        seeker.observe(frame(1e3 + k, 4000, 50, north=30.0 + k))
    assert seeker.found == found
    assert seeker.velocity(1e3, (found.north + 5, found.east, -1.0)) == pytest.approx((-1.0, 0.0), abs=0.1)


NONSENSE = st.tuples(st.integers(-1, 65535), st.integers(-90, 90), st.floats(-100, 100), st.floats(-100, 100))


@settings(max_examples=8)
@given(st.lists(NONSENSE, min_size=1, max_size=15), st.floats(0.2, 10))
def test_nonsense_is_survived(said: list[tuple[int, int, float, float]], speed: float) -> None:
    seeker = Estimate(speed)
    for k, (d_cm, delta_deg, north, east) in enumerate(said):
        seeker.observe(frame(3.0 * k, d_cm, delta_deg, north, east))
        velocity = seeker.velocity(3.0 * k, (north, east, -1.0))
        assert math.hypot(*velocity) <= speed * (1 + 1e-9)


# -- A drift of the places reported is followed, here by readings made by hand ----------------------------


PLACE, MOMENT = np.array([0.0, 0.0, 1.0]), dipole.MOMENT * np.array([0.6, 0.8, 0.0])
EVERY_S, SMOOTH_S = 2.0, 5.0


def walk(seed: int, sigma_m: float, count: int) -> NDArray[np.float64]:
    """A slow random drift (count, 3): a Gauss-Markov process of 30 s, smoothed."""
    rng, kept, smooth = np.random.default_rng(seed), math.exp(-EVERY_S / 30), math.exp(-EVERY_S / SMOOTH_S)
    raw = drift = sigma_m * rng.standard_normal(3)
    every = []
    for _ in range(count):
        raw = kept * raw + math.sqrt(1 - kept**2) * sigma_m * rng.standard_normal(3)
        drift = smooth * drift + (1 - smooth) * raw
        every.append(drift)
    return np.array(every)


def slow(rng: np.random.Generator, sigma_m: float, tau_s: float, count: int) -> NDArray[np.float64]:
    """A drift (count, 3) without a filter, from an offset on."""
    kept, at = math.exp(-EVERY_S / tau_s), sigma_m * rng.standard_normal((count, 3))
    for n in range(1, count):
        at[n] = kept * at[n - 1] + math.sqrt(1 - kept**2) * at[n]
    return at


def heard(
    at: NDArray[np.float64], y_gain: float = 1.0, power: float = 1.0, attitude: Rotation | None = None
) -> tuple[float, float]:
    """d [m] and δ [rad] of a receiver, rounded as it shows them; without an attitude it is level and looks north."""
    r = at - PLACE
    n = r / np.linalg.norm(r)
    h = (3 * (MOMENT @ n) * n - MOMENT) / np.linalg.norm(r) ** 3
    h = (attitude.inv().apply(h) if attitude else h) * (1, y_gain, 1)
    return round(math.hypot(h[0], h[1]) ** (-power / 3), 2), round(math.atan2(h[1], h[0]), 2)


def readings_on(
    way: Callable[[int], tuple[float, float]], drift: NDArray[np.float64], *receiver: float
) -> dipole.DipoleReadings:
    """Those at north and east of each reading, 3 m high, at the places reported under a drift."""
    readings = dipole.DipoleReadings()
    for k, error in enumerate(drift):
        at = np.array([*way(k), -3.0])
        readings.add((at + error).tolist(), np.eye(3), *heard(at, *receiver), False, EVERY_S * k)
    return readings


@pytest.mark.parametrize("seed", [0, 13])
def test_a_large_drift_is_followed_from_reading_to_reading(seed: int) -> None:
    """The field is the same on both sides of a transmitter: a fit that begins anew finds the other side at times."""
    readings, drift = dipole.DipoleReadings(), walk(seed, 2.0, 50)
    x, fits, off = np.array([[*PLACE, *MOMENT, 0.0]]), list[DriftFit](), list[float]()
    for k, error in enumerate(drift):
        at = np.array([1.5 * math.cos(0.8 * k), 1.5 * math.sin(0.8 * k), -3.0])
        readings.add((at + error).tolist(), np.eye(3), *heard(at), False, EVERY_S * k)
        if k >= 8 and k % 2 == 0:
            fits = fitted_again(x, fits, readings, 1.0)
            x = np.array([fit.x for fit in fits])
            off.append(math.dist(fits[0].now[:2], (PLACE + error)[:2]))
    assert max(off) < 1.5


def now(readings: dipole.DipoleReadings, place: Array, **others: Any) -> PlaceNow:
    """The place now, from a hypothesis at a place; of a vehicle that hovers, unless its velocity is given."""
    others = {"velocity": np.zeros((3, len(readings.time_s)))} | others
    return place_now(np.array([[*place, *MOMENT, 0.0]]), readings, (), 0.0, **others)


def circle(k: float) -> tuple[float, float]:
    """North and east on a circle, at the time of reading k."""
    return 1.5 * math.cos(0.8 * k), 1.5 * math.sin(0.8 * k)


def test_readings_that_agree_better_than_assumed_make_the_uncertainty_smaller() -> None:
    readings = readings_on(circle, np.zeros((24, 3)))
    place, covariance, _, likely = now(readings, PLACE)
    assert math.dist(place, PLACE[:2]) < 0.01
    assert (sigma_of(covariance) or 0.0) < 0.01
    assert not any(errors.drift_m > 1.0 for errors, _ in likely)


def test_no_place_is_known_better_than_a_position_that_is_rounded() -> None:
    """Positions are told to 1e-7°, 11 mm in north and 8 mm in east: 80 % are less than 5 mm off."""
    readings = dipole.DipoleReadings()
    for k in range(60):
        at = PLACE + np.array([*circle(k), -1.0])
        readings.add(at.tolist(), np.eye(3), *heard(at), False, EVERY_S * k)
    assert sigma_of(now(readings, PLACE).covariance) == pytest.approx(0.0025, rel=0.1)


@pytest.mark.parametrize(("y_gain", "power"), [(0.75, 1.0), (1.0, 1.08), (0.9, 1.0), (0.9, 1.03)])
def test_the_place_is_right_though_antennas_are_unequal_or_d_has_another_law(
    y_gain: float, power: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    def way(k: float) -> tuple[float, float]:
        """From the north, and then along a circle."""
        return (8.0 - 0.5 * k, 0.3) if k < 12 else circle(k)

    readings = readings_on(way, np.zeros((30, 3)), y_gain, power)
    place, covariance, *_ = now(readings, PLACE)
    monkeypatch.setattr("arva_hil.search.strategies.drift.ANY", [each for each in ANY if not each.receiver])
    exact, *_ = now(readings, PLACE)
    assert math.dist(place, PLACE[:2]) < math.dist(exact, PLACE[:2])
    assert math.dist(place, PLACE[:2]) < 2 * (sigma_of(covariance) or 0.0) < 0.4


@pytest.mark.parametrize("degrees", [2, 6])
@pytest.mark.parametrize("towards_deg", [0, 135, 270])
def test_the_place_is_right_though_the_receiver_leans(towards_deg: int, degrees: float) -> None:
    towards = np.array([*circle(math.radians(towards_deg) / 0.8), 0.0]) / 1.5
    leaning = Rotation.from_rotvec(degrees * towards, degrees=True)
    readings = dipole.DipoleReadings()
    for k in range(30):
        at = np.array([*((8.0 - 0.5 * k, 0.3) if k < 12 else circle(k)), -3.0])
        readings.add(at.tolist(), leaning.as_matrix(), *heard(at), False, EVERY_S * k)
    place, covariance, *_ = now(readings, PLACE)
    assert math.dist(place, PLACE[:2]) < min(0.01, 3 * (sigma_of(covariance) or 0.0))


@pytest.mark.parametrize("by_deg", [10, 20])
@pytest.mark.parametrize("of_mount", [False, True])
def test_the_place_is_right_though_the_compass_or_the_mount_of_a_leaning_vehicle_is_turned(
    of_mount: bool, by_deg: float
) -> None:
    turned, readings = Rotation.from_rotvec([0, 0, by_deg], degrees=True), dipole.DipoleReadings()
    for k in range(30):
        at = np.array([*((8.0 - 0.5 * k, 0.3) if k < 12 else circle(k)), -3.0])
        leans = Rotation.from_rotvec(12 * np.array([math.cos(k), math.sin(k), 0.0]), degrees=True)
        true = leans * turned if of_mount else turned * leans
        readings.add(at.tolist(), leans.as_matrix(), *heard(at, attitude=true), False, EVERY_S * k)
    place, covariance, *_ = now(readings, PLACE)
    assert math.dist(place, PLACE[:2]) < min(0.01, 3 * (sigma_of(covariance) or 0.0))


def test_one_antenna_has_no_part_in_the_errors_of_delta() -> None:
    readings = dipole.DipoleReadings((1.0, 0.0))
    for k in range(24):
        at = np.array([*circle(k), -3.0])
        d, delta = heard(at, y_gain=0.0)
        readings.add(at.tolist(), np.eye(3), d, delta, False, EVERY_S * k)
    assert readings.telling.told.sum() == 24 + 2
    assert now(readings, PLACE).likely[0][1].parts == 24 + 2


def test_readings_that_are_late_by_a_part_of_a_frame_do_not_move_the_place(monkeypatch: pytest.MonkeyPatch) -> None:
    def at(time_s: float) -> NDArray[np.float64]:
        """The place of a receiver that comes from the north, and flies along a circle."""
        if time_s < 6.5:
            return np.array([8.0 - time_s, 0.0, -3.0])
        turn = (time_s - 6.5) / 1.5
        return np.array([1.5 * math.cos(turn), 1.5 * math.sin(turn), -3.0])

    readings, velocity = dipole.DipoleReadings(), [np.zeros(3)]
    for time_s in EVERY_S * np.arange(12):
        readings.add(at(time_s).tolist(), np.eye(3), *heard(at(time_s - 0.4)), False, time_s)
        velocity.append(at(time_s + 0.5) - at(time_s - 0.5))
    place, covariance, *_ = now(readings, PLACE, velocity=np.array(velocity).T)
    monkeypatch.setattr("arva_hil.search.strategies.drift.ANY", [each for each in ANY if not each.receiver])
    prompt, *_ = now(readings, PLACE)
    assert math.dist(place, PLACE[:2]) < min(0.05, 0.5 * math.dist(prompt, PLACE[:2]))
    assert math.dist(place, PLACE[:2]) < 2 * (sigma_of(covariance) or 0.0) < 0.4


def inwards(k: int) -> tuple[float, float]:
    """Where reading k is made, on the way to the transmitter."""
    return (8 - 0.3 * k) * math.cos(0.5 * k), 1.5 * math.sin(0.5 * k)


@pytest.mark.parametrize("drift_m", [0.03, 0.06, 0.1, 0.3])
def test_a_drift_of_centimetres_is_in_the_uncertainty(drift_m: float) -> None:
    shares = []
    for seed in range(24):
        drift = slow(np.random.default_rng(seed), drift_m, 600, 24)
        place, covariance, *_ = now(readings_on(inwards, drift), PLACE + drift.mean(axis=0))
        assert (sigma_of(covariance) or 0.0) < 0.7 * drift_m
        shares.append(math.dist(place, (PLACE + drift[-1])[:2]) / (sigma_of(covariance) or 0.0))
    assert max(shares) < 3.0
    assert np.mean(np.square(shares)) < 3.0  # 2 of many


def test_the_place_reported_now_has_an_uncertainty_that_fits_drifts_of_any_speed() -> None:
    rng, shares = np.random.default_rng(3), list[float]()
    for sigma_m, tau_s, most_m in ((0.0, 600, 0.1), *((2.0, 600, 0.6), (1.0, 20, 1.4), (1.0, 5, 2.2)) * 2):
        drift = slow(rng, sigma_m, tau_s, 24)
        place, covariance, *_ = now(readings_on(inwards, drift), PLACE + drift.mean(axis=0))
        sigma = math.sqrt(estimate._DRIFT_CAUTION) * (sigma_of(covariance) or 0.0)
        shares.append(math.dist(place, (PLACE + drift[-1])[:2]) / sigma)
        assert sigma < most_m
    assert max(shares) < 3.0
    assert np.median(shares) < 1.5


def test_a_place_whose_readings_no_size_of_errors_explains_is_told_to_a_metre_at_best() -> None:
    evidence = Evidence()
    for k in range(60):
        at = np.array([*circle(k), -3.0])
        d_m, delta = heard(at + np.array([5.0 if k > 40 else 0.0, 0.0, 0.0]))  # the transmitter moves
        north, east, down = at.tolist()
        o = Observation(k, (north, east, down), np.eye(3), round(100 * d_m), round(math.degrees(delta)), False)
        evidence.add(o)
    dipoles = Hypotheses(evidence)
    dipoles.x = TRUE
    assert (sigma_of(dipoles.now(Found(0.0, 0.0), 60.0).now_covariance) or 0.0) > 1.0


@pytest.mark.parametrize(("seed", "off"), [(4, (4, 0, 0)), (11, (0, 4, 0))])
def test_a_fit_that_has_followed_a_wrong_drift_does_not_keep_the_place(seed: int, off: tuple[int, int, int]) -> None:
    drift = walk(seed, 2.0, 40)
    readings = readings_on(lambda k: (1.5 * math.cos(0.8 * k), 1.5 * math.sin(0.8 * k)), drift)
    beside = np.array([[*(PLACE + off + drift.mean(axis=0)), *MOMENT, 0.0]])
    (wrong,) = fitted(beside, readings, ErrorSizes(3.0), 20)
    place, *_ = place_now(wrong.x[None], readings, [wrong], 0.0, np.zeros((3, 41)))
    assert math.dist(place, (PLACE + drift[-1])[:2]) < 1.5
    assert min(one.cost for one in fitted_beside(wrong.x, readings, 3.0)) < wrong.cost


def test_hypotheses_fitted_together_are_those_fitted_alone() -> None:
    readings = readings_on(lambda k: (4 * math.cos(0.5 * k), 4 * math.sin(0.5 * k)), walk(3, 0.5, 20))
    x = np.array([[*(PLACE + off), *MOMENT, 0.0] for off in ((0.1, 0.0, 0.0), (1.0, 2.0, 0.5), (-3.0, 1.0, 0.0))])
    together = fitted(x, readings, ErrorSizes(1.0), 6)
    for begin, one in zip(x, together, strict=True):
        (alone,) = fitted(begin[None], readings, ErrorSizes(1.0), 6)
        assert all(np.array_equal(a, b) for a, b in zip(one, alone, strict=True))
    nearer = fitted(x, readings, ErrorSizes(1.0), 3, together[:2])
    (alone,) = fitted(x[1:2], readings, ErrorSizes(1.0), 3, together[1:2])
    assert all(np.array_equal(a, b) for a, b in zip(nearer[1], alone, strict=True))


# -- The uncertainty of a position on Earth has the accuracy of the autopilot's own position in it --------


FLOOR_M = 2.1  # without corrections


def gps(h_acc_mm: int = 0, eph: int = 100, fix: int = dialect.GPS_FIX_TYPE_3D_FIX) -> Any:
    return dialect.MAVLink_gps_raw_int_message(0, fix, 0, 0, 0, eph, 150, 0, 0, 10, h_acc=h_acc_mm)


def estimator(metres: float) -> Any:
    return dialect.MAVLink_estimator_status_message(0, 0, 0, 0, 0, 0, 0, 0, metres, 1.0)


def after(*messages: Any) -> Accuracy:
    accuracy, data = PositionAccuracy(Session()), b"".join(map(Encoder(1, 1).pack, messages))
    accuracy.on_packets(Received(own=list(Parser().feed(data))))
    return accuracy.worst


@every(
    "messages, sigma_m, reported",
    [
        ([], FLOOR_M, False),
        ([gps()], FLOOR_M, False),  # 0 is unknown, and not perfect
        ([gps(eph=0)], FLOOR_M, False),
        ([gps(eph=0xFFFF)], FLOOR_M, False),
        ([gps(eph=300)], 3 * FLOOR_M, False),
        ([gps(h_acc_mm=400)], FLOOR_M, True),  # a slow drift is not in it
        ([gps(h_acc_mm=5000)], 5.0, True),
        ([gps(h_acc_mm=20, fix=dialect.GPS_FIX_TYPE_RTK_FIXED)], 0.02, True),
        ([gps(fix=dialect.GPS_FIX_TYPE_RTK_FIXED)], FLOOR_M, False),
        ([gps(), estimator(4.0)], 4.0, True),
        ([gps(), estimator(0.1)], FLOOR_M, True),
        ([estimator(0.0)], FLOOR_M, False),
        ([estimator(math.nan), estimator(math.inf), estimator(-1.0)], FLOOR_M, False),
    ],
)
def test_accuracy_is_what_the_autopilot_reports_and_no_better_than_the_floor(
    messages: list[Any], sigma_m: float, reported: bool
) -> None:
    assert after(*messages) == (pytest.approx(sigma_m), reported)


def test_the_covariance_on_earth_has_both() -> None:
    place = Found(1.0, 2.0, covariance=(0.25, 0.1, 0.04))
    assert Accuracy(2.0).on_earth(place) == pytest.approx((4.25, 0.1, 4.04))
    assert Accuracy(2.0).on_earth(Found(1.0, 2.0)) is None


def test_the_covariance_relative_to_the_drone_is_of_the_places_reported_now_if_a_strategy_knows_it() -> None:
    place = Found(1.0, 2.0, covariance=(4.0, 0.0, 4.0), now=(1.5, 2.0), now_covariance=(0.25, 0.1, 0.04))
    assert Accuracy(2.1).relative(place) == (0.25, 0.1, 0.04)
    nn, ne, ee = Accuracy(2.1).relative(Found(1.0, 2.0, covariance=(4.0, 0.1, 4.0))) or (0.0, 0.0, 0.0)
    assert (nn, ne, ee) == (pytest.approx(4.02, abs=0.01), 0.1, pytest.approx(4.02, abs=0.01))
    assert Accuracy(2.1).relative(Found(1.0, 2.0)) is None


# -- The circle about a place -----------------------------------------------------------------------------


@every("start", [(0.0, 0.0), (1.5, 0.0), (-3.0, 2.0)])
@every("speed", [0.5, 3.0])
def test_it_leads_round_the_place_at_the_speed_asked_for(start: tuple[float, float], speed: float) -> None:
    centre = (10.0, -5.0)
    north, east = centre[0] + start[0], centre[1] + start[1]
    circle, bearings, flown_s = Circle(centre, (north, east, -3.0)), set(), 0.0
    while not circle.done and flown_s < 60:
        circle.observe(centre)
        v_north, v_east = circle.velocity((north, east, -3.0), speed)
        assert math.hypot(v_north, v_east) <= min(speed, 0.8 * RADIUS_M) + 1e-9
        north, east, flown_s = north + 0.2 * v_north, east + 0.2 * v_east, flown_s + 0.2
        if math.dist((north, east), centre) > 0.7 * RADIUS_M:
            bearings.add(round(math.degrees(math.atan2(east - centre[1], north - centre[0])) / 60) % 6)
        assert math.dist((north, east), centre) < RADIUS_M + max(math.hypot(*start), 0.5)
    assert circle.done
    assert len(bearings) >= 5


# -- A drift that is believed with a place far off does not keep the search from the place ----------------


DRIFT, LITTLE = Cause(drift_m=1.0), Cause(drift_m=0.3)
TRUE, FAR = (np.array([[*place, *MOMENT, 0.0]]) for place in (PLACE, PLACE + np.array([0.0, 70.0, 0.0])))


class Astray(Evidence):
    """At first a drift with a place far off is likely, as by a few weak readings. Later a smaller drift is a little
    more likely, but not so much that it is believed."""

    def explanations(self, x: Array, cause: Cause = NOTHING) -> list[Explanation]:
        if cause == NOTHING:
            nothing = self._fitted(x, NOTHING)
            far = nothing.best._replace(x=FAR[0], drift=np.zeros((3, len(nothing.readings.time_s))))
            return [nothing, Explanation(DRIFT, nothing.readings, FAR, 0.1, far, nothing.cost - 100, np.zeros(1))]
        believed, smaller = self._fitted(TRUE, cause), self._fitted(TRUE, LITTLE)
        return [believed, smaller._replace(cost=believed.cost - 1)]


def test_the_best_place_by_the_drift_believed_is_used_though_another_drift_is_a_little_likelier(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(estimate, "Evidence", Astray)
    search = Estimate(1.0)
    for k in range(100):
        at = np.array([0.5 * k - 25, 20.0, -3.0])  # past it, on the side of the place far off
        d_m, delta = heard(at)
        o = Observation(1.5 * k, tuple(at.tolist()), np.eye(3), round(100 * d_m), round(math.degrees(delta)), False)
        search.observe(o)
    assert search.belief.goal is not None
    assert math.dist(search.belief.goal, PLACE[:2]) < 1.0


# Electronics near the receiver drown what is far off; the search knows then which readings say something


LOUD = 35.0**-3  # sigma of each antenna, of the reference transmitter's field at 1 m


def listened(loud: float, seed: int, last: int) -> Evidence:
    """A level receiver that looks north, on its way from 60 m to 6 m from the transmitter, and round it from 61 on."""
    evidence, rng = Evidence(), np.random.default_rng(seed)
    for k in range(last):
        at = np.array([60.0 - 0.9 * k, 8 * math.sin(k / 6), -3.0])
        if k > 60:
            at[:2] = 4 * math.cos(0.3 * k), 4 * math.sin(0.3 * k)
        r = at - PLACE
        n = r / np.linalg.norm(r)
        h = (3 * (MOMENT @ n) * n - MOMENT)[:2] / np.linalg.norm(r) ** 3 + loud * rng.standard_normal(2)
        d_cm, delta_deg = round(100 * math.hypot(*h) ** (-1 / 3)), round(math.degrees(math.atan2(h[1], h[0])))
        north, east, down = at.tolist()
        evidence.add(Observation(1.0 * k, (north, east, down), np.eye(3), d_cm, delta_deg, False))
    return evidence


def best(evidence: Evidence) -> Explanation:
    """From far off the place."""
    return min(evidence.explanations(beginning((30.0, 30.0), evidence)), key=lambda one: one.cost)


def test_readings_that_are_mostly_noise_do_not_hide_the_place() -> None:
    north, east = best(listened(LOUD, 0, 61)).x[0, :2]
    assert math.dist((north, east), PLACE[:2]) < 2.0


def test_a_receiver_that_hears_well_is_not_thought_deaf() -> None:
    assert best(listened(0.0, 0, 61)).cause == NOTHING


def test_a_place_agrees_though_what_was_heard_far_from_it_was_noise() -> None:
    judgement = listened(LOUD, 2, 90).judge((0.0, 0.0))
    assert judgement.agrees(3.0)


# A search in doubt ends in bounded time after it first came above a place, whatever it goes through


NEAR = PAPER[1]  # 10 m away: the vehicle is above it within 30 s
ENDS_S = 30 + LONGEST_S + 20 + 10


class Wavering(Evidence):
    """Of two causes, always the other one is far more likely."""

    causes = (NOTHING, Cause(lag_s=0.5))

    def explanations(self, x: Array, cause: Cause = NOTHING) -> list[Explanation]:
        believed = self._fitted(x, cause)
        (other,) = (self._fitted(x, one) for one in self.causes if one != cause)
        gap = 100 + max(other.cost - believed.cost, 0.0)
        return [believed._replace(cost=believed.cost + gap, costs=believed.costs + gap), other]


class Confused(Estimate):
    """Once it circles about the place it is told nonsense."""

    def __init__(self, speed: float) -> None:
        super().__init__(speed)
        self._rng = np.random.default_rng(3)
        self.circles = False

    def observe(self, observation: Observation) -> None:
        place = self.belief.goal
        known = self.belief.covariance is not None and max(self.belief.covariance) < 0.05
        if known and place is not None and math.dist(place, observation.position[:2]) < 1.7:
            self.circles = True
        if self.circles:
            d_cm, delta_deg = int(self._rng.integers(400, 3000)), int(self._rng.integers(-89, 90))
            observation = observation._replace(d_cm=d_cm, delta_deg=delta_deg, inner=False)
        super().observe(observation)


def test_though_its_cause_changes_whenever_it_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimate, "Evidence", Wavering)
    monkeypatch.setattr(estimate, "_LONGEST_S", LONGEST_S)
    flight = fly(Estimate(1.0), NEAR, rate_hz=0.2, limit_s=400)
    assert flight.found is not None
    assert flight.time_s < ENDS_S
    assert flight.error_m < 1


def test_though_it_never_comes_above_a_place_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimate, "_LONGEST_S", LONGEST_S)
    strategy = Confused(1.0)
    flight = fly(strategy, NEAR, rate_hz=0.2, limit_s=400)
    assert strategy.circles
    assert flight.found is not None
    assert flight.time_s < ENDS_S


# A receiver shows its last values until the next pulse: what it shows again on the way is no reading


def test_values_shown_again_on_the_way_are_no_reading() -> None:
    evidence = Evidence()
    on_its_way = [frame(0.5 * k, 900 - 10 * (k // 3), north=0.5 * k) for k in range(12)]
    assert [evidence.add(one) for one in on_its_way] == [True, False, False] * 4
    assert evidence.readings().said.shape == (1 + 4,)
    still = [frame(6.0 + 0.6 * k, 500, north=6.0) for k in range(6)]
    assert all(evidence.add(one) for one in still)
    assert evidence.readings().said.shape == (1 + 4 + 3,)
    assert evidence.add(frame(9.1, 500, north=6.3))
    assert all(evidence.add(frame(10.0 + k, -1, -1, north=7.0 + k)) for k in range(3))


# What was read before the transmitter moved, and while an antenna was dead, does not spoil the place that is told


MOVED_S = 40


def circled(away: tuple[float, float], gain_y: float) -> TransmitterReadings:
    """A level receiver that looks north, on its way from 25 m, and round the place from second 26 on. Until it moves,
    the transmitter is `away` (north, east) from there, and the receiver's antenna y has `gain_y`.
    """
    record = TransmitterReadings()
    for k in range(100):
        at = np.array([25.0 - k, 3 * math.sin(k / 6), -3.0])
        if k > 25:
            at[:2] = 1.5 * math.cos(0.6 * k), 1.5 * math.sin(0.6 * k)
        r = at - PLACE - (np.array([*away, 0.0]) if k < MOVED_S else 0.0)
        n = r / np.linalg.norm(r)
        h = (3 * (MOMENT @ n) * n - MOMENT)[:2] / np.linalg.norm(r) ** 3
        h[1] *= gain_y if k < MOVED_S else 1.0
        d_cm, delta_deg = round(100 * math.hypot(*h) ** (-1 / 3)), round(math.degrees(math.atan2(h[1], h[0])))
        north, east, down = at.tolist()
        record.add(Observation(1.0 * k, (north, east, down), np.eye(3), d_cm, delta_deg, False))
    return record


def test_readings_from_before_it_moved_and_of_an_antenna_that_hears_again_are_left_out() -> None:
    judgement = circled((7.6, -1.2), 0.0).evidence.judge((0.0, 0.0))
    assert judgement.agrees(3.0)
    assert math.dist(judgement.there.x[0, :2], PLACE[:2]) < 0.1


def test_where_nothing_has_changed_all_readings_are_used() -> None:
    judgement = circled((0.0, 0.0), 1.0).evidence.judge((0.0, 0.0))
    assert judgement.there.cause == NOTHING


@pytest.mark.parametrize(("sigma_m", "sure"), [(None, True), (0.4, True), (0.41, False)])
def test_a_place_is_found_only_if_it_is_known_well_from_the_drone(sigma_m: float | None, sure: bool) -> None:
    now = sigma_m and (sigma_m**2, 0.0, 0.01)
    found = Found(0.0, 0.0, covariance=(4.0, 0.0, 4.0), now_covariance=now)
    assert circled((0.0, 0.0), 1.0).judged(found, 3.0) == (found, sure)


# -- A receiver that is not turned as its vehicle reports, by a compass or a mount that is off ------------


class Turned(Estimate):
    """Gets δ as a receiver reads it that is turned by `degrees`."""

    degrees = 0

    def observe(self, observation: Observation) -> None:
        delta = (observation.delta_deg - self.degrees + 90) % 180 - 90
        super().observe(observation._replace(delta_deg=delta))


@pytest.mark.parametrize(("degrees", "seed"), [(0, 1), (10, 0)])
def test_the_place_is_right_and_a_large_angle_is_reported(degrees: int, seed: int) -> None:
    strategy = Turned(1.0)
    strategy.degrees = degrees
    found = fly_to_buried(seed, strategy, height_m=3.0, seed=seed).found
    assert math.hypot(found.north, found.east) < 0.3
    assert found.turned_deg == (pytest.approx(degrees, abs=3) if degrees else None)


# A slow and a fast receiver: a search finds with either, and hovers only where frames are too far apart


class Paused:
    """An observer that counts how often the search hovered without frames."""

    def __init__(self) -> None:
        self.count = 0

    def observe(self, event: Event) -> None:
        self.count += isinstance(event, FromSearch) and isinstance(event.event, SearchPaused)


@pytest.mark.parametrize(("rate_hz", "pauses"), [(0.2, True), (50.0, False)])
def test_a_transmitter_is_found_with_a_receiver_of_any_rate(rate_hz: float, pauses: bool) -> None:
    scenario = parse(f"spec: 1\ntransmitters: [{{id: 1, enu: [4, 3, -1]}}]\nreceiver: {{rate_hz: {rate_hz}}}", "field")
    plan, paused, clock = SearchPlan(STRATEGIES["estimate"], area=(-30.0, -30.0, 30.0, 30.0)), Paused(), StepClock()
    loop = ClosedLoop(scenario, plan, start=0.0, stream_hz=10.0, observers=[paused])
    run(loop.tasks, clock, until=400.0, stopped=lambda: loop.drones[0].search.outcome is not None)
    outcome, error_m = loop.drones[0].search.outcome, loop.drones[0].error()
    assert (outcome.kind, in_words(outcome.how)) == ("found", "found")
    assert error_m < 0.5
    assert (paused.count > 0) == pauses
    assert outcome.frames >= 0.8 * rate_hz * outcome.time_s


# A transmitter that moves, as that of a rescuer, has a track; what a search then makes of it: test_mission.py


def tracks(place: Callable[[int], tuple[float, float]], drift_m: float) -> Iterator[Track]:
    """Those after each reading on a circle. The transmitter is at `place(k)` at reading k; the places told drift."""
    strategy = Estimate(1.0)
    for k in range(60):
        at = np.array([15 * math.cos(0.1 * k), 15 * math.sin(0.1 * k), -3.0])
        d_m, delta = heard(at - [*place(k), 0.0])
        north, east, down = (at + drift_m * np.array([math.sin(0.02 * k), math.cos(0.03 * k), 0.0])).tolist()
        o = Observation(1.5 * k, (north, east, down), np.eye(3), round(100 * d_m), round(math.degrees(delta)), False)
        strategy.observe(o)
        yield strategy.track


def test_a_transmitter_that_moves_has_a_track_and_the_report_tells_of_it() -> None:
    track = next(filter(None, tracks(lambda k: (8 * math.sin(0.1 * k), 8 * math.cos(0.17 * k)), 0.0)))
    assert len(track) > 4
    outcome = Outcome("found", (because(Why.FOUND),), 1, Found(1.0, 2.0), moving=((2, track),))
    assert as_dict(outcome)["moving"] == [{"id": 2, "track": track}]
    (line,) = (line for line in result(outcome) if line.startswith("transmitter 2 moves, at about "))
    assert 0.2 < float(line.split()[5]) < 3.0


def test_a_transmitter_that_stands_still_has_no_track_though_places_drift() -> None:
    assert not any(tracks(lambda k: (0.0, 0.0), 2.0))


# -- Every strategy in closed loop with the project's receiver --------------------------------------------


ALL = [Estimate, Extremum, Flux]
Maker = type[Estimate] | type[Extremum] | type[Flux]


@functools.cache
def of_paper(make: Maker, case: int) -> Flight:
    return fly(make(1.0), PAPER[case], height_m=1 + 0.2 * case, yaw=2.0 * case, seed=case)


@pytest.mark.parametrize("case", range(len(PAPER)))
@pytest.mark.parametrize(("make", "within_m", "within_s"), [(Estimate, 0.3, 45), (Extremum, 1, 250), (Flux, 1, 200)])
def test_the_cases_of_the_paper(make: Maker, within_m: float, within_s: float, case: int) -> None:
    flight = of_paper(make, case)
    assert flight.error_m < within_m
    assert flight.fastest <= 1.0 + 1e-9
    assert flight.time_s < within_s


@pytest.mark.parametrize(("transmitter", "rate_hz"), [(PAPER[0], 0.5), (PAPER[3], 50)])
@pytest.mark.parametrize("make", [Extremum, Flux])
def test_with_a_position_that_is_not_known_well_and_at_any_rate(make: Maker, transmitter: str, rate_hz: float) -> None:
    assert fly(make(1.0), transmitter, gps_m=0.3, rate_hz=rate_hz, seed=1).error_m < 2


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("make", "speed", "within_m"), [(Extremum, 2.0, 2), (Flux, 3.0, 1.5)])
def test_however_it_lies_buried(make: Maker, speed: float, within_m: float, seed: int) -> None:
    flight = fly_to_buried(seed, make(speed), seed=seed)
    assert flight.error_m < within_m
    assert flight.fastest <= speed + 1e-9


class SetBack:
    """Gives a strategy times of a clock that is set back by an hour 15 s after the start, and again 60 s after it."""

    def __init__(self, strategy: Strategy) -> None:
        self.strategy = strategy

    @property
    def found(self) -> Found | None:
        return self.strategy.found

    def observe(self, observation: Observation) -> None:
        self.strategy.observe(observation._replace(time_s=self._shown(observation.time_s)))

    def velocity(self, time_s: float, position: Position) -> Velocity:
        return self.strategy.velocity(self._shown(time_s), position)

    def _shown(self, time_s: float) -> float:
        return time_s - 3600 * ((time_s >= 15) + (time_s >= 60))


@pytest.mark.parametrize(("make", "within_m"), [(Estimate, 0.3), (Extremum, 1), (Flux, 1)])
def test_a_clock_that_is_set_back_ends_no_search(make: Maker, within_m: float) -> None:
    assert fly(SetBack(make(1.0)), PAPER[0]).error_m < within_m


@pytest.mark.parametrize("make", ALL)
def test_a_reading_without_a_place_is_passed_over(make: Maker) -> None:
    seeker, clean = make(1.0), make(1.0)
    for k in range(24):
        each = frame(k, 2500 - 40 * k, 20, north=k)
        for position in ((math.nan, 0.0, -1.0), (0.0, -math.inf, -1.0), (0.0, 0.0, 1e200)):
            seeker.observe(each._replace(position=position))
        seeker.observe(each._replace(rotation=np.full((3, 3), math.nan)))
        seeker.observe(each)
        clean.observe(each)
        assert seeker.velocity(k, (k, 0.0, -1.0)) == clean.velocity(k, (k, 0.0, -1.0))


@pytest.mark.parametrize("make", ALL)
def test_the_same_flight_again(make: Maker) -> None:
    a, b = of_paper(make, 1), of_paper.__wrapped__(make, 1)
    assert (a.found, a.time_s) == (b.found, b.time_s)


@every("silent_s", [0.0, 60.0])
@every("make", ALL)
def test_before_the_first_signal_it_stays(make: Maker, silent_s: float) -> None:
    seeker: Strategy = make(1.0)
    for time_s in (0.0, silent_s):
        seeker.observe(Observation(time_s, (0.0, 0.0, -1.0), np.eye(3), -1, -1, False))
    assert seeker.velocity(silent_s + 0.5, (0.0, 0.0, -1.0)) == STILL
