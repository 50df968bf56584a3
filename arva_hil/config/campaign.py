"""The plan of a campaign as a file has it. Every axis of it is one value or a list of them, and all are crossed."""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any, Final, cast

from arva_hil.config import yaml_tree
from arva_hil.config.axes import MANY, Axis, ByStrategy, Seeds, Strategies, one_or_many, unique
from arva_hil.config.builtin import located
from arva_hil.config.kinds import NOISE_KINDS, SEED, NoiseKind
from arva_hil.config.mapping_keys import read_mapping
from arva_hil.config.marks import Help
from arva_hil.config.mistake import Mistake, Mistakes, below
from arva_hil.config.nested import TableSort, read_by
from arva_hil.config.reading import read
from arva_hil.config.scenario import Scenario, load, parts_of_spec_2
from arva_hil.config.sorts import Number, Numbers, Sort, Spec, list_of, read_list
from arva_hil.config.tables import help_of, right, sort_of, table, validate
from arva_hil.config.text import Named, Text, Word
from arva_hil.config.tree import Problem, ScenarioError, Tree, nearest, tree
from arva_hil.registry import MAVLINK_FORMATS, STRATEGIES

SPEC: Final = 1
MOST_TRIALS: Final = 200_000
_NOT_FLOWN: Final = ("navigation_error", "follows", "vehicles")  # one vehicle, whose errors are `gps_noise_m`
_HEIGHT: Final = Number(0, 1000, above=True, unit="m")
_SPEED: Final = Number(0, 100, above=True, unit="m/s")
_LIMIT: Final = Number(0, 86_400, above=True, unit="s")
_WITHIN: Final = Number(0, 10_000, above=True, unit="m")
_DEPTH: Final = Number(-100, 100, unit="m")


class _Depths(Numbers):
    def read(self, value: Any) -> tuple[Any, ...]:
        low, high = super().read(value)
        if low > high:
            raise Mistake("the smaller one first", f"[{low:g}, {high:g}]")
        return low, high


@table()
class Random:
    """One transmitter, another for each seed: uniform within ±`within_m` north and east of home, uniform in depth
    from `depth_m`[0] to [1], its attitude uniform among all rotations."""

    within_m: Annotated[float, _WITHIN, Help("north and east of home, each way")]
    depth_m: Annotated[tuple[float, float], _Depths(_DEPTH, _DEPTH), Help("from, to")] = (0.0, 2.0)

    def __str__(self) -> str:
        low, high = self.depth_m
        return f"random within {self.within_m:g} m at {low:g} to {high:g} m"


class Scenarios(Sort):
    """Files and random ones, read when the plan's folder is known."""

    one: Final = Text("a scenario file or {random: …}")

    def __str__(self) -> str:
        return list_of(1, MANY, "scenarios")

    @property
    def kind(self) -> str:
        return f"{self.one}, or a list of them"

    def read(self, value: Any) -> Any:
        return value

    def json(self) -> dict[str, Any]:
        box = {
            "type": "object",
            "properties": {
                "within_m": _WITHIN.json() | {"description": help_of(Random, "within_m")},
                "depth_m": sort_of(Random, "depth_m").json() | {"description": help_of(Random, "depth_m")},
            },
            "required": ["within_m"],
            "additionalProperties": False,
        }
        drawn = {"type": "object", "properties": {"random": box}, "required": ["random"], "additionalProperties": False}
        return one_or_many({"anyOf": [{"type": "string"}, drawn]})


_WIND: Final = Axis(Number(0, 100, unit="m/s"), "numbers")
_GPS_NOISE: Final = Axis(Number(0, 1000, unit="m"), "numbers")
_SUCCESS: Final = Number(0, 1000, above=True, unit="m")


@table()
class PlanFile:
    """The keys of a plan."""

    spec: Annotated[int, Spec(SPEC), Help("the version of this file format")] = field(default=1, kw_only=True)
    strategies: Annotated[Any, Strategies(Text("a strategy")), Help("what flies")]
    scenarios: Annotated[Any, Scenarios(), Help("files, relative to this one, and random ones, drawn by the seed")]
    seeds: Annotated[Any, Seeds(SEED, "seeds"), Help("of the noise and of what is drawn")] = range(1, 2)
    noise: Annotated[Any, Axis(Word(NOISE_KINDS)), Help("of the receiver; without it as the scenario has it")] = (None,)
    wind_m_s: Annotated[Any, _WIND, Help("from a direction that the seed draws")] = (0.0,)
    gps_noise_m: Annotated[Any, _GPS_NOISE, Help("sigma on each axis")] = (0.0,)
    take_off_m: Annotated[Any, Axis(_HEIGHT, "numbers"), Help("height of the take-off")] = (3.0,)
    height_m: Annotated[Any, ByStrategy(_HEIGHT), Help("held in the search")] = 3.0
    speed_m_s: Annotated[Any, ByStrategy(_SPEED), Help("of the search")] = 1.0
    limit_s: Annotated[Any, ByStrategy(_LIMIT), Help("of the search, then it lands")] = 900.0
    success_m: Annotated[float, _SUCCESS, Help("how near the place reported has to be")] = 2.0


@dataclass(frozen=True)
class CampaignPlan:
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


def load_plan(path: str | os.PathLike[str]) -> CampaignPlan:
    """The plan in a file. Raises ScenarioError with all mistakes, those in its scenario files too."""
    path = located(path)
    return parse_plan(yaml_tree.read_text(path, "the plan of a campaign"), path)


def parse_plan(text: str, source: str) -> CampaignPlan:
    """The plan in `text`; files that it names are looked for from where `source` is. Raises ScenarioError."""
    reader = _PlanReader(os.path.dirname(source))
    return read(text, source, "a mapping with strategies and scenarios", reader.read, SPEC)


def is_plan(text: str) -> bool:
    """Whether a text looks like a plan and not like a scenario."""
    try:
        root = tree(yaml_tree.Notes("").compose(text, ""))
    except ScenarioError:
        return False
    return isinstance(root, dict) and "transmitters" not in root and bool(root.keys() & {"strategies", "scenarios"})


class _PlanReader:
    """Reads one plan; remembers what is wrong with it and with the scenarios that it names."""

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self._wrong: list[Mistake] = []
        self._problems: list[Problem] = []

    def read(self, tree: Tree) -> CampaignPlan:
        """Raises Mistakes."""
        plan = self._try("", lambda: read_by(partial(validate, PlanFile), tree))
        top: Mapping[str, Any] = tree if isinstance(tree, dict) else {}
        names = self._strategy_names(top)
        scenarios = self._scenarios(top)
        limits: dict[str, Any] = {
            key: self._by_strategy(top, key, names) for key in ("height_m", "speed_m_s", "limit_s")
        }
        axes: dict[str, Any] = {
            key: right(PlanFile, top, key) for key in ("seeds", "noise", "wind_m_s", "gps_noise_m", "take_off_m")
        }
        count = math.prod(len(one) for one in (names, scenarios, *axes.values()) if one)
        if count > MOST_TRIALS:
            self._wrong.append(Mistake(f"at most {MOST_TRIALS}", f"{count} trials"))
        if self._wrong or self._problems:
            raise Mistakes(self._wrong, self._problems)
        return CampaignPlan(names, scenarios, **axes, **limits, success_m=plan.success_m)

    def _try(self, key: str, what: Callable[[], Any]) -> Any:
        try:
            return what()
        except (Mistake, Mistakes) as error:
            self._wrong += below(key, error) if key else error.every if isinstance(error, Mistakes) else [error]

    def _strategy_names(self, top: Mapping[str, Any]) -> tuple[str, ...]:
        if "strategies" not in top:
            return ()
        return self._try("strategies", lambda: Axis(Named(STRATEGIES)).read(top["strategies"])) or ()

    def _by_strategy(self, top: Mapping[str, Any], key: str, names: Sequence[str]) -> dict[str, float]:
        """One number for all, or each strategy's own."""
        usual = right(PlanFile, {}, key)
        number = cast("ByStrategy", sort_of(PlanFile, key)).number
        value = top.get(key, usual)
        if isinstance(value, dict):
            given = self._try(key, lambda: read_mapping(value, dict.fromkeys(names, number), [])) if names else {}
            return {name: (given or {}).get(name, usual) for name in names}
        return dict.fromkeys(names, right(PlanFile, top, key))

    def _scenarios(self, top: Mapping[str, Any]) -> dict[str, Scenario | Random]:
        if "scenarios" not in top:
            return {}
        value = top["scenarios"]
        items = value if isinstance(value, list) else [value]
        named: dict[str, Scenario | Random] = {}

        def one(item: Any) -> str:
            kind = self._scenario(item)
            name = str(kind) if isinstance(kind, Random) else os.path.splitext(os.path.basename(kind.source))[0]
            named.setdefault(name, kind)
            return name

        if isinstance(value, list):
            sort = Axis(Text(""), "scenarios")
            self._try("scenarios", lambda: unique(items, read_list(sort, items, one)))
        else:
            self._try("scenarios", lambda: one(value))
        return named

    def _scenario(self, item: Any) -> Scenario | Random:
        """A file or a random one; a file's own mistakes become the plan's. Raises Mistake or Mistakes."""
        if isinstance(item, dict):
            random: Random = read_mapping(item, {"random": TableSort(Random)}, ["random"])["random"]
            return random
        name = Scenarios.one.read(item)
        path = os.path.join(self._folder, name)
        if not os.path.isfile(path):
            folder = os.path.dirname(path) or "."
            names = os.listdir(folder) if os.path.isdir(folder) else []
            files = [file for file in names if file.endswith((".yaml", ".yml"))]
            close = nearest(os.path.basename(path), files)
            hint = close and os.path.join(os.path.dirname(name), close)
            raise Mistake(str(Scenarios.one), f"no file {path}", hint)
        try:
            scenario = load(path)
        except ScenarioError as error:
            self._problems += error.problems
            return Scenario((), source=path)
        unserved = [part for part, there in parts_of_spec_2(scenario).items() if there and part in _NOT_FLOWN]
        if scenario.output_format in MAVLINK_FORMATS:
            unserved.append(f"format {scenario.output_format}")
        if unserved:
            raise Mistake("a scenario that a campaign flies", f"{path} with {', '.join(unserved)}")
        return scenario
