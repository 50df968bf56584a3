"""Widths of search strips: by a receiver's range, and by the probability that a flight detects a transmitter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from arva_hil.campaign.range_test.walk import COUPLINGS, RangePlan, Walk, alone, frames, walked
from arva_hil.config import KeyingOptions, Scenario, Transmitter
from arva_hil.model.field import rotation

_FACTOR: Final = 1.26  # Schreilechner, Eck, Schober, ISSW 2009
_WEAKEST: Final = 0.5  # strength of the norm's weakest set; 1 is 1 µA/m at 10 m
_DEEP_M: Final = 1.0  # below the ground
_PASSES: Final = 200
_LEAST_M: Final = 1.0
_BEFORE: Final = 1.2  # share of the width by which a flight begins ahead of the transmitter


@dataclass(frozen=True)
class StripWidth:
    """A width of search strips, and its share of detections.

    `metres`: the width by the formula. `detection`: the share of flights along a strip of this width that detect a
    transmitter of any attitude, anywhere in it.
    """

    metres: float
    detection: float


def formula_m(coaxial: Sequence[Walk]) -> float | None:
    """Return 1.26 × (mean − 2 s.d.) of the coaxial ranges [m]; None without a stable signal in a walk, or below 1."""
    ranges = [walk.stable_m for walk in coaxial if walk.stable_m is not None]
    if len(ranges) < max(len(coaxial), 1):
        return None
    metres = _FACTOR * float(np.mean(ranges) - (2 * np.std(ranges, ddof=1) if len(ranges) > 1 else 0.0))
    return metres if metres >= _LEAST_M else None


def strip_width(scenario: Scenario, height_m: float, speed_m_s: float) -> StripWidth | None:
    """Return the width for the scenario's receiver and the weakest set of the norm, a metre deep.

    None if the receiver's range is too short for strips. `height_m`: above the ground.
    """
    weakest = Transmitter(0, ned=(0.0, 0.0, 0.0), strength=_WEAKEST, keying=KeyingOptions())
    of = replace(scenario, transmitters=(weakest,), terrain=None, medium=None, vehicles=())
    plan = RangePlan(height_m + _DEEP_M, speed_m_s, passes=_PASSES)
    metres = formula_m([walked(of, COUPLINGS[0], plan, n, motors=True) for n in range(plan.walks)])
    return None if metres is None else StripWidth(metres, detection(of, plan, metres))


def detection(scenario: Scenario, plan: RangePlan, width_m: float, *, motors: bool = True) -> float:
    """Return the share of flights along a strip that detect the scenario's first transmitter.

    The seed draws its attitude and its place across the strip.
    """
    return sum(_is_heard(scenario, plan, width_m, number, motors) for number in range(plan.passes)) / plan.passes


def _is_heard(scenario: Scenario, plan: RangePlan, width_m: float, number: int, motors: bool) -> bool:
    random = np.random.default_rng([scenario.seed, number])
    angles = np.degrees(rotation.to_euler(random.standard_normal(4))).tolist()
    aside = (random.uniform() - 0.5) * width_m
    start_m = min(_BEFORE * width_m, plan.start_m)

    def place(time_s: float) -> tuple[float, float, float]:
        return start_m - plan.speed_m_s * time_s, aside, -plan.height_m

    one = alone(scenario, (angles[0], angles[1], angles[2]), number)
    every = frames(one, place, math.radians(180.0), 2 * start_m / plan.speed_m_s, motors=motors)
    return any(not math.isnan(d_m) for _, d_m in every)
