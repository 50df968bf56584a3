"""Every strategy in closed loop with the project's receiver."""

from __future__ import annotations

import numpy as np
import pytest

from arva_hil.search.strategies.estimate import Estimate
from arva_hil.search.strategies.extremum import Extremum
from arva_hil.search.strategies.flux import Flux
from arva_hil.search.strategies.strategy import STILL, Observation, Strategy
from tests.every import every
from tests.search.world import PAPER, buried, fly

ALL = [Estimate, Extremum, Flux]
Maker = type[Estimate] | type[Extremum] | type[Flux]


@pytest.mark.parametrize(("seed", "transmitter"), [*enumerate(PAPER)])
@pytest.mark.parametrize(("make", "within_m", "within_s"), [(Estimate, 0.3, 45), (Extremum, 1, 250), (Flux, 1, 200)])
def test_the_cases_of_the_paper(make: Maker, within_m: float, within_s: float, seed: int, transmitter: str) -> None:
    flight = fly(make(1.0), transmitter, height_m=1 + 0.2 * seed, yaw=2.0 * seed, seed=seed)
    assert flight.error_m < within_m
    assert flight.fastest <= 1.0 + 1e-9
    assert flight.time_s < within_s


@pytest.mark.parametrize(
    ("transmitter", "rate_hz"), [(PAPER[0], 0.5), (PAPER[1], 5), (PAPER[2], 0.5), (PAPER[3], 5), (PAPER[3], 50)]
)
@pytest.mark.parametrize("make", [Extremum, Flux])
def test_with_a_position_that_is_not_known_well_and_at_any_rate(make: Maker, transmitter: str, rate_hz: float) -> None:
    assert fly(make(1.0), transmitter, gps_m=0.3, rate_hz=rate_hz, seed=1).error_m < 2


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("make", "speed", "within_m"), [(Extremum, 2.0, 2), (Flux, 3.0, 1.5)])
def test_however_it_lies_buried(make: Maker, speed: float, within_m: float, seed: int) -> None:
    transmitter, start = buried(seed)
    flight = fly(make(speed), transmitter, start=start, seed=seed)
    assert flight.error_m < within_m
    assert flight.fastest <= speed + 1e-9


@pytest.mark.parametrize("make", ALL)
def test_the_same_flight_again(make: Maker) -> None:
    a, b = (fly(make(1.0), PAPER[3], gps_m=0.3, seed=7) for _ in range(2))
    assert (a.found, a.time_s) == (b.found, b.time_s)


@every("silent_s", [0.0, 60.0])
@every("make", ALL)
def test_before_the_first_signal_it_stays(make: Maker, silent_s: float) -> None:
    seeker: Strategy = make(1.0)
    for time_s in (0.0, silent_s):
        seeker.observe(Observation(time_s, (0.0, 0.0, -1.0), np.eye(3), -1, -1, False))
    assert seeker.velocity(silent_s + 0.5, (0.0, 0.0, -1.0)) == STILL
