"""Electronics near the receiver drown what is far off; the search knows then which readings say something."""

from __future__ import annotations

import math

import numpy as np

from arva_hil.search.strategies.agreement import Evidence, beginning
from arva_hil.search.strategies.history import NOTHING, Explanation
from arva_hil.search.strategies.strategy import Observation
from tests.search.test_drift import MOMENT, PLACE

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
    assert judgement is not None
    assert judgement.agrees(3.0)
