"""Expands the plan of a campaign into trials.

The place of a random transmitter and the direction of the wind depend only on the seed: all strategies get the same.
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
from arva_hil.config import KeyingOptions, NoiseKind, ReceiverOptions, Scenario, Transmitter, to_dict
from arva_hil.config.campaign import CampaignPlan, Random
from arva_hil.model.field import rotation

FORMAT: Final = 1  # of the results; a new one changes every key


@dataclass(frozen=True, slots=True)
class Planned:
    """A trial and its names in the plan. `key`: a digest of its content, different for each trial."""

    key: str
    trial: Trial
    scenario: str
    wind_m_s: float


def size(plan: CampaignPlan) -> int:
    """Return the number of trials."""
    return math.prod(map(len, _axes(plan))) * len(plan.strategies)


def trials(plan: CampaignPlan) -> Iterator[Planned]:
    """Yield all trials, by seed first and strategy last, so that a stopped campaign has flown all equally."""
    before: tuple[Any, ...] = ()
    for seed, (name, kind), noise, wind_m_s, gps_noise_m, take_off_m, drones in itertools.product(*_axes(plan)):
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
                victims=plan.victims,
                area=plan.area_m,
                strip_width_m=plan.strip_width_m,
                drones=drones,
            )
            rest = {f.name: getattr(trial, f.name) for f in dataclasses.fields(trial) if f.name != "scenario"}
            yield Planned(_digest([FORMAT, name, content, rest]), trial, name, wind_m_s)


def wind(speed_m_s: float, seed: int) -> tuple[float, float, float]:
    """Return the wind [m/s, NED], from a random direction that depends on the seed."""
    angle = random.Random(f"wind {seed}").random() * math.tau
    return round(speed_m_s * math.cos(angle), 6) + 0.0, round(speed_m_s * math.sin(angle), 6) + 0.0, 0.0


def draw(kind: Random, seed: int) -> Scenario:
    """Return the random scenario of a seed, with `count` transmitters.

    Places are rounded to 1 mm and angles to 0.001°, so that all machines give the same scenario.
    """
    r = random.Random(f"transmitter {seed}")
    within_m = kind.within_m or 0.0
    south, west, north, east = kind.area_m or (-within_m, -within_m, within_m, within_m)
    sides = (south, north), (west, east)
    keying = KeyingOptions(kind.keying) if kind.keying else None
    buried = []
    for id_ in range(1, kind.count + 1):
        n, e = ((low + high) / 2 + (2 * r.random() - 1) * (high - low) / 2 for low, high in sides)
        low, high = kind.depth_m
        place = round(n, 3), round(e, 3), round(low + (high - low) * r.random(), 3)
        buried.append(Transmitter(id_, place, attitude=_any_attitude(r), keying=keying))
    return Scenario(tuple(buried), receiver=ReceiverOptions(model=kind.model), source=str(kind))


def _axes(plan: CampaignPlan) -> tuple[Sequence[Any], ...]:
    return (
        plan.seeds,
        list(plan.scenarios.items()),
        plan.noise,
        plan.wind_m_s,
        plan.gps_noise_m,
        plan.take_off_m,
        plan.drones,
    )


def _scenario(kind: Scenario | Random, seed: int, noise: NoiseKind | None) -> Scenario:
    base = draw(kind, seed) if isinstance(kind, Random) else kind
    receiver = base.receiver
    if noise is not None:
        receiver = dataclasses.replace(receiver, noise=dataclasses.replace(receiver.noise, kind=noise))
    return dataclasses.replace(base, receiver=receiver, seed=seed)


def _digest(content: object) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def _any_attitude(r: random.Random) -> tuple[float, float, float]:
    """Return roll, pitch and yaw [°] of a rotation drawn uniformly (K. Shoemake, Uniform random rotations, 1992)."""
    u, a, b = r.random(), r.random() * math.tau, r.random() * math.tau
    s, t = math.sqrt(1 - u), math.sqrt(u)
    angles = rotation.to_euler([t * math.cos(b), s * math.sin(a), s * math.cos(a), t * math.sin(b)])
    roll, pitch, yaw = (round(math.degrees(angle), 3) + 0.0 for angle in angles)
    return roll, pitch, yaw
