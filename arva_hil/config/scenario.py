"""The scenario file: transmitters, receivers and their world, typed, frozen and validated.

The file is YAML; `configs/default.yaml` has every key with its default. Units are those of the file:
metres, degrees, seconds, hertz. World frame NED, body frame FRD.
"""

import os
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import InitVar
from functools import partial
from typing import Any, Final, Literal, get_args

from arva_hil.config import nodes
from arva_hil.config.common import FORMAT, SEED, SPEC, Pose
from arva_hil.config.constraints import ListOf, Text, Word
from arva_hil.config.errors import ConstraintError, ScenarioError, Violation, elsewhere
from arva_hil.config.faults import Fault, FaultItem, misfit
from arva_hil.config.profiles import located, take_over
from arva_hil.config.receiver import ReceiverOptions
from arva_hil.config.tables import Given, Table, TableOf, duplicates, items_of, key, keys, newer_keys, valid_value
from arva_hil.config.terrain import TERRAIN, ground_conflicts
from arva_hil.config.transmitter import Lla, MediumOptions, Transmitter
from arva_hil.config.vehicles import NavigationError, VehicleConfig, vehicle_conflicts

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


class OutputOptions(Table):
    """The frames, as a file has it."""

    format: str = key(FORMAT, "of the frames", default="binary")


class Scenario(Table):
    """One scenario. `source` is the file's name; two scenarios that differ in nothing else are equal.

    `pose`: the receiver is at the autopilot's estimate or at the simulator's truth. `navigation_error` (None: no
    error) is added to the estimate. Without `vehicles` there is one vehicle, on the command line's link, with one
    receiver. A file has `output_format` in a mapping `output`. Raises ValueError if an id or a name occurs twice, and
    for a navigation_error with `pose: truth`.
    """

    spec: InitVar[int] = key(SPEC, "the version of this file format", default=1, kw_only=True)
    transmitters: tuple[Transmitter, ...] = key(
        ListOf(TableOf(Transmitter), 1, 255, "transmitters"), "the transmitters to find"
    )
    datum: Datum = key(_HomeOrPlace(Lla), "the vehicle's home, or a place", default="home")
    receiver: ReceiverOptions = key(help="its properties", default=ReceiverOptions())
    output: InitVar[OutputOptions | None] = key(help="the frames", default=None, kw_only=True)
    output_format: str = key(FORMAT, default="binary")
    seed: int = key(SEED, "the same seed gives the same noise and faults", default=1)
    faults: tuple[Fault, ...] = key(
        ListOf(FaultItem(), 0, 1000, "faults"), "faults, each with its schedule", default=()
    )
    source: str = key(Text("a name", r"(?s:.*)"), default="default scenario", compare=False)
    pose: Pose = key(
        Word(get_args(Pose)),
        "the autopilot's estimate, or the simulator's truth",
        since=2,
        default="estimate",
    )
    navigation_error: NavigationError | None = key(help="true pose = reported pose + this", since=2, default=None)
    vehicles: tuple[VehicleConfig, ...] = key(
        ListOf(TableOf(VehicleConfig), 1, 250, "vehicles"),
        "default: one, on the command line's link",
        since=2,
        default=(),
    )
    medium: MediumOptions | None = key(
        help="the medium between transmitters and receivers; default: air", since=2, default=None
    )
    terrain: Any = key(TERRAIN, "the ground: an ESRI ASCII grid, or the autopilot's data", since=2, default=None)

    def __post_init__(self, spec: int, output: OutputOptions | None) -> None:
        if output is not None:
            object.__setattr__(self, "output_format", output.format)

    def file_keys(self) -> dict[str, Any]:
        """Return the keys with another form in files than in Python."""
        return {"output": {"format": self.output_format}}

    @classmethod
    def conflicts(cls, of: Any) -> Iterator[Violation]:
        """Yield the values that contradict each other, in a scenario or in a `Given` part of one."""
        transmitters, vehicles = items_of(of, "transmitters"), items_of(of, "vehicles")
        yield from duplicates(transmitters, "id", "id")
        if vehicles:
            yield from vehicle_conflicts(vehicles)
        systems = [vehicle.system for _, vehicle in vehicles]
        for path, one in transmitters:
            if one.follows and systems.count(one.follows.system) > 1:
                yield Violation("a system that one vehicle has", path=(*path, "follows", "system"))
        if of.terrain is not None:
            yield from ground_conflicts(of)
        if of.pose == "truth" and of.navigation_error is not None:
            yield Violation(
                "none with `pose: truth`, which has no error",
                "navigation_error",
                None,
                ("navigation_error",),
                at_key=True,
            )
        if not (isinstance(of, Given) and of.faults):
            return
        ids = [one.id for _, one in transmitters]
        known: Collection[int] = range(255) if not ids or None in ids else ids
        receivers = [one for _, vehicle in vehicles for _, one in items_of(vehicle, "receivers")]
        formats = {one.format if isinstance(one, Given) else one.output_format for one in receivers} - {None}
        if not formats:
            formats = {(of.output and of.output.format) or "binary"}
        for path, fault in items_of(of, "faults"):
            if found := next(filter(None, (misfit(fault, known, form) for form in sorted(formats))), None):
                yield Violation(found[1], found[0], path=path)


DEFAULT: Final = Scenario((Transmitter(id=1, ned=(20.0, 5.0, 0.0)),))
"""One transmitter 20 m north, 5 m east of home."""


def load(path: str | os.PathLike[str]) -> Scenario:
    """Load a scenario from a file, or by a name like `builtin:default`.

    Raises ScenarioError, also when it cannot be read.
    """
    path = located(path)
    from arva_hil.config.reading import read_text  # slow to import

    return parse(read_text(path, "a scenario file"), path)


def parse(text: str, source: str) -> Scenario:
    """Parse a scenario. `source`: its name in messages. Raises ScenarioError with all mistakes."""
    from arva_hil.config.reading import read  # slow to import

    return read(text, source, WHAT, partial(_read, source=source), nodes.NEWEST_SPEC)


def _read(top: nodes.Value, source: str) -> Scenario:
    violations: list[Violation] = []
    if isinstance(top, nodes.Mapping):
        receivers = [one for vehicle in top.tables("vehicles") for one in vehicle.tables("receivers")]
        if top.spec > 1:
            violations = _take_profiles(top, receivers)
        _inherit(top, receivers)
    try:
        scenario: Scenario = TableOf(Scenario, source=source).read(top)
    except ConstraintError as error:
        violations += error.violations
    if violations:
        raise ConstraintError(*violations)
    return scenario


def _take_profiles(top: nodes.Mapping, receivers: Iterable[nodes.Mapping]) -> list[Violation]:
    """Give transmitters and receivers the keys of their profiles. Returns the mistakes of the profiles."""
    violations: list[Violation] = []
    entries = [(one, "receiver") for one in (top.get("receiver"), *receivers)]
    for entry, of in [*entries, *((one, "transmitter") for one in top.tables("transmitters"))]:
        try:
            take_over(entry, of)
        except ScenarioError as error:
            violations += elsewhere(error).violations
    return violations


def _inherit(top: nodes.Mapping, receivers: Collection[nodes.Mapping]) -> None:
    """Add the keys that a vehicle's receiver lacks: those of `receiver`, the format, and a seed.

    The seed of receiver n (from 0) is the scenario's plus n, so that no two receivers have the same noise.
    """
    if not receivers:
        return
    receiver, output = top.get("receiver"), top.get("output")
    seed = valid_value(Scenario, top, "seed") or 0
    for number, entry in enumerate(receivers):
        if isinstance(receiver, nodes.Mapping):
            of_all = keys(ReceiverOptions)
            same = entry.get("model", receiver.get("model")) == receiver.get("model")
            entry.inherit(receiver, [name for name in receiver if same or name in of_all])
        if isinstance(output, nodes.Mapping):
            entry.inherit(output, ["format"])
        entry.setdefault("seed", (seed + number) % (SEED.high + 1))


def to_dict(scenario: Scenario) -> dict[str, Any]:
    """Return the scenario with every default as plain JSON types, from which `parse` gives an equal scenario."""
    spec = 2 if newer_keys(scenario) else 1
    plain: dict[str, Any] = TableOf(Scenario).plain(scenario, spec)
    return {"spec": spec, **plain}
