"""The plan of a campaign: read from YAML, and written out as trials.

Every axis of it (scenarios, seeds, noise, wind …) is one value or a list of them, and all are crossed. What is drawn,
the place of a random transmitter and the wind's direction, is drawn by the seed alone: strategies meet the same.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
import math
import os
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import yaml

from arva_hil._yaml import Range, Reader, ScenarioError, nearest, read_text
from arva_hil.campaign.trial import Trial
from arva_hil.model import rotation
from arva_hil.scenario import NOISE_KINDS, SEED, NoiseKind, Scenario, Transmitter, load, to_dict

SPEC: Final = 1
FORMAT: Final = 1  # of the results: another one makes every key another
MOST_TRIALS: Final = 200_000

_KEYS: Final = (
    "spec strategies scenarios seeds noise wind_m_s gps_noise_m take_off_m height_m speed_m_s limit_s success_m"
)
_A_SCENARIO: Final = "a scenario file or {random: …}"
_MANY: Final = range(1, 100_001)
_SEEDS: Final = Range(1, 100_000, "a list of seeds, or how many,")
_WITHIN_M: Final = Range(0, 10_000, above=True)
_DEPTH_M: Final = Range(-100, 100)
_WIND_M_S: Final = Range(0, 100)
_GPS_NOISE_M: Final = Range(0, 1000)
_HEIGHT_M: Final = Range(0, 1000, above=True)
_SPEED_M_S: Final = Range(0, 100, above=True)
_LIMIT_S: Final = Range(0, 86_400, above=True)
_SUCCESS_M: Final = Range(0, 1000, above=True)

_USUAL: Final = Trial("", Scenario(()))

_T = TypeVar("_T")


@dataclass(frozen=True)
class Random:
    """One transmitter, another for each seed: uniform within ±`within_m` north and east of home, uniform in depth
    from `depth_m`[0] to [1], its attitude uniform among all rotations."""

    within_m: float
    depth_m: tuple[float, float] = (0.0, 2.0)

    def __str__(self) -> str:
        low, high = self.depth_m
        return f"random within {self.within_m:g} m at {low:g} to {high:g} m"

    def draw(self, seed: int) -> Scenario:
        """To the millimetre and 0.001°, so that it is the same whatever a machine's last digit of a sine."""
        r = random.Random(f"transmitter {seed}")
        north, east = (round((2 * r.random() - 1) * self.within_m, 3) for _ in "ne")
        low, high = self.depth_m
        down = round(low + (high - low) * r.random(), 3)
        return Scenario((Transmitter(1, (north, east, down), attitude=_any_attitude(r)),), source=str(self))


@dataclass(frozen=True)
class Plan:
    """What a campaign tries: all of it crossed. `noise` None is the scenario's own; heights, speeds and limits are
    by strategy; `success_m`: how near the place reported has to be to the transmitter."""

    strategies: tuple[str, ...]
    scenarios: Mapping[str, Scenario | Random]  # by name
    seeds: Sequence[int]
    noise: tuple[NoiseKind | None, ...]
    wind_m_s: tuple[float, ...]
    gps_noise_m: tuple[float, ...]
    take_off_m: tuple[float, ...]
    height_m: Mapping[str, float]
    speed_m_s: Mapping[str, float]
    limit_s: Mapping[str, float]
    success_m: float


@dataclass(frozen=True, slots=True)
class Planned:
    """A trial and what the plan calls it. `key` tells it from every other trial, by content."""

    key: str
    trial: Trial
    scenario: str
    wind_m_s: float


def read(path: str | os.PathLike[str], strategies: Sequence[str]) -> Plan:
    """The plan in a file. Raises ScenarioError with all mistakes, those in its scenario files too."""
    return parse(read_text(path, "the plan of a campaign"), os.fspath(path), strategies)


def parse(text: str, source: str, strategies: Sequence[str]) -> Plan:
    """The plan in `text`; files that it names are looked for from where `source` is. Raises ScenarioError."""
    r = Reader(text, source, "a mapping with strategies and scenarios")
    f = r.mapping(r.root, _KEYS, need=["strategies", "scenarios"])
    r.spec(f.get("spec"), SPEC)
    chosen = _axis(r, f.get("strategies"), (), lambda node: r.word(node, "", strategies))
    plan = Plan(
        chosen,
        _scenarios(r, f.get("scenarios")),
        _seeds(r, f.get("seeds")),
        _axis(r, f.get("noise"), (None,), lambda node: r.word(node, "off", NOISE_KINDS)),
        _numbers(r, f.get("wind_m_s"), 0.0, _WIND_M_S),
        _numbers(r, f.get("gps_noise_m"), _USUAL.gps_noise_m, _GPS_NOISE_M),
        _numbers(r, f.get("take_off_m"), _USUAL.take_off_m, _HEIGHT_M),
        _by_strategy(r, f.get("height_m"), _USUAL.height_m, _HEIGHT_M, chosen),
        _by_strategy(r, f.get("speed_m_s"), _USUAL.speed_m_s, _SPEED_M_S, chosen),
        _by_strategy(r, f.get("limit_s"), _USUAL.limit_s, _LIMIT_S, chosen),
        r.number(f.get("success_m"), 2.0, _SUCCESS_M),
    )
    if (count := size(plan)) > MOST_TRIALS:
        r.wrong(r.root, f"{count} trials", f"at most {MOST_TRIALS}")
    r.finish()
    return plan


def size(plan: Plan) -> int:
    """How many trials there are."""
    return math.prod(map(len, _axes(plan))) * len(plan.strategies)


def trials(plan: Plan) -> Iterator[Planned]:
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


def _axes(plan: Plan) -> tuple[Sequence[Any], ...]:
    named = list(plan.scenarios.items())
    return plan.seeds, named, plan.noise, plan.wind_m_s, plan.gps_noise_m, plan.take_off_m


def _scenario(kind: Scenario | Random, seed: int, noise: NoiseKind | None) -> Scenario:
    base = kind.draw(seed) if isinstance(kind, Random) else kind
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


def _axis(
    r: Reader, node: yaml.Node | None, default: tuple[_T, ...], one: Callable[[yaml.Node], _T], what: str = "values"
) -> tuple[_T, ...]:
    """The values of an axis, each given once: a list, or a single one."""
    if node is None:
        return default
    nodes = r.items(node, _MANY, what) if isinstance(node, yaml.SequenceNode) else [node]
    mistakes = len(r.problems)
    first: dict[_T, yaml.Node] = {}
    for item in nodes:
        value = one(item)
        if value in first and mistakes == len(r.problems):
            r.wrong(item, f"{value} again (first on line {first[value].start_mark.line + 1})", "each once")
        first.setdefault(value, item)
    return tuple(first)


def _numbers(r: Reader, node: yaml.Node | None, default: float, valid: Range) -> tuple[float, ...]:
    return _axis(r, node, (default,), lambda item: r.number(item, default, valid), "numbers")


def _seeds(r: Reader, node: yaml.Node | None) -> Sequence[int]:
    """A list of them, or how many there are from 1 on."""
    if isinstance(node, yaml.SequenceNode):
        return _axis(r, node, (), lambda item: r.integer(item, 1, SEED), "seeds")
    return range(1, r.integer(node, 1, _SEEDS) + 1)


def _by_strategy(
    r: Reader, node: yaml.Node | None, default: float, valid: Range, strategies: Sequence[str]
) -> dict[str, float]:
    """One number for all, or a mapping from strategies to their own."""
    if isinstance(node, yaml.MappingNode):
        f = r.mapping(node, " ".join(strategies))
        return {name: r.number(f.get(name), default, valid) for name in strategies}
    return dict.fromkeys(strategies, r.number(node, default, valid))


def _scenarios(r: Reader, node: yaml.Node | None) -> dict[str, Scenario | Random]:
    named: dict[str, Scenario | Random] = {}

    def one(item: yaml.Node) -> str:
        kind = _random(r, item) if isinstance(item, yaml.MappingNode) else _file(r, item)
        name = str(kind) if isinstance(kind, Random) else os.path.splitext(os.path.basename(kind.source))[0]
        named.setdefault(name, kind)
        return name

    _axis(r, node, (), one, "scenarios")
    return named


def _random(r: Reader, node: yaml.Node) -> Random:
    f = r.mapping(r.mapping(node, "random", need=["random"]).get("random"), "within_m depth_m", need=["within_m"])
    low, high = Random.depth_m
    items = r.items(f.get("depth_m"), range(2, 3), "numbers")
    if len(items) == 2:
        low, high = (r.number(item, 0.0, _DEPTH_M) for item in items)
        if low > high:
            r.wrong(f["depth_m"], f"[{low:g}, {high:g}]", "the smaller one first")
    return Random(r.number(f.get("within_m"), 1.0, _WITHIN_M), (low, high))


def _file(r: Reader, node: yaml.Node) -> Scenario:
    """A scenario; its own mistakes become the plan's."""
    name = r.text(node, _A_SCENARIO)
    path = os.path.join(os.path.dirname(r.source), name)
    if name and not os.path.isfile(path):
        folder = os.path.dirname(path) or "."
        names = os.listdir(folder) if os.path.isdir(folder) else []
        close = nearest(os.path.basename(path), [file for file in names if file.endswith((".yaml", ".yml"))])
        hint = close and os.path.join(os.path.dirname(name), close)
        r.wrong(node, f"no file {path}", _A_SCENARIO, hint)
    elif name:
        try:
            return load(path)
        except ScenarioError as error:
            r.problems.extend(error.problems)
    return Scenario((), source=path)
