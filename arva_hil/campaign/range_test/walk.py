"""One walk of a range test: a receiver that is carried straight towards a transmitter; and widths of strips.

The transmitter lies at the origin; the receiver comes from the north, at one height. Places NED, metres.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from arva_hil.config import KeyingOptions, Scenario, Transmitter
from arva_hil.emulator.build import receiver, transmitters, vehicle_noise
from arva_hil.model.field import LocalFrame, rotation
from arva_hil.model.field.arrays import Array
from arva_hil.model.receiver import Impairment, Look, Pose

HOVER_LOAD: Final = 0.5  # of the motors, 0…1
_HERE: Final = LocalFrame(0.0, 0.0, 0.0)
_START: Final = math.nextafter(0.0, -1.0)  # no sample is earlier


class Coupling(NamedTuple):
    """The attitude of transmitter and receiver to each other; degrees."""

    name: str
    transmitter: tuple[float, float, float]  # roll, pitch, yaw; the dipole is its x axis
    receiver_yaw: float


COUPLINGS: Final = (
    Coupling("coaxial", (0.0, 0.0, 0.0), 180.0),  # dipole and receiver's x axis along the path
    Coupling("90°", (0.0, 0.0, 0.0), 90.0),  # the same, receiver turned by 90°
    Coupling("vertical", (0.0, 90.0, 0.0), 180.0),  # dipole upright
)


@dataclass(frozen=True)
class RangePlan:
    """The plan of a walk. `stable_s`: a signal without a gap for this time is stable."""

    height_m: float = 3.0  # of the receiver above the transmitter
    speed_m_s: float = 1.0
    stable_s: float = 10.0
    walks: int = 10  # in each coupling
    start_m: float = 120.0  # doubled if the signal is stable from the start
    farthest_m: float = 2000.0
    passes: int = 0  # simulated flights along search strips of each width


class Walk(NamedTuple):
    """The result of one walk, frame by frame (N,). `first_m`, `stable_m`: see `signals`."""

    range_m: Array  # true distance between transmitter and receiver
    d_m: Array  # of the nearest channel with a signal; NaN without any
    first_m: float | None
    stable_m: float | None


def walked(scenario: Scenario, coupling: Coupling, plan: RangePlan, number: int, *, motors: bool) -> Walk:
    """Do walk `number`, with a seed of its own, by the scenario's receiver and its first transmitter.

    `motors`: with the noise of the scenario's vehicle, hovering.
    """
    start_m = plan.start_m
    while True:
        range_m, d_m = _walk(scenario, coupling, plan, number, start_m, motors)
        first_m, stable_m = signals(range_m, d_m, plan.stable_s * scenario.receiver.rate_hz)
        if stable_m is None or stable_m < 0.9 * start_m or start_m >= plan.farthest_m:
            return Walk(range_m, d_m, first_m, stable_m)
        start_m = min(2 * start_m, plan.farthest_m)


def signals(range_m: Array, d_m: Array, stable_frames: float) -> tuple[float | None, float | None]:
    """Return the distances of the first signal and of the first stable signal, metres; None: there was none.

    A stable one is the first frame with a signal after which every frame has one, for `stable_frames` frames. Single
    signals from farther away do not count, as for testers.
    """
    heard = np.isfinite(d_m)
    if not heard.any():
        return None, None
    count = math.floor(stable_frames) + 1
    sums = np.cumsum(np.concatenate([[0], heard]))
    whole = np.flatnonzero(sums[count:] - sums[:-count] == count) if len(heard) >= count else np.zeros(0, int)
    return float(range_m[heard.argmax()]), float(range_m[whole[0]]) if len(whole) else None


def _walk(
    scenario: Scenario, coupling: Coupling, plan: RangePlan, number: int, start_m: float, motors: bool
) -> tuple[Array, Array]:
    """Return true range and d of each frame."""

    def place(time_s: float) -> tuple[float, float, float]:
        return max(start_m - plan.speed_m_s * time_s, 0.0), 0.0, -plan.height_m

    one, heading = alone(scenario, coupling.transmitter, number), math.radians(coupling.receiver_yaw)
    rows = list(frames(one, place, heading, start_m / plan.speed_m_s, motors=motors))
    return np.array([range_m for range_m, _ in rows]), np.array([d_m for _, d_m in rows])


def frames(
    one: Scenario, place: Callable[[float], tuple[float, float, float]], heading: float, span_s: float, *, motors: bool
) -> Iterator[tuple[float, float]]:
    """Yield true range and d of each frame of a receiver that is carried past its transmitter at the origin.

    `place`: NED, metres, by the time; `heading`: radians.
    """
    model, there, noise = receiver(one), transmitters(one, _HERE), vehicle_noise(one)
    impairment = None
    if motors and noise is not None:
        impairment = Impairment(noise_na_m=noise.sigma_na_m(one.receiver.mount.position, HOVER_LOAD))
    turned = rotation.to_matrix(rotation.from_euler(0.0, 0.0, heading))
    period_s, before_s = 1 / one.receiver.rate_hz, _START
    for frame in range(math.floor(span_s / period_s) + 1):
        frame_s = frame * period_s
        while before_s < frame_s and (look_s := model.next_look(before_s, frame_s)) <= frame_s:
            if not look_s > before_s:
                raise ValueError(f"the receiver's model takes a sample at {look_s:g} s, not later than {before_s:g} s")
            model.look(Look(look_s, Pose(np.array(place(look_s)), turned), there, impairment=impairment))
            before_s = look_s
        heard = [channel.d_cm for channel in model.show(frame_s).channels if channel.zone]
        yield float(np.linalg.norm(place(frame_s))), min(heard) / 100 if heard else math.nan


def alone(scenario: Scenario, attitude: tuple[float, float, float], number: int) -> Scenario:
    """Return the scenario with its first transmitter alone, at the origin, and the seed of a walk.

    `attitude`: degrees.
    """
    first: Transmitter = replace(
        scenario.transmitters[0],
        ned=(0.0, 0.0, 0.0),
        lla=None,
        path=None,
        follows=None,
        depth_m=None,
        attitude=attitude,
    )
    return replace(scenario, transmitters=(first,), faults=(), terrain=None, seed=(scenario.seed + number) % 2**32)


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
