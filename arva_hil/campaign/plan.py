"""The plan of a campaign written out as trials.

What is drawn, the place of a random transmitter and the wind's direction, is drawn by the seed alone: strategies meet
the same.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from arva_hil.campaign.trial import Trial
from arva_hil.config import NoiseKind, Scenario, Transmitter, to_dict
from arva_hil.config.campaign import CampaignPlan, Random
from arva_hil.field import rotation

FORMAT: Final = 1  # of the results: another one makes every key another


@dataclass(frozen=True, slots=True)
class Planned:
    """A trial and what the plan calls it. `key` tells it from every other trial, by content."""

    key: str
    trial: Trial
    scenario: str
    wind_m_s: float


def size(plan: CampaignPlan) -> int:
    """How many trials there are."""
    return math.prod(map(len, _axes(plan))) * len(plan.strategies)


def trials(plan: CampaignPlan) -> Iterator[Planned]:
    """Every trial, seed by seed and the strategies side by side: what is stopped half-way has tried all alike."""
    before: tuple[Any, ...] = ()
    for seed, (name, kind), noise, wind_m_s, gps_noise_m, take_off_m in itertools.product(*_axes(plan)):
        if before != (seed, name, noise):
            before = seed, name, noise
            scenario = _scenario(kind, seed, noise)
            content = _digest(to_dict(scenario))
        for strategy in plan.strategies:
            trial = Trial(
                strategy,
                scenario,
                take_off_m=take_off_m,
                height_m=plan.height_m[strategy],
                speed_m_s=plan.speed_m_s[strategy],
                wind=wind(wind_m_s, seed),
                gps_noise_m=gps_noise_m,
                limit_s=plan.limit_s[strategy],
            )
            rest = {f.name: getattr(trial, f.name) for f in dataclasses.fields(trial) if f.name != "scenario"}
            yield Planned(_digest([FORMAT, name, content, rest]), trial, name, wind_m_s)


def wind(speed_m_s: float, seed: int) -> tuple[float, float, float]:
    """NED, m/s: from a direction that the seed draws."""
    angle = random.Random(f"wind {seed}").random() * math.tau
    return round(speed_m_s * math.cos(angle), 6) + 0.0, round(speed_m_s * math.sin(angle), 6) + 0.0, 0.0


def draw(kind: Random, seed: int) -> Scenario:
    """The scenario of a seed, to the millimetre and 0.001°, so that it is the same whatever a machine's last digit of
    a sine."""
    r = random.Random(f"transmitter {seed}")
    north, east = (round((2 * r.random() - 1) * kind.within_m, 3) for _ in "ne")
    low, high = kind.depth_m
    down = round(low + (high - low) * r.random(), 3)
    return Scenario((Transmitter(1, (north, east, down), attitude=_any_attitude(r)),), source=str(kind))


def _axes(plan: CampaignPlan) -> tuple[Sequence[Any], ...]:
    named = list(plan.scenarios.items())
    return plan.seeds, named, plan.noise, plan.wind_m_s, plan.gps_noise_m, plan.take_off_m


def _scenario(kind: Scenario | Random, seed: int, noise: NoiseKind | None) -> Scenario:
    base = draw(kind, seed) if isinstance(kind, Random) else kind
    receiver = base.receiver
    if noise is not None:
        receiver = dataclasses.replace(receiver, noise=dataclasses.replace(receiver.noise, kind=noise))
    return dataclasses.replace(base, receiver=receiver, seed=seed)


def _digest(content: object) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def _any_attitude(r: random.Random) -> tuple[float, float, float]:
    """Roll, pitch and yaw in degrees of a rotation drawn uniformly (K. Shoemake, Uniform random rotations, 1992)."""
    u, a, b = r.random(), r.random() * math.tau, r.random() * math.tau
    s, t = math.sqrt(1 - u), math.sqrt(u)
    angles = rotation.to_euler([t * math.cos(b), s * math.sin(a), s * math.cos(a), t * math.sin(b)])
    roll, pitch, yaw = (round(math.degrees(angle), 3) + 0.0 for angle in angles)
    return roll, pitch, yaw
