"""What was read before the transmitter moved, and while an antenna was dead, does not spoil the place that is told."""

from __future__ import annotations

import math

import numpy as np

from arva_hil.search.strategies.agreement import Evidence
from arva_hil.search.strategies.history import NOTHING
from arva_hil.search.strategies.strategy import Observation
from tests.search.test_drift import MOMENT, PLACE

MOVED_S = 40


def listened(away: tuple[float, float], gain_y: float) -> Evidence:
    """A level receiver that looks north, on its way from 25 m, and round the place from second 26 on. Until it moves,
    the transmitter is `away` (north, east) from there, and the receiver's antenna y has `gain_y`.
    """
    evidence = Evidence()
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
        evidence.add(Observation(1.0 * k, (north, east, down), np.eye(3), d_cm, delta_deg, False))
    return evidence


def test_readings_from_before_it_moved_and_of_an_antenna_that_hears_again_are_left_out() -> None:
    judgement = listened((7.6, -1.2), 0.0).judge((0.0, 0.0))
    assert judgement is not None
    assert judgement.agrees(3.0)
    assert math.dist(judgement.there.x[0, :2], PLACE[:2]) < 0.1


def test_where_nothing_has_changed_all_readings_are_used() -> None:
    judgement = listened((0.0, 0.0), 1.0).judge((0.0, 0.0))
    assert judgement is not None
    assert judgement.there.cause == NOTHING
