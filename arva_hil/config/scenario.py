"""The scenario file: where the transmitters are and what the receivers are like, typed, frozen and validated.

The file is YAML; `configs/default.yaml` shows every key with its default. Units are those of the file:
metres, degrees, seconds, hertz. World frame NED, body frame FRD.
"""

import os
from collections.abc import Collection, Iterator, Mapping
from dataclasses import InitVar, field, replace
from typing import Annotated, Any, Final, Literal, get_args

from arva_hil.config import nodes
from arva_hil.config.common import FORMAT, SEED, Pose
from arva_hil.config.constraints import ListOf, Spec, Text, Word
from arva_hil.config.errors import ConstraintError, Problem, ScenarioError, Violation
from arva_hil.config.faults import Fault, FaultItem, misfit
from arva_hil.config.profiles import located, take_over
from arva_hil.config.receiver import ReceiverOptions
from arva_hil.config.tables import Help, NotAKey, Since, TableOf, duplicates, items_of, keys, table, valid_value
from arva_hil.config.terrain import Terrain, find_beside, ground_conflicts
from arva_hil.config.transmitter import Lla, MediumOptions, Transmitter
from arva_hil.config.vehicles import NavigationError, VehicleConfig, vehicle_conflicts
from arva_hil.registry import FORMATS

Datum = Literal["home"] | Lla

WHAT: Final = "a mapping with transmitters"


class _HomeOrPlace(TableOf):
    kind = "home or a mapping with lat, lon, alt"

    def __str__(self) -> str:
        return self.kind

    def read(self, value: Any) -> Any:
        if isinstance(value, Mapping | Lla):
            return super().read(value)
        return Word(("home",), self.kind).read(value)

    def plain(self, value: Any, spec: int) -> Any:
        return value if isinstance(value, str) else super().plain(value, spec)

    def json(self) -> dict[str, Any]:
        return {"anyOf": [{"const": "home"}, super().json()]}


@table()
class OutputOptions:
    """The frames, as a file has it."""

    format: Annotated[str, FORMAT, Help("of the frames")] = "binary"


@table()
class Scenario:
    """One scenario. `source` is the file's name; two scenarios that differ in nothing else are equal.

    `pose`: whether the receiver is at the pose that the autopilot estimates or at the true pose of a simulator.
    `navigation_error` (None: no error) is added to the estimate. Without `vehicles` there is one vehicle, on the
    command line's link, with one receiver. A file has `output_format` in a mapping `output`. Raises ValueError if an
    id or a name occurs twice, and for a navigation_error with `pose: truth`.
    """

    spec: InitVar[Annotated[int, Spec(nodes.NEWEST_SPEC), Help("the version of this file format")]] = field(
        default=1, kw_only=True
    )
    transmitters: Annotated[
        tuple[Transmitter, ...], ListOf(TableOf(Transmitter), 1, 255, "transmitters"), Help("who is to be found")
    ]
    datum: Annotated[Datum, _HomeOrPlace(Lla), Help("the vehicle's home, or a place")] = "home"
    receiver: Annotated[ReceiverOptions, Help("what it is like")] = ReceiverOptions()
    output: InitVar[Annotated[OutputOptions | None, Help("what is sent")]] = field(default=None, kw_only=True)
    output_format: Annotated[str, FORMAT, NotAKey()] = "binary"
    seed: Annotated[int, SEED, Help("same seed, same noise, same faults")] = 1
    faults: Annotated[tuple[Fault, ...], ListOf(FaultItem(), 0, 1000, "faults"), Help("on purpose and on time")] = ()
    source: Annotated[str, Text("a name", r"(?s:.*)"), NotAKey()] = field(default="default scenario", compare=False)
    pose: Annotated[
        Pose, Word(get_args(Pose)), Since(2), Help("the vehicle's: an autopilot's estimate or a simulator's truth")
    ] = "estimate"
    navigation_error: Annotated[NavigationError | None, Since(2), Help("true pose = reported pose + this")] = None
    vehicles: Annotated[
        tuple[VehicleConfig, ...],
        ListOf(TableOf(VehicleConfig), 1, 250, "vehicles"),
        Since(2),
        Help("without it one, the command line's"),
    ] = ()
    medium: Annotated[MediumOptions | None, Since(2), Help("what lies between; without it air")] = None
    terrain: Annotated[Any, Terrain(), Since(2), Help("the ground: an ESRI ASCII grid, or the autopilot's data")] = None

    def __post_init__(self, spec: int, output: OutputOptions | None) -> None:
        if output is not None:
            object.__setattr__(self, "output_format", output.format)

    def file_keys(self) -> dict[str, Any]:
        """What a file has otherwise than Python."""
        return {"output": {"format": self.output_format}}

    @classmethod
    def conflicts(cls, holder: Any) -> Iterator[Violation]:
        """What does not fit together, in a scenario or in a file's mapping."""
        transmitters = [(("transmitters", at), one) for at, one in items_of(holder, "transmitters")]
        yield from duplicates(Transmitter, transmitters, "id", "id")
        yield from vehicle_conflicts(holder)
        yield from ground_conflicts(cls, holder)
        in_file = isinstance(holder, Mapping)
        errs = "navigation_error" in holder if in_file else holder.navigation_error is not None
        if valid_value(cls, holder, "pose") == "truth" and errs:
            expected = "none with `pose: truth`, which has no error"
            yield Violation(expected, "navigation_error", None, ("navigation_error",), at_key=True)
        ids = [valid_value(Transmitter, one, "id") for _, one in transmitters]
        known: Collection[int] = range(255) if not ids or None in ids else ids
        for at, item in items_of(holder, "faults") if in_file else ():
            try:
                fault = FaultItem().read(item)
            except ConstraintError:
                continue
            found = next(filter(None, (misfit(fault, known, of) for of in _formats(holder))), None)
            if found:
                yield Violation(found[1], found[0], path=("faults", at))


def _formats(file: Mapping[str, Any]) -> list[str]:
    """The formats of all receivers in a file, as far as they are right."""
    receivers = [r for _, vehicle in items_of(file, "vehicles") for _, r in items_of(vehicle, "receivers")]
    given = [r.get("format", "binary") for r in receivers]
    formats = [str(of) for of in given if isinstance(of, str) and of in FORMATS]
    output = file.get("output")
    usual = valid_value(OutputOptions, output, "format") if isinstance(output, Mapping) else None
    return formats or [usual or "binary"]


DEFAULT: Final = Scenario((Transmitter(id=1, ned=(20.0, 5.0, 0.0)),))
"""One transmitter 20 m north, 5 m east of home."""


def load(path: str | os.PathLike[str]) -> Scenario:
    """The scenario in a file, or of a name as `builtin:default`. Raises ScenarioError, also when it cannot be read."""
    path = located(path)
    from arva_hil.config.reading import read_text  # slow to import

    return parse(read_text(path, "a scenario file"), path)


def parse(text: str, source: str) -> Scenario:
    """The scenario in `text`; `source` names it in messages. Raises ScenarioError with all mistakes."""
    from arva_hil.config.reading import read  # slow to import

    return replace(read(text, source, WHAT, lambda top: _read(top, source), nodes.NEWEST_SPEC), source=source)


def _read(top: nodes.Value, source: str) -> Scenario:
    problems: list[Problem] = []
    if isinstance(top, nodes.Mapping):
        if nodes.spec_of(top) > 1:
            problems += _take_profiles(top, source)
            find_beside(top, source)
        _inherit(top)
    try:
        scenario: Scenario = TableOf(Scenario).read(top)
    except ConstraintError as error:
        raise ConstraintError(*error.violations, problems=[*problems, *error.problems]) from None
    if problems:
        raise ConstraintError(problems=problems)
    return scenario


def _take_profiles(top: nodes.Mapping, source: str) -> list[Problem]:
    """Give transmitters and receivers the keys of their profiles; what is wrong with those."""
    entries = [(one, "transmitter") for _, one in items_of(top, "transmitters")]
    vehicles = (vehicle for _, vehicle in items_of(top, "vehicles"))
    entries += [(one, "receiver") for vehicle in vehicles for _, one in items_of(vehicle, "receivers")]
    problems: list[Problem] = []
    for entry, of in [(top.get("receiver"), "receiver"), *entries]:
        try:
            take_over(entry, of, source)
        except ScenarioError as error:
            problems += error.problems
    return problems


def _inherit(top: nodes.Mapping) -> None:
    """Add the keys that a vehicle's receiver does not have: those of `receiver`, the format, and a seed. The seed of
    the n-th receiver (from 0) is the scenario's plus n, so that no two hear the same noise."""
    receiver, output = top.get("receiver"), top.get("output")
    seed = valid_value(Scenario, top, "seed") or 0
    entries = [entry for _, vehicle in items_of(top, "vehicles") for _, entry in items_of(vehicle, "receivers")]
    for number, entry in enumerate(entries):
        if isinstance(receiver, nodes.Mapping):
            of_all = keys(ReceiverOptions)
            same = entry.get("model", receiver.get("model")) == receiver.get("model")
            entry.inherit(receiver, [name for name in receiver if same or name in of_all])
        if isinstance(output, nodes.Mapping):
            entry.inherit(output, ["format"])
        entry.setdefault("seed", (seed + number) % (SEED.high + 1))


def to_dict(scenario: Scenario) -> dict[str, Any]:
    """The scenario as plain JSON types with every default written out; `parse` reads it back equal."""
    spec = 2 if any(parts_of_spec_2(scenario).values()) else 1
    plain: dict[str, Any] = TableOf(Scenario).plain(scenario, spec)
    return {"spec": spec, **plain}


def parts_of_spec_2(scenario: Scenario) -> dict[str, bool]:
    """Which parts that only a file of spec 2 can have are in use."""
    return {
        "pose": scenario.pose != "estimate",
        "navigation_error": scenario.navigation_error is not None,
        "path": any(t.path for t in scenario.transmitters),
        "follows": any(t.follows for t in scenario.transmitters),
        "keying": any(t.keying for t in scenario.transmitters),
        "medium": scenario.medium is not None,
        "terrain": scenario.terrain is not None,
        "depth_m": any(t.depth_m is not None for t in scenario.transmitters),
        "sling": scenario.receiver.mount.sling is not None,
        "vehicle_noise": scenario.receiver.vehicle_noise is not None,
        "model": scenario.receiver.model != "paper",
        "vehicles": bool(scenario.vehicles),
    }
