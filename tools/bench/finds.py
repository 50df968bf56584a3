"""Prints the outcomes of searches with faults of configs/faults.yaml, and the number of false finds.

    python -m tools bench finds [--strategy estimate] [--runs 2000] [--first 1] [--faults 3] [--verbose]

Each run draws transmitters within ±40 m, up to 2 m deep, and up to three faults, each for all the time or for a part
of it. A find is false that is more than 3 m from the true place. A transmitter that a fault has moved is where it was,
or where it is when the search ends.
"""

from __future__ import annotations

import math
import random
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

from arva_hil.campaign.plan import draw
from arva_hil.campaign.trial import FOUND
from arva_hil.clock import StepClock
from arva_hil.config import Fault, Scenario, load
from arva_hil.config.campaign import Random
from arva_hil.events.words.reasons import in_words
from arva_hil.registry import STRATEGIES
from arva_hil.runtime.loop import run
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.simulated.closed_loop import ClosedLoop, Drone
from tools.options import parser

FALSE_M: Final = 3.0
_LIMIT_S: Final = 300.0
_FAULTS: Final = Path(__file__).parents[2] / "configs" / "faults.yaml"
_SCHEDULE_S: Final = (5.0, 50.0)  # when a fault begins
_LASTS_S: Final = (2.0, 40.0)
_ALWAYS: Final = 0.4  # of the faults, if the search can work with it at all
_NEVER_ALWAYS: Final = ("silence", "transmitter_off", "transmitter_fading", "transmitter_moved", "stuck", "baud_ratio")


class Flown(NamedTuple):
    """`error_m`: of the place reported, horizontally."""

    seed: int
    faults: tuple[str, ...]
    outcome: str
    error_m: float | None
    time_s: float

    @property
    def kind(self) -> str:
        if self.outcome != FOUND:
            return self.outcome.partition(":")[0]
        return FOUND if self.error_m is not None and self.error_m <= FALSE_M else "false"


def scenario(seed: int, most: int) -> Scenario:
    """Two transmitters and at most so many faults, drawn by the seed."""
    base, r = load(_FAULTS), random.Random(f"faults {seed}")
    there = [draw(Random(40.0, (0.0, 2.0)), 2 * seed + n).transmitters[0] for n in range(2)]
    chosen = r.sample(base.faults, r.randint(1, most))
    faults = tuple(scheduled(fault, r) for fault in chosen)
    return replace(base, transmitters=(there[0], replace(there[1], id=2)), faults=faults, seed=seed)


def scheduled(fault: Fault, r: random.Random) -> Fault:
    """The fault at other times, and of another size where it has one."""
    begin, lasts = r.uniform(*_SCHEDULE_S), r.uniform(*_LASTS_S)
    always = r.random() < _ALWAYS
    if fault.name in ("transmitter_off", "transmitter_moved", "transmitter_fading"):
        fault = replace(fault, value=r.choice((1, 2)))
    if fault.by_ned:
        north, east = (round(r.uniform(-8, 8), 1) for _ in "ne")
        fault = replace(fault, by_ned=(north, east, 0.0))
    if fault.name == "delay_s":
        fault = replace(fault, value=r.choice((0.3, 1.0, 2.0, 5.0)))
    if fault.name == "interference" and always:
        return replace(fault, from_s=0.0)
    if fault.name not in _NEVER_ALWAYS and always:
        return replace(fault, from_s=0.0, every_s=None, for_s=None)
    return replace(fault, from_s=round(begin, 1), until_s=round(begin + lasts, 1), every_s=None, for_s=None)


def flown(strategy: str, seed: int, most: int) -> Flown:
    """Fly one search with a stepped clock, like a campaign."""
    world, clock = scenario(seed, most), StepClock()
    plan = SearchPlan(STRATEGIES[strategy], limit_s=_LIMIT_S)
    loop = ClosedLoop(world, plan, start=clock.now(), stream_hz=10.0)
    (drone,) = loop.drones
    run(loop.tasks, clock, until=_LIMIT_S + 120.0, stopped=lambda: drone.decided)
    mission, outcome = drone.mission, drone.search.outcome
    told = in_words(mission.ended) if mission else in_words(outcome.how) if outcome else "no take-off"
    return Flown(
        seed,
        tuple(map(str, world.faults)),
        told,
        error(drone, world, clock.now()),
        mission.progress.searched_s if mission else 0,
    )


def error(drone: Drone, world: Scenario, now: float) -> float | None:
    """Return the distance from the place reported to the transmitter, also to its place before a fault moved it."""
    mission = drone.mission
    if mission is None or mission.found is None:
        return None
    place, (north, east, _) = mission.found[:2], drone.truth()[mission.choice.target or 0]
    moves = [f.by_ned for f in world.faults if f.by_ned and f.value == mission.choice.target and _on(f, now)]
    true = [(north, east), *((north + move[0], east + move[1]) for move in moves)]
    return min(math.dist(place, one) for one in true)


def _on(fault: Fault, now: float) -> bool:
    return fault.since(round(now * 1e6)) is not None


def main() -> None:
    options = parser(
        __doc__,
        strategy=("estimate", "of the search"),
        runs=(2000, "searches"),
        first=(1, "seed of the first"),
        jobs=(2, "at a time"),
        faults=(3, "at most so many at once"),
        verbose=(False, "print every run"),
    ).parse_args()
    seeds = range(options.first, options.first + options.runs)
    with ProcessPoolExecutor(options.jobs) as workers:
        each = [workers.submit(flown, options.strategy, s, options.faults) for s in seeds]
        kinds = Counter(tell(one.result(), options.verbose) for one in each)
    found = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    print(f"{options.strategy}: {options.runs} runs: {found}")


def tell(one: Flown, verbose: bool) -> str:
    """Print a run, if it is wanted or false. Returns its kind."""
    if verbose or one.kind == "false":
        error = "" if one.error_m is None else f" {one.error_m:.2f} m"
        print(f"{one.seed} {one.kind}{error} after {one.time_s:.0f} s: {' '.join(one.faults)}", flush=True)
    return one.kind
