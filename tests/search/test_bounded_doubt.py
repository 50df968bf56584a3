"""A search in doubt ends in bounded time after it first came above a place, whatever it goes through."""

from __future__ import annotations

import math

import numpy as np
import pytest

from arva_hil.search.strategies import estimate
from arva_hil.search.strategies.agreement import Evidence
from arva_hil.search.strategies.dipole import Array
from arva_hil.search.strategies.estimate import Estimate
from arva_hil.search.strategies.history import NOTHING, Cause, Explanation
from arva_hil.search.strategies.strategy import Observation
from tests.search.world import PAPER, fly

NEAR = PAPER[1]  # 10 m away: the vehicle is above it within 30 s
ENDS_S = 30 + 240 + 10


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
    flight = fly(Estimate(1.0), NEAR, rate_hz=0.2, limit_s=400)
    assert flight.found is not None
    assert flight.time_s < ENDS_S
    assert flight.error_m < 1


def test_though_it_never_comes_above_a_place_again() -> None:
    strategy = Confused(1.0)
    flight = fly(strategy, NEAR, rate_hz=0.2, limit_s=400)
    assert strategy.circles
    assert flight.found is not None
    assert flight.time_s < ENDS_S
