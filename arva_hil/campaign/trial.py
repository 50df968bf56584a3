"""One trial of a campaign: its conditions, its flight and its result."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from operator import itemgetter
from typing import Final

from arva_hil.clock import StepClock
from arva_hil.config import Scenario
from arva_hil.events.reasons import Why, because
from arva_hil.events.words.reasons import in_words
from arva_hil.registry import STRATEGIES
from arva_hil.runtime.loop import run
from arva_hil.search.mission.outcome import SearchStep
from arva_hil.search.strategies.analysis import FAILED
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import sigma_of
from arva_hil.simulated.closed_loop import ClosedLoop, Drone, several

FOUND: Final = in_words(because(Why.FOUND))  # in the table of results
_STREAM_HZ: Final = 10.0  # of the pose; the vehicle's streams are most of the cost of a flight
_AROUND_S: Final = 120.0  # for the take-off


@dataclass(frozen=True, slots=True)
class Trial:
    """All conditions of a flight. The same trial gives the same result in every run."""

    strategy: str
    scenario: Scenario  # its seed is that of the receiver's noise
    take_off_m: float = 3.0  # height of the take-off
    height_m: float = 3.0  # height held in the search, above the ground
    speed_m_s: float = 1.0
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)  # NED, m/s
    gps_noise_m: float = 0.0  # sigma on each axis of the reported position's slow error
    limit_s: float = 900.0  # of the search, then it lands
    victims: int | None = 1  # the number to find; None: all
    area: tuple[float, float, float, float] = (-50.0, -50.0, 50.0, 50.0)  # south, west, north, east of home, m
    strip_width_m: float = 40.0
    drones: int = 1  # several divide the area and find one transmitter each; one finds all of `victims`


@dataclass(frozen=True)
class Result:
    """The result of a trial. The errors are None if nothing was found, or more places than there are transmitters.

    The errors are horizontal distances from the true transmitter: `error_m` to the place reported, `hover_m` to the
    true place of the vehicle at the end of the search, before the descent (None for several drones). Of several
    transmitters `error_m` is the largest, `hover_m` that of the last one. Of several drones: the time until enough were
    found, and the sums of paths and frames.

    `sigma_m`: the uncertainty of that place on Earth, None for several drones; `relative_m`, `relative_sigma_m`: error
    and uncertainty of the place relative to the vehicle, None for several transmitters or drones.
    """

    outcome: str  # "found", or why not
    error_m: float | None
    hover_m: float | None
    time_s: float  # from the end of take-off to the end of the search, on the vehicle's clock
    path_m: float  # flown in that time, horizontally
    frames: int
    sigma_m: float | None = None
    relative_m: float | None = None
    relative_sigma_m: float | None = None


def fly(trial: Trial, log: Callable[[SearchStep], None] | None = None) -> Result:
    """Fly one trial with a stepped clock: built-in vehicle, emulator, search. Raises nothing for a failed search.

    `log` gets every step of the flight of a single drone.
    """
    clock, team = StepClock(), trial.drones > 1
    plan = SearchPlan(
        STRATEGIES[trial.strategy],
        speed=trial.speed_m_s,
        height=trial.height_m,
        take_off=trial.take_off_m,
        limit_s=trial.limit_s,
        victims=1 if team else trial.victims,
        area=trial.area,
        strip_width=trial.strip_width_m,
    )
    loop = ClosedLoop(
        several(trial.scenario, trial.drones) if team else trial.scenario,
        plan,
        start=clock.now(),
        mounts_known=True,
        wind=trial.wind,
        gps_noise_m=trial.gps_noise_m,
        stream_hz=_STREAM_HZ,
        log=log,
    )
    wanted = trial.victims or len(trial.scenario.transmitters)
    first = loop.drones[0]

    def over() -> bool:
        return loop.over or len(loop.found) >= wanted if team else first.decided

    run(loop.tasks, clock, until=trial.limit_s + _AROUND_S, stopped=over)
    ends = [_outcome(drone, wanted) for drone in loop.drones]
    missions = [drone.mission for drone in loop.drones if drone.mission]
    errors = [error for drone in loop.drones if (error := drone.error()) is not None]
    hovers = first.mission is not None and first.mission.found is not None and not team
    return Result(
        next((one for one in ends if one.startswith(FAILED)), _counted(len(loop.found), wanted) if team else ends[0]),
        None if math.inf in errors else max(errors, default=None),
        first.off(clock.now()) if hovers else None,
        max((mission.progress.searched_s for mission in missions), default=0.0),
        sum((mission.progress.path_m for mission in missions), 0.0),
        sum(mission.progress.frames for mission in missions),
        *(() if team else _accuracy(first, clock.now())),
    )


def _accuracy(drone: Drone, now: float) -> tuple[float | None, ...]:
    """Return the uncertainty on Earth, and error and uncertainty relative to the vehicle; empty if nothing is found."""
    mission = drone.mission
    if mission is None:
        return ()
    accuracy = mission.reports.accuracy
    if drone.several:
        by_error = sorted(drone.errors().items(), key=itemgetter(1))
        return tuple(sigma_of(accuracy.on_earth(victim.found)) for victim, _ in by_error[-1:])
    if mission.found is None:
        return ()
    relative = sigma_of(accuracy.relative(mission.found))
    return sigma_of(accuracy.on_earth(mission.found)), drone.relative_error(now), relative


def _outcome(drone: Drone, wanted: int) -> str:
    outcome, mission = drone.search.outcome, drone.mission
    if mission is None:
        return in_words(outcome.how) if outcome else f"no take-off in {_AROUND_S:g} s"
    ended = in_words(mission.ended or (outcome.how if outcome else "no end"))
    places = mission.victims.places  # a search for all does not know how many there are
    return _counted(len(places), wanted) if drone.several and ended == FOUND else ended


def _counted(found: int, wanted: int) -> str:
    return FOUND if found >= wanted else f"{found} of {wanted} found"
