"""A drift that is believed with a place far off does not keep the search from the place."""

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
from tests.search.test_drift import MOMENT, PLACE, heard

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
