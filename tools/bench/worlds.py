"""Prints how honest the two ± of a search are, in worlds that no hypothesis of `estimate` covers.

    python -m tools bench worlds [WORLD…] [--runs 12] [--first 1] [--jobs 2] [--verbose]

The worlds beginning with any_ and `anything` are drawn by families of their own: pose errors of steps, ramps, waves and
walks, other displays, other noise, other mounts, moments and antennas. Errors are horizontal: of the position on Earth,
and of the vector from the drone to the place at the end of the search. Median, worst, median ±, and shares inside 1σ,
2σ, 3σ.
"""

from __future__ import annotations

import math
import random
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np

from arva_hil.campaign.plan import draw
from arva_hil.campaign.trial import FOUND
from arva_hil.clock import StepClock
from arva_hil.config import Fault, NavigationError, Scenario
from arva_hil.config.campaign import Random
from arva_hil.config.receiver import MountOptions
from arva_hil.events.words.reasons import in_words
from arva_hil.model.field import rotation
from arva_hil.model.receiver.pulsed import PulsedReceiver
from arva_hil.model.receiver.reading import ChannelReading, Reading
from arva_hil.registry import RECEIVERS, STRATEGIES
from arva_hil.runtime.loop import run
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import sigma_of
from arva_hil.simulated.closed_loop import ClosedLoop
from tools.options import parser

_LIMIT_S: Final = 900.0
_STEP_S: Final = 0.5  # of the walks
_NEAR_M: Final = 0.5
_FALSE_M: Final = 2.0


class Flown(NamedTuple):
    """One search. Errors and ± in metres, infinite without a place; `relative`: of the vector from the drone."""

    seed: int
    outcome: str
    time_s: float = 0.0
    error: float = math.inf
    sigma: float | None = None
    relative: float = math.inf
    relative_sigma: float | None = None
    turned_deg: float | None = None


class AnyPoseError:
    """True pose minus the reported one: steps, ramps, waves and walks of several τ; a turn of the compass.

    Remembers the walks until the newest time.
    """

    def __init__(self, seed: int, sigma_m: float, compass_deg: float) -> None:
        r = self._random = random.Random(f"pose {seed}")
        self._turn: Any = rotation.from_euler(0.0, 0.0, math.radians(compass_deg))
        self._offset = [r.gauss(0, sigma_m) for _ in "ned"]
        self._ramp = [r.gauss(0, sigma_m / 600) for _ in "ned"]
        self._waves = [(r.gauss(0, 0.4 * sigma_m), r.uniform(40, 900), r.uniform(0, 6.3)) for _ in "ned"]
        self._taus = [math.exp(r.uniform(math.log(5), math.log(1200))) for _ in range(3)]
        self._jumps = sorted((r.uniform(0, 400), [r.gauss(0, 0.2 * sigma_m) for _ in "ned"]) for _ in range(2))
        self._sigma = 0.6 * sigma_m / math.sqrt(3)
        self._walks = [np.array([[r.gauss(0, self._sigma) for _ in "ned"] for _ in self._taus])]

    def true_pose(self, time_s: float, position: Any, attitude: Any) -> tuple[Any, Any]:
        number, error = max(0.0, time_s / _STEP_S), np.array(self._offset)
        while len(self._walks) < number + 2:
            kept = np.exp(-_STEP_S / np.array(self._taus))[:, None]
            drawn = np.array([[self._random.gauss(0, self._sigma) for _ in "ned"] for _ in self._taus])
            self._walks.append(kept * self._walks[-1] + np.sqrt(1 - kept**2) * drawn)
        share = number - int(number)
        error += ((1 - share) * self._walks[int(number)] + share * self._walks[int(number) + 1]).sum(axis=0)
        error += time_s * np.array(self._ramp)
        error += [size * math.sin(time_s * 2 * math.pi / period + phase) for size, period, phase in self._waves]
        for at, jump in self._jumps:
            error += np.array(jump) * min(max(time_s - at, 0.0) / 2, 1.0)
        return position + error, rotation.multiply(self._turn, rotation.unit(*attitude))


class OtherDisplay(PulsedReceiver):
    """A receiver whose d follows another law, with another scale, and whose δ is bent: all drawn by its seed."""

    def __init__(self, settings: Any, options: Any, seed: int) -> None:
        super().__init__(settings, options, seed)
        r = random.Random(f"display {seed}")
        self._power, self._scale = r.uniform(0.92, 1.08), r.uniform(0.8, 1.25)
        self._bent, self._aside = r.uniform(-0.15, 0.15), r.uniform(-4, 4)

    def show(self, time_s: float) -> Reading:
        shown = super().show(time_s)
        return replace(shown, channels=tuple(map(self._other, shown.channels)))

    def _other(self, c: ChannelReading) -> ChannelReading:
        if c.zone == 0:
            return c
        bent = c.delta_deg + self._aside + 90 / math.pi * self._bent * math.sin(2 * math.radians(c.delta_deg))
        d_cm = round(self._scale * 10 * 100 * (c.d_cm / 1000) ** self._power)
        return c._replace(d_cm=min(max(d_cm, 1), 32767), delta_deg=(round(bent) + 90) % 180 - 90)


class OtherNoise(PulsedReceiver):
    """Noise of the antennas with heavy tails that comes in bursts, over the receiver's own."""

    def __init__(self, settings: Any, options: Any, seed: int) -> None:
        super().__init__(settings, options, seed)
        self._other, own = random.Random(f"noise {seed}"), self._listening.noise
        self._burst = 0

        def noise(index: int) -> tuple[float, float, float]:
            r = self._other
            self._burst = self._burst - 1 if self._burst else (r.random() < 0.05) * r.randint(1, 6)
            size = options.noise_na_m / options.scale_na_m * (r.paretovariate(1.5) if self._burst else 0.3)
            x, y, z = own(index)
            return x + r.gauss(0, size), y + r.gauss(0, size), z + r.gauss(0, size)

        self._listening.noise = noise  # type: ignore[assignment,method-assign]


RECEIVERS.loaded |= {"other_display": OtherDisplay, "other_noise": OtherNoise}


@dataclass(frozen=True)
class World:
    """A world, by a seed. `error`: of the pose, in place of the scenario's. `area_m`: half of its side."""

    scenario: Scenario
    error: AnyPoseError | None = None
    area_m: float = 50.0


def _base(seed: int, model: str = "paper", **receiver: Any) -> Scenario:
    keying: Any = None if model == "paper" else "modern"
    buried = draw(Random(50.0, (0.0, 2.0), model=model, keying=keying), seed)
    buried = replace(buried, seed=seed)
    return replace(buried, receiver=replace(buried.receiver, **receiver)) if receiver else buried


def _navigation(**error: Any) -> Callable[[int], World]:
    return lambda seed: World(replace(_base(seed), navigation_error=NavigationError(**error)))


def _of(strengths: tuple[float, float], scenario: Scenario, r: random.Random) -> Scenario:
    strength = math.exp(r.uniform(*map(math.log, strengths)))
    return replace(scenario, transmitters=tuple(replace(t, strength=strength) for t in scenario.transmitters))


def _any_gps(seed: int) -> World:
    r = random.Random(f"gps {seed}")
    sigma = math.exp(r.uniform(math.log(0.3), math.log(3)))
    return World(_base(seed), AnyPoseError(seed, sigma, r.gauss(0, 5)))


def _any_mount(seed: int) -> World:
    r = random.Random(f"mount {seed}")
    attitude = round(r.gauss(0, 2), 1), round(r.gauss(0, 2), 1), round(r.gauss(0, 6), 1)
    return World(_base(seed, mount=MountOptions(attitude=attitude)))


def _any_moment(seed: int) -> World:
    r = random.Random(f"moment {seed}")
    gains = round(r.uniform(0.7, 1), 2), round(r.uniform(0.7, 1), 2), round(r.uniform(0.7, 1), 2)
    options = replace(_options("pulsed"), gains=gains)
    return World(_of((0.3, 3.0), _base(seed, "pulsed", options=options), r))


def _options(model: str) -> Any:
    return RECEIVERS[model].Options(noise_na_m=0.65)


def _any_display(seed: int) -> World:
    return World(_of((0.5, 2.0), _other(seed, "other_display"), random.Random(f"display {seed}")))


def _any_noise(seed: int) -> World:
    return World(_of((0.5, 2.0), _other(seed, "other_noise"), random.Random(f"noise {seed}")))


def _other(seed: int, model: str) -> Scenario:
    base = _base(seed, "pulsed")
    return replace(base, receiver=replace(base.receiver, model=model, options=_options(model)))


def _empty(seed: int) -> World:
    """Nobody sends within 2 km, and the drone is loud: all readings are noise and ghost signals."""
    base = _other(seed, "other_noise")
    options = replace(_options("pulsed"), noise_na_m=math.exp(random.Random(f"empty {seed}").uniform(1, 5)))
    far = replace(base.transmitters[0], ned=(2000.0, 0.0, 0.0))
    ghosts = Fault("impulses", round(math.exp(random.Random(f"ghosts {seed}").uniform(-4, 0)), 3))
    scenario = replace(base, transmitters=(far,), receiver=replace(base.receiver, options=options), faults=(ghosts,))
    return World(scenario, area_m=20.0)


def _anything(seed: int) -> World:
    r = random.Random(f"anything {seed}")
    world, sigma = _any_moment(seed), math.exp(r.uniform(math.log(0.3), math.log(2)))
    kinds = [Fault("delay_s", r.uniform(0.2, 1.5)), Fault("drop", 0.2), Fault("reorder", 0.2), Fault("jitter_s", 0.5)]
    mount = MountOptions(attitude=(0.0, 0.0, round(r.gauss(0, 6), 1)))
    receiver = replace(world.scenario.receiver, mount=mount)
    scenario = replace(world.scenario, faults=(r.choice(kinds),), receiver=receiver)
    return World(scenario, AnyPoseError(seed, sigma, r.gauss(0, 5)))


WORLDS: Final[dict[str, Callable[[int], World]]] = {
    "clean": lambda seed: World(_base(seed)),
    "walk_1m": _navigation(walk_sigma_m=1.0, walk_tau_s=600.0),
    "walk_2m": _navigation(walk_sigma_m=2.0, walk_tau_s=600.0),
    "offset_3m": _navigation(bias_ned=(3.0, 0.0, 0.0)),
    "mount_10": lambda seed: World(_base(seed, mount=MountOptions(attitude=(0.0, 0.0, 10.0)))),
    "compass_10": _navigation(heading_deg=10.0),
    "rssi": lambda seed: World(_base(seed, "rssi")),
    "any_gps": _any_gps,
    "any_mount": _any_mount,
    "any_moment": _any_moment,
    "any_display": _any_display,
    "any_noise": _any_noise,
    "anything": _anything,
    "empty": _empty,
}


def fly(name: str, seed: int, strategy: str = "estimate") -> Flown:
    """One search with a stepped clock, as a campaign flies it."""
    world, clock = WORLDS[name](seed), StepClock()
    scenario = world.scenario
    if world.error is not None:
        scenario = replace(scenario, navigation_error=NavigationError())
    area = -world.area_m, -world.area_m, world.area_m, world.area_m
    plan = SearchPlan(STRATEGIES[strategy], limit_s=_LIMIT_S, area=area)
    loop = ClosedLoop(scenario, plan, start=clock.now(), stream_hz=10.0)
    (drone,) = loop.drones
    emulated: Any = drone.emulated.world
    if world.error is not None:
        emulated._truth._error = world.error
    run(loop.tasks, clock, until=_LIMIT_S + 120.0, stopped=lambda: drone.decided)
    mission, error, relative = drone.mission, drone.error(), drone.relative_error(clock.now())
    if mission is None or mission.ended is None:
        return Flown(seed, "no end")
    outcome = in_words(mission.ended).partition(":")[0]
    found = mission.found
    if found is None or error is None or relative is None:
        return Flown(seed, outcome, mission.progress.searched_s)
    return Flown(
        seed,
        outcome,
        mission.progress.searched_s,
        error,
        sigma_of(mission.reports.accuracy.on_earth(found)),
        relative,
        sigma_of(mission.reports.accuracy.relative(found)),
        found.turned_deg,
    )


def line(name: str, every: Sequence[Flown]) -> str:
    """The statistics of a world."""
    found = [one for one in every if one.outcome == FOUND]
    rest = Counter(one.outcome for one in every if one.outcome != FOUND)
    ended = "".join(f", {count} {kind}" for kind, count in rest.items())
    if not found:
        return f"{name}: none of {len(every)} found{ended}"
    earth = spread([one.error for one in found], [one.sigma for one in found])
    drone = spread([one.relative for one in found], [one.relative_sigma for one in found])
    near = np.mean([one.relative < _NEAR_M for one in found])
    far = sum(one.error > _FALSE_M for one in found)
    time_s = np.median([one.time_s for one in found])
    return (
        f"{name}: {len(found)} of {len(every)} found in {time_s:.0f} s{ended}; on Earth "
        f"{earth}, {far} beyond {_FALSE_M:g} m; from the drone {drone}, {near:.0%} within {_NEAR_M:g} m"
    )


def spread(errors: Sequence[float], sigmas: Sequence[float | None]) -> str:
    """The errors beside their uncertainty; an unknown one is infinite."""
    of = np.array([math.inf if sigma is None else sigma for sigma in sigmas])
    inside = " ".join(f"{np.mean(np.array(errors) <= n * of):.1%}" for n in (1, 2, 3))
    return f"{np.median(errors):.3f} (worst {max(errors):.3f}) ± {np.median(of):.3f} m, inside {inside}"


def main() -> None:
    made = parser(
        __doc__,
        runs=(12, "searches in each world"),
        first=(1, "seed of the first"),
        jobs=(2, "at a time"),
        strategy=("estimate", "of the search"),
        verbose=(False, "print every run"),
    )
    made.add_argument("worlds", nargs="*", default=list(WORLDS))
    options = made.parse_args()
    with ProcessPoolExecutor(options.jobs) as workers:
        seeds = range(options.first, options.first + options.runs)
        every = {name: [workers.submit(fly, name, seed, options.strategy) for seed in seeds] for name in options.worlds}
        for name, futures in every.items():
            flown = [one.result() for one in futures]
            if options.verbose:
                for one in flown:
                    print("  ", *(f"{value:.4f}" if isinstance(value, float) else value for value in one))
            print(line(name, flown), flush=True)
