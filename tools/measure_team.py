"""Prints how long one drone and a team of them search the same fields, and how many transmitters they find.

    python tools/measure_team.py [--fields 10] [--drones 8] [--transmitters 4] [--strategy flux]

Each field has transmitters at random places in the area, at random attitudes, up to 2 m deep. One drone ends when it
has found one of them, so it also flies again, to the others, one flight for each: what one drone needs for all of them.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from statistics import median
from typing import NamedTuple

import numpy as np

from arva_hil.clock import Clock, StepClock, Waitable
from arva_hil.config import Scenario, load, parse
from arva_hil.mavlink.codec import Encoder, command, dialect
from arva_hil.registry import STRATEGIES
from arva_hil.runtime.loop import Task, run
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.simulated.autopilot import Mode
from arva_hil.simulated.closed_loop import ClosedLoop, Drone, several

LIMIT_S = 900.0


class Flown(NamedTuple):
    """`found_s`: when each transmitter was reported, from the start; `worst_m`: the largest error of a place;
    `nearest_m`: the least distance of two true positions, one of them in the air, from 10 s after the first take-off.
    """

    found_s: dict[int, float]
    end_s: float
    worst_m: float
    nearest_m: float


def field(seed: int, transmitters: int, half_m: float) -> Scenario:
    rng = np.random.default_rng(seed)
    lines = []
    for id_ in range(1, transmitters + 1):
        north, east = rng.uniform(-half_m, half_m, 2)
        roll, pitch, yaw = rng.uniform(-180, 180), rng.uniform(-90, 90), rng.uniform(-180, 180)
        pose = f"attitude: {{roll: {roll:.1f}, pitch: {pitch:.1f}, yaw: {yaw:.1f}}}"
        lines.append(f"{{id: {id_}, ned: [{north:.2f}, {east:.2f}, {rng.uniform(0, 2):.2f}], {pose}}}")
    return parse(f"spec: 2\nseed: {seed}\ntransmitters: [{', '.join(lines)}]\n", "field")


class Watch:
    """Remembers how near two vehicles came, ten times a second."""

    def __init__(self) -> None:
        self.nearest_m = math.inf
        self._next_s = math.inf  # nobody has taken off

    def look(self, loop: ClosedLoop, now: float) -> None:
        flying = [drone.vehicle.flying for drone in loop.drones]
        if self._next_s == math.inf and any(flying):
            self._next_s = now + 10.0
        if now < self._next_s:
            return
        self._next_s = now + 0.1
        places = [loop.frame.ned(*drone.vehicle.truth(now).lla) for drone in loop.drones]
        pairs = [pair for pair in combinations(range(len(places)), 2) if any(flying[n] for n in pair)]
        self.nearest_m = min([self.nearest_m, *(math.dist(places[a], places[b]) for a, b in pairs)])


class Killed:
    """A search that is killed at an instant. 2 s later its autopilot lands, flies home, or goes on hovering."""

    def __init__(self, drone: Drone, at_s: float, failsafe: Mode | None) -> None:
        self.drone = drone
        self.links: Sequence[Waitable] = drone.search.links
        self._at_s = at_s
        self._failsafe = failsafe

    def service(self, clock: Clock) -> float:
        now = clock.now()
        if now < self._at_s:
            return min(self.drone.search.service(clock), self._at_s)
        self.links = ()
        if self._failsafe is not None and now >= self._at_s + 2.0:
            mode = command(self.drone.vehicle.system, 1, dialect.MAV_CMD_DO_SET_MODE, 1, self._failsafe)
            self.drone.vehicle.feed(Encoder(255, 190).pack(mode), now, link=9)
            self._failsafe = None
        return self._at_s + 2.0 if self._failsafe is not None else math.inf


def killed(loop: ClosedLoop, count: int, seed: int) -> list[Killed]:
    """So many, at random instants from 10 s to 60 s after the start."""
    rng = np.random.default_rng(seed)
    drones = rng.choice(len(loop.drones), count, replace=False)
    kinds = (Mode.LAND, Mode.RTL, None)
    return [Killed(loop.drones[n], rng.uniform(10, 60), kinds[rng.integers(3)]) for n in drones]


def fly(scenario: Scenario, drones: int, plan: SearchPlan, kill: int = 0) -> Flown:
    clock, found, watch = StepClock(), dict[int, float](), Watch()
    loop = ClosedLoop(several(scenario, drones), plan, start=0.0, stream_hz=10.0)
    lost = {id(one.drone.search): one for one in killed(loop, kill, scenario.seed)}
    tasks: list[Task] = [lost.get(id(task), task) for task in loop.tasks]

    def over() -> bool:
        for id_ in loop.found - found.keys():
            found[id_] = clock.now()
        watch.look(loop, clock.now())
        return all(drone.search.outcome or id(drone.search) in lost for drone in loop.drones)

    run(tasks, clock, until=LIMIT_S + 120, stopped=over)
    errors = [error for drone in loop.drones if (error := drone.error()) is not None]
    return Flown(found, clock.now(), max(errors, default=0.0), watch.nearest_m)


def again_and_again(scenario: Scenario, plan: SearchPlan) -> Flown:
    """One drone, one flight for each transmitter; those that are found are switched off."""
    found, now, worst, nearest = dict[int, float](), 0.0, 0.0, math.inf
    while len(found) < len(scenario.transmitters):
        left = tuple(t for t in scenario.transmitters if t.id not in found)
        flown = fly(replace(scenario, transmitters=left), 1, plan)
        found |= {id_: now + at for id_, at in flown.found_s.items()}
        now, worst = now + flown.end_s, max(worst, flown.worst_m)
        if not flown.found_s:
            break
    return Flown(found, now, worst, nearest)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fields", type=int, default=10)
    parser.add_argument("--drones", type=int, default=8)
    parser.add_argument("--transmitters", type=int, default=4)
    parser.add_argument("--half", type=float, default=45.0, help="transmitters within ± this, m; default 45")
    parser.add_argument("--strategy", default="flux")
    parser.add_argument("--team-only", action="store_false", dest="one", help="without the flights of one drone")
    parser.add_argument("--layout", nargs="+", metavar="SCENARIO", help="only the team, on these, with several seeds")
    parser.add_argument("--area", type=float, default=50.0, help="searched within ± this, m; default 50")
    parser.add_argument("--kill", type=int, default=0, help="so many searches at random instants; with --team-only")
    parser.add_argument("--speed", type=float, default=1.0, help="m/s; default 1")
    options = parser.parse_args()
    area = (-options.area, -options.area, options.area, options.area)
    plan = SearchPlan(STRATEGIES[options.strategy], speed=options.speed, area=area, limit_s=LIMIT_S)
    for name in options.layout or ():
        same = [replace(load(name), seed=seed) for seed in range(options.fields)]
        flown = [fly(scenario, options.drones, plan) for scenario in same]
        print(f"{name}, {options.drones} drones: {tell(flown, len(same[0].transmitters))}", flush=True)
    if options.layout:
        return
    fields = [field(seed, options.transmitters, options.half) for seed in range(options.fields)]
    one = [again_and_again(scenario, plan) for scenario in fields] if options.one else []
    team = [fly(scenario, options.drones, plan, options.kill) for scenario in fields]
    for name, flown in (("one drone, a flight for each transmitter", one), (f"{options.drones} drones", team)):
        if not flown:
            continue
        print(f"{name}: {tell(flown, options.transmitters)}", flush=True)


def tell(flown: Sequence[Flown], transmitters: int) -> str:
    first = [min(f.found_s.values()) for f in flown if f.found_s]
    whole = [max(f.found_s.values()) for f in flown if len(f.found_s) == transmitters]
    count = sum(len(f.found_s) for f in flown)
    said = f"found {count} of {len(flown) * transmitters}; first after {median(first):.0f} s (median)"
    if whole:
        said += f"; all after {median(whole):.0f} s, in {len(whole)} of {len(flown)} fields"
    said += f"; largest error {max(f.worst_m for f in flown):.1f} m"
    nearest = min(f.nearest_m for f in flown)
    return said if nearest == math.inf else said + f"; two vehicles {nearest:.1f} m apart at least"


if __name__ == "__main__":
    main()
