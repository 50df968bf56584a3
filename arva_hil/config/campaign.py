"""The file of a campaign's plan. Each axis is one value or a list; the campaign flies every combination."""

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import InitVar
from pathlib import Path
from typing import Any, Final, get_args

from arva_hil.config.common import NOISE_KINDS, SEED, NoiseKind
from arva_hil.config.constraints import Constraint, ListOf, Named, Number, Numbers, Text, Whole, Word
from arva_hil.config.errors import ConstraintError, Problem, ScenarioError, Violation, elsewhere, wrong
from arva_hil.config.nodes import folder_of
from arva_hil.config.profiles import located
from arva_hil.config.reading import keys_in, read, read_text
from arva_hil.config.scenario import Scenario, load
from arva_hil.config.tables import Table, TableOf, key, newer_keys, read_keys
from arva_hil.config.transmitter import KeyingKind
from arva_hil.registry import RECEIVERS, STRATEGIES, formats_with_ids, over_mavlink

SPEC: Final = 1
WHAT: Final = "a mapping with strategies and scenarios"
MOST_TRIALS: Final = 100_000_000
MOST_DRONES: Final = 64
_MOST_VALUES: Final = 100_000  # of one axis
_NOT_FLOWN: Final = ("follows", "vehicles", "terrain")  # one vehicle, above flat ground


_DEPTH: Final = Number(-100, 100, unit="m")


Area = tuple[float, float, float, float]  # south, west, north, east of home, m
_AREA: Final = Numbers(
    *[Number(-10_000, 10_000, unit="m")] * 4,
    names="south, west, north, east",
    fits=lambda area: area[0] < area[2] and area[1] < area[3],
    expected="south, west, north, east",
)


class HowMany(Constraint):
    """The number of transmitters searched for, None: all."""

    kind = "a whole number, or all"
    range = "1…16"
    _number: Final = Whole(1, 16)

    def __str__(self) -> str:
        return "a whole number 1…16, or all"

    def read(self, value: Any) -> int | None:
        if value is None or str(getattr(value, "plain", value)) == "all":
            return None
        try:
            return self._number.read(value)
        except ConstraintError:
            raise wrong(str(self)) from None

    def json(self) -> dict[str, Any]:
        return {"anyOf": [self._number.json(), {"const": "all"}]}


class Random(Table, one_of="within_m area_m"):
    """A scenario with `count` transmitters, drawn by the seed.

    The places are uniform within ±`within_m` north and east of home, or in `area_m`. The depths are uniform from
    `depth_m`[0] to `depth_m`[1], the attitudes uniform among all rotations.
    """

    within_m: float | None = key(
        Number(0, 10_000, above=True, unit="m"), "of home to the north, east, south and west", default=None
    )
    depth_m: tuple[float, float] = key(
        Numbers(_DEPTH, _DEPTH, fits=lambda depths: depths[0] <= depths[1], expected="the smaller one first"),
        "from, to",
        default=(0.0, 2.0),
    )
    area_m: Area | None = key(_AREA, "instead: south, west, north, east of home", default=None)
    count: int = key(Whole(1, 16), "the number of transmitters", default=1)
    model: str = key(Named(RECEIVERS), "of the receiver", default="paper")
    keying: KeyingKind | None = key(Word(get_args(KeyingKind)), "of the transmitters: the class of sets", default=None)

    def __str__(self) -> str:
        low, high = self.depth_m
        count = f"{self.count} " if self.count > 1 else ""
        there = f"within {self.within_m:g} m" if self.area_m is None else f"in {list(self.area_m)} m"
        heard = f", {self.model}" if self.model != "paper" else ""
        sent = f", {self.keying}" if self.keying else ""
        return f"{count}random {there} at {low:g} to {high:g} m{heard}{sent}"


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
        values = self._list.read(value)
        _each_once(values)
        return values

    def json(self) -> dict[str, Any]:
        return {"anyOf": [self.item.json(), self._list.json()]}


def _each_once(values: Iterable[Any]) -> None:
    """Raise ConstraintError for values that occur twice."""
    seen: dict[Any, int] = {}
    again = [
        Violation("each once", f"{value} again", path=(at,), first=(first,))
        for at, value in enumerate(values)
        if (first := seen.setdefault(value, at)) != at
    ]
    if again:
        raise ConstraintError(*again)


class _Seeds(_Axis):
    """A list of seeds, or how many there are from 1 on."""

    count: Final = Whole(1, 10_000_000, "a list of seeds, or how many,")
    kind = "a list of seeds, or how many"

    def read(self, value: Any) -> Any:
        if isinstance(value, range):
            return value
        return super().read(value) if isinstance(value, list | tuple) else range(1, self.count.read(value) + 1)

    def json(self) -> dict[str, Any]:
        return {"anyOf": [self.count.json(), self._list.json()]}


class _ByStrategy(Constraint):
    """One number for all strategies, or a mapping from their names, read once the strategies are known."""

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
    """A scenario file, relative to the plan's folder, or a random one."""

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
        path = os.path.join(folder_of(value), name)
        if not os.path.isfile(path):
            raise wrong(str(self), f"no file {path}")
        try:
            scenario = load(path)
        except ScenarioError as error:
            raise elsewhere(error) from None
        unserved: list[str] = [part for part in _NOT_FLOWN if part in newer_keys(scenario)]
        if over_mavlink(scenario.output_format):
            unserved.append(f"format {scenario.output_format}")
        if unserved:
            raise wrong("a scenario that a campaign flies", f"{path} with {', '.join(unserved)}")
        return scenario

    def json(self) -> dict[str, Any]:
        drawn = {
            "type": "object",
            "properties": {"random": TableOf(Random).json()},
            "required": ["random"],
            "additionalProperties": False,
        }
        return {"anyOf": [{"type": "string"}, drawn]}


class _Scenarios(_Axis):
    """Scenarios by name; in a file one or a list of them."""

    def read(self, value: Any) -> Mapping[str, Scenario | Random]:
        if isinstance(value, Mapping) and not hasattr(value, "node"):
            return value
        every = self._list.read(value) if isinstance(value, list) else (self.item.read(value),)
        names = [str(one) if isinstance(one, Random) else Path(one.source).stem for one in every]
        _each_once(names)
        return dict(zip(names, every, strict=True))


_HEIGHT: Final = Number(0, 1000, above=True, unit="m")


class CampaignPlan(Table):
    """The plan of a campaign: the product of all its axes.

    - `scenarios`: by name. `noise`: None is the scenario's own.
    - `height_m`, `speed_m_s`, `limit_s`: by strategy, or one for all.
    - `victims`: the number of transmitters to find; None: all.
    - `drones`: the number of drones that divide the area; each searches for one transmitter.

    Raises ValueError for values that do not fit together.
    """

    spec: InitVar[int] = key(Whole(1, SPEC, "a spec"), "the version of this file format", default=SPEC, kw_only=True)
    strategies: tuple[str, ...] = key(_Axis(Named(STRATEGIES, "a strategy")), "what flies")
    scenarios: Mapping[str, Scenario | Random] = key(
        _Scenarios(_File(), "scenarios"), "files, relative to this one, or random scenarios, drawn by the seed"
    )
    seeds: Sequence[int] = key(
        _Seeds(SEED, "seeds"), "of the noise and of everything that is drawn", default=range(1, 2)
    )
    noise: tuple[NoiseKind | None, ...] = key(
        _Axis(Word(NOISE_KINDS)), "of the receiver; default: the scenario's", default=(None,)
    )
    wind_m_s: tuple[float, ...] = key(
        _Axis(Number(0, 100, unit="m/s"), "numbers"), "the seed draws its direction", default=(0.0,)
    )
    gps_noise_m: tuple[float, ...] = key(
        _Axis(Number(0, 1000, unit="m"), "numbers"), "sigma on each axis", default=(0.0,)
    )
    take_off_m: tuple[float, ...] = key(_Axis(_HEIGHT, "numbers"), "height of the take-off", default=(3.0,))
    height_m: Mapping[str, float] = key(_ByStrategy(_HEIGHT), "held in the search", default=3.0)
    speed_m_s: Mapping[str, float] = key(
        _ByStrategy(Number(0, 100, above=True, unit="m/s")), "of the search", default=1.0
    )
    limit_s: Mapping[str, float] = key(
        _ByStrategy(Number(0, 86_400, above=True, unit="s")), "of the search, then it lands", default=900.0
    )
    victims: int | None = key(HowMany(), "the number of transmitters to find, or all", default=1)
    drones: tuple[int, ...] = key(
        _Axis(Whole(1, MOST_DRONES)),
        "drones that share the area: one finds all `victims`, several find one each",
        default=(1,),
    )
    area_m: Area = key(
        _AREA, "searched in strips: south, west, north, east of home", default=(-50.0, -50.0, 50.0, 50.0)
    )
    strip_width_m: float = key(Number(1, 1000, unit="m"), "of the strips", default=40.0)
    success_m: float = key(_HEIGHT, "the largest error of the place reported", default=2.0)

    def __post_init__(self, spec: int) -> None:
        for name, number, value in _by_strategy(self):
            usual = CampaignPlan.__table__[name].default
            own = value if isinstance(value, Mapping) else dict.fromkeys(self.strategies, value)
            object.__setattr__(
                self,
                name,
                dict.fromkeys(self.strategies, usual) | {strategy: number.read(own[strategy]) for strategy in own},
            )

    @classmethod
    def conflicts(cls, of: Any) -> Iterator[Violation]:
        for name, number, value in _by_strategy(of):
            if isinstance(value, Mapping) and of.strategies and None not in of.strategies:
                _, violations = read_keys(value, dict.fromkeys(of.strategies, number))
                yield from ConstraintError(*violations).below(name)
        axes = [getattr(of, name) for name, one in cls.__table__.items() if isinstance(one.constraint, _Axis)]
        count = math.prod(len(axis) for axis in axes if axis)
        if count > MOST_TRIALS:
            yield Violation(f"at most {MOST_TRIALS}", f"{count} trials")
        teams = [count for count in of.drones or () if count is not None and count > 1]
        noise_m = max((one for one in of.gps_noise_m or () if one), default=0.0)  # a wrong one is None
        for name, one in of.scenarios.items() if isinstance(of.scenarios, Mapping) else ():
            count = one.count if isinstance(one, Random) else len(one.transmitters)
            if 0 < count < (wanted := of.victims or 1):
                yield Violation(f"at most {count}, the transmitters of {name}", str(wanted), path=("victims",))
            if isinstance(one, Scenario) and one.navigation_error and noise_m:
                yield Violation(
                    "0: the scenario has the error",
                    f"{noise_m:g} with the navigation_error of {name}",
                    path=("gps_noise_m",),
                )
            if teams and min(teams) < (every := of.victims or count):
                yield Violation(f"1, or {every} at least: each finds one", str(min(teams)), path=("drones",))
            if teams and isinstance(one, Scenario) and one.output_format not in formats_with_ids():
                found = f"{min(teams)} with frames of {name} in the format {one.output_format}"
                yield Violation("1: several need frames with ids", found, path=("drones",))


def _by_strategy(plan: Any) -> Iterator[tuple[str, Number, Any]]:
    """Yield the keys that may differ by strategy: name, constraint, and value, a mapping or one for all."""
    for name, one in CampaignPlan.__table__.items():
        if isinstance(one.constraint, _ByStrategy):
            yield name, one.constraint.number, getattr(plan, name)


def load_plan(path: str | os.PathLike[str]) -> CampaignPlan:
    """Load a plan from a file. Raises ScenarioError with all mistakes, also those in its scenario files."""
    path = located(path)
    return parse_plan(read_text(path, "the plan of a campaign"), path)


def parse_plan(text: str, source: str) -> CampaignPlan:
    """Return the plan in `text`; files that it names are relative to `source`. Raises ScenarioError."""
    if "transmitters" in (names := keys_in(text)) and not names & {"strategies", "scenarios"}:
        raise ScenarioError(
            [
                Problem(
                    source,
                    1,
                    1,
                    "a scenario",
                    f"the plan of a campaign, which names a scenario, e.g. `scenarios: [{os.path.basename(source)}]`",
                )
            ]
        )
    plan: CampaignPlan = read(text, source, WHAT, TableOf(CampaignPlan).read, SPEC)
    return plan


def is_plan(text: str) -> bool:
    """Return True if a text has the keys of a plan and not of a scenario."""
    names = keys_in(text)
    return "transmitters" not in names and bool(names & {"strategies", "scenarios"})
