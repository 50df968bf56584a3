"""The plan by the options of a search, for one drone or several."""

from __future__ import annotations

import argparse
import json
import math
from itertools import pairwise
from typing import Final

from arva_hil.cli.outcome import UsageError
from arva_hil.cli.terminal import tell
from arva_hil.config import Scenario, ScenarioError, parse
from arva_hil.model.field.rotation import Mount, from_euler
from arva_hil.registry import STRATEGIES, formats_with_ids
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strips import Strips
from arva_hil.search.team.team_field import divide

_NARROWEST_M: Final = 4.0  # narrowest part of an area that is worth a drone


def plan_of(options: argparse.Namespace, scenario: Scenario | None = None) -> SearchPlan:
    """Return the plan of the options; `scenario`: that of the receiver of `--strip-width auto`."""
    return SearchPlan(
        STRATEGIES[options.strategy],
        speed=options.max_speed,
        height=options.height,
        take_off=options.take_off,
        trust_gps=options.trust_height,
        area=options.area,
        strip_width=_strip_width(options, scenario),
        patience_s=options.patience,
        limit_s=options.limit,
        victims=None if options.victims == "all" else options.victims,
        mount=Mount(options.mount[:3], from_euler(*map(math.radians, options.mount[3:]))),
    )


def _strip_width(options: argparse.Namespace, scenario: Scenario | None) -> float:
    """Return the given width, or the width that a receiver allows. Raises UsageError."""
    given = options.strip_width
    if isinstance(given, float):
        return given
    from arva_hil.campaign.range_test.strips import strip_width  # slow to import

    if given != "auto":
        file = {"spec": 2, "transmitters": [{"id": 0, "ned": [0, 0, 0]}], "receiver": {"profile": given}}
        try:
            scenario = parse(json.dumps(file), "--strip-width")
        except ScenarioError as error:
            wrong = error.problems[0]
            if wrong.source != "--strip-width":
                raise UsageError(*error.problems) from None
            hint = f", did you mean {wrong.nearest}?" if wrong.nearest else ""
            raise UsageError(f"--strip-width: {wrong.found}, expected {wrong.expected}{hint}") from None
    if scenario is None:
        raise UsageError("--strip-width auto: give the receiver's profile, e.g. --strip-width builtin:two_antennas")
    width = strip_width(scenario, options.height, options.max_speed)
    if width is None:
        raise UsageError(f"--strip-width {given}: that receiver's range is too short for strips")
    tell(
        f"strips at most {width.metres:.0f} m wide: 1.26 × the range for the weakest transmitter; "
        f"{width.detection:.1%} of simulated flights along such a strip receive it"
    )
    return width.metres


def describe(plan: SearchPlan) -> str:
    """Return a line about the strips before the first signal. Raises UsageError if they take too much time."""
    lanes = Strips(plan.area, plan.speed, (0.0, 0.0, 0.0), width=plan.strip_width).lanes
    there = math.hypot(*lanes[0])
    way = there + sum(math.dist(a, b) for a, b in pairwise(lanes))
    at = f"at {plan.speed:g} m/s"
    if there > plan.limit_s * plan.speed:
        raise UsageError(f"--area: its nearest corner is {there:.0f} m away, {at} too far for --limit {plan.limit_s:g}")
    less = f", more than the {plan.limit_s:g} s there are" if way > plan.limit_s * plan.speed else ""
    return f"strips of {way:.0f} m until the first signal, {way / plan.speed:.0f} s {at}{less}"


def check_receivers(base: Scenario) -> None:
    """Check that each vehicle has one receiver, whose frames carry ids. Raises UsageError."""
    for vehicle in base.vehicles:
        if len(vehicle.receivers) > 1:
            raise UsageError(f"{base.source}: {vehicle.name}: {len(vehicle.receivers)} receivers; a drone has one here")
    formats = [receiver.output_format for vehicle in base.vehicles for receiver in vehicle.receivers]
    for of in formats or [base.output_format]:
        if of not in (usable := formats_with_ids()):
            raise UsageError(f"format {of}: several drones need {' or '.join(usable)}, whose frames carry ids")


def check_width(options: argparse.Namespace, count: int) -> None:
    """Check that the parts of the area are wide enough. Raises UsageError."""
    _, west, _, east = divide(options.area, count)[0]
    if east - west < _NARROWEST_M:
        raise UsageError(
            f"--area: {count} drones would have {east - west:.1f} m each, at least {_NARROWEST_M:g} m needed"
        )
