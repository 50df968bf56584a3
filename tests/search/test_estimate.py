"""The search by estimation: closed loops with the project's receiver, and frames written by hand."""

from __future__ import annotations

import math
import random
from collections import deque
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arva_hil.campaign import trial
from arva_hil.campaign.plan import draw
from arva_hil.config.campaign import Random
from arva_hil.search.strategies.estimate import Estimate
from arva_hil.search.strategies.strategy import Observation
from tests.search.world import PAPER, buried, fly


def frame(time_s: float, d_cm: int, delta_deg: int = 0, north: float = 0.0, east: float = 0.0) -> Observation:
    return Observation(time_s, (north, east, -1.0), np.eye(3), d_cm, delta_deg, 0 < d_cm <= 300)


@pytest.mark.parametrize(("rate_hz", "speed"), [(0.5, 1.0), (5.0, 2.0), (50.0, 1.0)])
def test_at_any_rate(rate_hz: float, speed: float) -> None:
    flight = fly(Estimate(speed), PAPER[0], rate_hz=rate_hz, seed=1)
    assert flight.error_m < 0.3
    assert flight.fastest <= speed + 1e-9


@pytest.mark.parametrize(("seed", "strength"), [(0, 0.6), (1, 1.6)])
def test_however_it_lies_buried_and_however_strong_it_is(seed: int, strength: float) -> None:
    transmitter, start = buried(seed, strength)
    flight = fly(Estimate(1.0), transmitter, start=start, seed=seed)
    assert flight.error_m < 0.5
    assert flight.time_s < 90


def test_with_a_position_that_is_not_known_well() -> None:
    transmitter, start = buried(3)
    flight = fly(Estimate(1.0), transmitter, start=start, gps_m=0.3, seed=3)
    assert flight.error_m < 1
    assert flight.found is not None
    assert flight.found.covariance is not None
    nn, ne, ee = flight.found.covariance
    assert 0 < nn < 0.09
    assert 0 < ee < 0.09
    assert nn * ee > ne * ne


class Late(Estimate):
    """Told what was heard some readings ago as if that were now."""

    def __init__(self, speed: float, readings: int) -> None:
        super().__init__(speed)
        self._behind = deque[Observation](maxlen=readings + 1)

    def observe(self, observation: Observation) -> None:
        self._behind.append(observation)
        then = self._behind[0]
        super().observe(observation._replace(d_cm=then.d_cm, delta_deg=then.delta_deg, inner=then.inner))


@pytest.mark.parametrize(("late_s", "seed"), [(2, 0), (5, 1)])
def test_readings_that_are_late_are_put_where_they_were_made(late_s: int, seed: int) -> None:
    transmitter, start = buried(seed)
    flight = fly(Late(1.0, late_s), transmitter, start=start, height_m=3.0, seed=seed)
    assert flight.error_m < 1


def test_a_position_that_drifts_is_averaged_above_the_transmitter() -> None:
    """One whose drift is hard to tell from readings that are late now more, now less: after one circle it is as
    likely that there is none.
    """
    scenario = replace(draw(Random(50.0, (0.0, 2.0), model="pulsed", keying="modern"), 175), seed=175)
    result = trial.fly(trial.Trial("estimate", scenario, gps_noise_m=1.0))
    assert result.outcome == "found"
    assert result.error_m is not None
    assert result.error_m < 2.0
    assert result.hover_m is not None
    assert result.hover_m < 1.0


def test_readings_of_another_transmitter_with_its_id_do_not_lead_astray() -> None:
    transmitter, start = buried(2)
    r = random.Random(2)
    flight = fly(
        Estimate(1.0), transmitter, "{id: 2, enu: [15, -10, 0]}", start=start, wrong=lambda _: r.random() < 0.2
    )
    assert flight.error_m < 0.3


def test_says_how_deep() -> None:
    found = fly(Estimate(1.0), PAPER[2]).found
    assert found is not None
    assert found.down == pytest.approx(1.0, abs=0.3)


def test_after_the_first_signal_it_follows_the_flux_line() -> None:
    seeker = Estimate(1.0)
    seeker.observe(frame(0.0, 2500, 40))
    north, east = seeker.velocity(0.5, (0.0, 0.0, -1.0))
    assert math.hypot(north, east) == pytest.approx(1.0)
    assert abs(math.sin(math.atan2(east, north) - math.radians(40))) < 0.5


def test_what_lies_behind_it_is_found_behind_it() -> None:
    """The field is the same 28 m ahead and behind: which, only the way flown tells."""
    for north in (28.0, -28.0):
        found = fly(Estimate(1.0), f"{{id: 1, ned: [{north}, 0, 1]}}").found
        assert found is not None
        assert found.north == pytest.approx(north, abs=0.3)


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


def test_a_position_that_is_not_a_number_is_passed_over() -> None:
    seeker, clean = Estimate(1.0), Estimate(1.0)
    for k in range(4):
        for each in (seeker, clean):
            each.observe(frame(k, 2500 - 90 * k, 20, north=k))
        seeker.observe(frame(k + 0.5, 2500, 20, north=math.nan))
    assert seeker.velocity(4.0, (3.0, 0.0, -1.0)) == clean.velocity(4.0, (3.0, 0.0, -1.0))


NONSENSE = st.tuples(st.integers(-1, 65535), st.integers(-90, 90), st.floats(-100, 100), st.floats(-100, 100))


@settings(max_examples=15)
@given(st.lists(NONSENSE, min_size=1, max_size=25), st.floats(0.2, 10))
def test_nonsense_is_survived(said: list[tuple[int, int, float, float]], speed: float) -> None:
    seeker = Estimate(speed)
    for k, (d_cm, delta_deg, north, east) in enumerate(said):
        seeker.observe(frame(3.0 * k, d_cm, delta_deg, north, east))
        velocity = seeker.velocity(3.0 * k, (north, east, -1.0))
        assert math.hypot(*velocity) <= speed * (1 + 1e-9)


def test_blanks_and_outliers_are_survived() -> None:
    class Deaf(Estimate):
        """Every fourth frame is blank, every ninth is another transmitter's."""

        n = 0

        def observe(self, observation: Observation) -> None:
            self.n += 1
            if self.n % 9 == 0:
                observation = observation._replace(d_cm=1234, delta_deg=-70, inner=False)
            elif self.n % 4 == 0:
                observation = observation._replace(d_cm=-1, delta_deg=-1, inner=False)
            super().observe(observation)

    transmitter, start = buried(0)
    assert fly(Deaf(1.0), transmitter, start=start, seed=0).error_m < 1
