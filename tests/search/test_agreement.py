"""A place agrees with what was heard, or it does not, whatever strategy has found it."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest

from arva_hil.search.strategies.agreement import Evidence
from arva_hil.search.strategies.estimate import Estimate
from arva_hil.search.strategies.extremum import Extremum
from arva_hil.search.strategies.flux import Flux
from arva_hil.search.strategies.strategy import Observation, Strategy
from tests.search.world import PAPER, buried, fly


def agrees(heard: list[Observation], place: tuple[float, float], height_m: float = 1.0) -> bool:
    evidence = Evidence()
    for observation in heard:
        evidence.add(observation)
    judgement = evidence.judge(place)
    return judgement is not None and judgement.agrees(height_m)


@pytest.mark.parametrize(
    ("strategy", "seed", "height_m", "aside_m"),
    [
        (Flux, 1, 3.0, (0.0, -15.0)),
        (Extremum, 2, 1.0, (0.0, -15.0)),
        (Estimate, 3, 3.0, (7.7, 0.0)),
    ],
)
def test_what_was_found_agrees_and_what_lies_elsewhere_does_not(
    strategy: type[Strategy], seed: int, height_m: float, aside_m: tuple[float, float]
) -> None:
    transmitter, start = buried(seed)
    flight = fly(strategy(1.0), transmitter, start=start, height_m=height_m, gps_m=0.2, seed=seed)
    assert flight.found is not None
    north, east = flight.found[:2]
    assert agrees(flight.heard, (north, east), height_m)
    assert not agrees(flight.heard, (north + aside_m[0], east + aside_m[1]), height_m)


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


@pytest.mark.parametrize("d_m", [1.0, 30.0])
def test_the_same_d_everywhere_is_no_transmitter(d_m: float) -> None:
    """Whatever the direction: such a one would have to lie deep, or be stronger or weaker than any."""
    rng, heard = np.random.default_rng(1), []
    for k in range(60):
        at = (3 * math.cos(k / 4), 3 * math.sin(k / 4), -3.0)
        heard.append(Observation(k, at, np.eye(3), round(100 * d_m), int(rng.integers(-89, 90)), d_m <= 3))
    assert not agrees(heard, (0.0, 0.0), 3.0)


def test_readings_that_are_no_numbers_say_nothing() -> None:
    nowhere = [Observation(k, (math.nan, k, -1.0), np.eye(3), 500, 0, False) for k in range(9)]
    odd = [Observation(k, (k, 0.0, -1.0), np.full((3, 3), math.inf), 500, 0, False) for k in range(9)]
    assert not agrees(nowhere + odd, (0.0, 0.0))


def test_readings_of_one_that_has_moved_contradict_the_place_judged_before() -> None:
    """What is read at the end of the circle is told again, as if that were 4 m beside."""
    transmitter, start = buried(0)
    flight = fly(Estimate(1.0), transmitter, start=start, height_m=3.0)
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
