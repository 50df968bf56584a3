"""The plan of a campaign as a file has it. Every axis of it is one value or a list of them, and all are crossed."""

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Final

from arva_hil.config.common import NOISE_KINDS, SEED, NoiseKind
from arva_hil.config.constraints import Constraint, ListOf, Named, Number, Spec, Text, Whole, Word
from arva_hil.config.drawn import Area, AreaM, HowMany, Random
from arva_hil.config.errors import ConstraintError, Problem, ScenarioError, Violation, nearest, wrong
from arva_hil.config.nodes import Value, first_line
from arva_hil.config.profiles import located
from arva_hil.config.reading import keys_in, read, read_text
from arva_hil.config.scenario import Scenario, load, parts_of_spec_2
from arva_hil.config.tables import Help, TableOf, keys, read_keys, table
from arva_hil.registry import MAVLINK_FORMATS, STRATEGIES

SPEC: Final = 1
MOST_TRIALS: Final = 100_000_000
_MOST_VALUES: Final = 100_000  # of one axis
_NOT_FLOWN: Final = ("navigation_error", "follows", "vehicles", "terrain")  # one vehicle, above flat ground


class _Axis(Constraint):
    """One value or a list of them, each once; a tuple in Python."""

    def __init__(self, item: Constraint, what: str = "values") -> None:
        self.item, self.unit = item, item.unit
        self._list = ListOf(item, 1, _MOST_VALUES, what)

    def __str__(self) -> str:
        return str(self._list)

    @property
    def kind(self) -> str:
        return f"{self.item.kind}, or a list of them"

    @property
    def range(self) -> str:
        return self.item.range

    def read(self, value: Any) -> Any:
        if not isinstance(value, list | tuple):
            return (self.item.read(value),)
        return _each_once(value, self._list.read(value))

    def json(self) -> dict[str, Any]:
        return {"anyOf": [self.item.json(), self._list.json()]}


def _each_once(items: Iterable[Any], values: Sequence[Any]) -> Sequence[Any]:
    """The values of some items. Raises ConstraintError for those that are there again."""
    seen: dict[Any, Any] = {}
    again = []
    for at, (item, value) in enumerate(zip(items, values, strict=True)):
        if value in seen:
            again.append(Violation("each once", f"{value} again{first_line(seen[value])}", path=(at,)))
        seen.setdefault(value, item)
    if again:
        raise ConstraintError(*again)
    return values


class _Seeds(_Axis):
    """A list of seeds, or how many there are from 1 on."""

    count: Final = Whole(1, 10_000_000, "a list of seeds, or how many,")
    kind = "a list of seeds, or how many"

    def read(self, value: Any) -> Any:
        return super().read(value) if isinstance(value, list) else range(1, self.count.read(value) + 1)

    def json(self) -> dict[str, Any]:
        return {"anyOf": [self.count.json(), self._list.json()]}


class _ByStrategy(Constraint):
    """One number for all strategies, or a mapping from their names, which is read when they are known."""

    kind = "a number, or one by strategy"

    def __init__(self, number: Number) -> None:
        self.number, self.unit = number, number.unit

    @property
    def range(self) -> str:
        return self.number.range

    def read(self, value: Any) -> Any:
        return value if isinstance(value, dict) else self.number.read(value)

    def json(self) -> dict[str, Any]:
        one = self.number.json()
        return {"anyOf": [one, {"type": "object", "additionalProperties": one}]}


class _File(Constraint):
    """A scenario file, relative to a folder, or a random one; a file's own mistakes are collected in `problems`."""

    def __init__(self, folder: str = "") -> None:
        self._folder = folder
        self.problems: list[Problem] = []

    def __str__(self) -> str:
        return "a scenario file or {random: …}"

    def read(self, value: Any) -> Scenario | Random:
        if isinstance(value, dict):
            values, violations = read_keys(value, {"random": TableOf(Random)}, ["random"])
            if violations:
                raise ConstraintError(*violations)
            random: Random = values["random"]
            return random
        name = Text(str(self)).read(value)
        path = os.path.join(self._folder, name)
        if not os.path.isfile(path):
            folder = os.path.dirname(path) or "."
            names = os.listdir(folder) if os.path.isdir(folder) else []
            close = nearest(os.path.basename(path), [file for file in names if file.endswith((".yaml", ".yml"))])
            raise wrong(str(self), f"no file {path}", close and os.path.join(os.path.dirname(name), close))
        try:
            scenario = load(path)
        except ScenarioError as error:
            self.problems += error.problems
            return Scenario((), source=path)
        unserved = [part for part, there in parts_of_spec_2(scenario).items() if there and part in _NOT_FLOWN]
        if scenario.output_format in MAVLINK_FORMATS:
            unserved.append(f"format {scenario.output_format}")
        if unserved:
            raise wrong("a scenario that a campaign flies", f"{path} with {', '.join(unserved)}")
        return scenario

    def json(self) -> dict[str, Any]:
        random = {"random": TableOf(Random).json()}
        drawn = {"type": "object", "properties": random, "required": ["random"], "additionalProperties": False}
        return {"anyOf": [{"type": "string"}, drawn]}


class _Scenarios(_Axis):
    def __init__(self, file: _File | None = None) -> None:
        super().__init__(file or _File(), "scenarios")

    def read(self, value: Any) -> dict[str, Scenario | Random]:
        every = self._list.read(value) if isinstance(value, list) else (self.item.read(value),)
        names = [str(one) if isinstance(one, Random) else _stem(one.source) for one in every]
        _each_once(value if isinstance(value, list) else [value], names)
        return dict(zip(names, every, strict=True))


def _stem(path: str) -> str:
    return os.path.splitext(os.path.basename(path))[0]


_HEIGHT: Final = Number(0, 1000, above=True, unit="m")
_SPEED: Final = Number(0, 100, above=True, unit="m/s")
_WIDTH: Final = Number(1, 1000, unit="m")
_LIMIT: Final = Number(0, 86_400, above=True, unit="s")
_WIND: Final = _Axis(Number(0, 100, unit="m/s"), "numbers")
_GPS_NOISE: Final = _Axis(Number(0, 1000, unit="m"), "numbers")


@table()
class PlanFile:
    """The keys of a plan."""

    spec: Annotated[int, Spec(SPEC), Help("the version of this file format")] = field(default=1, kw_only=True)
    strategies: Annotated[Any, _Axis(Named(STRATEGIES, "a strategy")), Help("what flies")]
    scenarios: Annotated[Any, _Scenarios(), Help("files, relative to this one, and random ones, drawn by the seed")]
    seeds: Annotated[Any, _Seeds(SEED, "seeds"), Help("of the noise and of what is drawn")] = range(1, 2)
    noise: Annotated[Any, _Axis(Word(NOISE_KINDS)), Help("of the receiver; without it as the scenario has it")] = (
        None,
    )
    wind_m_s: Annotated[Any, _WIND, Help("from a direction that the seed draws")] = (0.0,)
    gps_noise_m: Annotated[Any, _GPS_NOISE, Help("sigma on each axis")] = (0.0,)
    take_off_m: Annotated[Any, _Axis(_HEIGHT, "numbers"), Help("height of the take-off")] = (3.0,)
    height_m: Annotated[Any, _ByStrategy(_HEIGHT), Help("held in the search")] = 3.0
    speed_m_s: Annotated[Any, _ByStrategy(_SPEED), Help("of the search")] = 1.0
    limit_s: Annotated[Any, _ByStrategy(_LIMIT), Help("of the search, then it lands")] = 900.0
    victims: Annotated[Any, HowMany(), Help("how many transmitters are searched for, or all")] = 1
    area_m: Annotated[Any, AreaM(), Help("searched in strips: south, west, north, east of home")] = (
        -50.0,
        -50.0,
        50.0,
        50.0,
    )
    strip_width_m: Annotated[float, _WIDTH, Help("of the strips")] = 40.0
    success_m: Annotated[float, _HEIGHT, Help("how near the place reported has to be")] = 2.0


@dataclass(frozen=True)
class CampaignPlan:
    """What a campaign tries: all of it crossed. `noise` None is the scenario's own; heights, speeds and limits are
    by strategy; `victims`: how many are searched for, None: all; `success_m`: how near the place reported has to be to
    the transmitter."""

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
    victims: int | None
    area_m: Area
    strip_width_m: float
    success_m: float


def load_plan(path: str | os.PathLike[str]) -> CampaignPlan:
    """The plan in a file. Raises ScenarioError with all mistakes, those in its scenario files too."""
    path = located(path)
    return parse_plan(read_text(path, "the plan of a campaign"), path)


def parse_plan(text: str, source: str) -> CampaignPlan:
    """The plan in `text`; files that it names are looked for from where `source` is. Raises ScenarioError."""

    def plan(top: Value) -> CampaignPlan:
        return _read(top, _File(os.path.dirname(source)))

    return read(text, source, "a mapping with strategies and scenarios", plan, SPEC)


def is_plan(text: str) -> bool:
    """Whether a text looks like a plan and not like a scenario."""
    names = keys_in(text)
    return "transmitters" not in names and bool(names & {"strategies", "scenarios"})


def _read(top: Value, file: _File) -> CampaignPlan:
    if not isinstance(top, dict):
        raise wrong(str(TableOf(PlanFile)))
    constraints = {name: one.constraint for name, one in keys(PlanFile).items()} | {"scenarios": _Scenarios(file)}
    given, violations = read_keys(top, constraints, PlanFile.__required__)  # type: ignore[attr-defined]
    values = {name: given.get(name, one.default) for name, one in keys(PlanFile).items() if name != "spec"}
    strategies = given.get("strategies", ())
    for name, constraint in constraints.items():
        if isinstance(constraint, _ByStrategy):
            value = values[name]
            values[name] = dict.fromkeys(strategies, keys(PlanFile)[name].default if isinstance(value, dict) else value)
            if isinstance(value, dict) and strategies:
                own, violations_of_own = read_keys(value, dict.fromkeys(strategies, constraint.number))
                violations += ConstraintError(*violations_of_own).below(name)
                values[name] |= own
    axes = [given[name] for name, one in constraints.items() if isinstance(one, _Axis) and name in given]
    count = math.prod(map(len, axes))
    if count > MOST_TRIALS:
        violations.append(Violation(f"at most {MOST_TRIALS}", f"{count} trials"))
    for name, one in given.get("scenarios", {}).items():
        count = one.count if isinstance(one, Random) else len(one.transmitters)
        if 0 < count < (wanted := values["victims"] or 1):
            violations.append(Violation(f"at most {count}, the transmitters of {name}", str(wanted), path=("victims",)))
    if violations or file.problems:
        raise ConstraintError(*violations, problems=file.problems)
    return CampaignPlan(**values)
