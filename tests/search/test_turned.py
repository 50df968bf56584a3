"""A receiver that is not turned as its vehicle reports, by a compass or a mount that is off."""

from __future__ import annotations

import math

import pytest

from arva_hil.search.strategies.estimate import Estimate
from arva_hil.search.strategies.strategy import Observation
from tests.search.world import buried, fly


class Turned(Estimate):
    """Gets δ as a receiver reads it that is turned by `degrees`."""

    degrees = 0

    def observe(self, observation: Observation) -> None:
        delta = (observation.delta_deg - self.degrees + 90) % 180 - 90
        super().observe(observation._replace(delta_deg=delta))


@pytest.mark.parametrize(("degrees", "seed"), [(0, 1), (10, 0), (-12, 1)])
def test_the_place_is_right_and_a_large_angle_is_reported(degrees: int, seed: int) -> None:
    strategy = Turned(1.0)
    strategy.degrees = degrees
    transmitter, start = buried(seed)
    found = fly(strategy, transmitter, start=start, height_m=3.0, seed=seed).found
    assert found is not None
    assert math.hypot(found.north, found.east) < 0.3
    assert found.turned_deg == (pytest.approx(degrees, abs=3) if degrees else None)
