"""The scenario file: where the transmitters are and what the receivers are like, typed, frozen and validated.

The file is YAML; `configs/default.yaml` shows every key with its default. Units are those of the file:
metres, degrees, seconds, hertz. World frame NED, body frame FRD.
"""

import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import InitVar, asdict, astuple, field, replace
from typing import Annotated, Any, Final, Literal, get_args

from arva_hil.config import tree
from arva_hil.config.builtin import located
from arva_hil.config.faults import Fault, FaultItem, misfit, plain_fault
from arva_hil.config.kinds import FORMAT, SEED, Pose, Triple
from arva_hil.config.marks import Help, NotAKey, Since
from arva_hil.config.mistake import Mistake, Mistakes, below
from arva_hil.config.nested import Either, Tables
from arva_hil.config.receiver import ReceiverOptions
from arva_hil.config.sorts import Listed, Spec
from arva_hil.config.tables import NEWER, keys, right, table, validate
from arva_hil.config.text import Text, Word
from arva_hil.config.transmitter import Lla, Transmitter, same_ids
from arva_hil.config.vehicles import NavigationError, VehicleConfig, clashes
from arva_hil.registry import FORMATS

Datum = Literal["home"] | Lla

SPEC: Final = 2  # the newest that is read
WHAT: Final = "a mapping with transmitters"
_FAULTS: Final = Listed(FaultItem(), 0, 1000, "faults")


@table()
class OutputOptions:
    """The frames, as a file has it."""

    format: Annotated[str, FORMAT, Help("of the frames")] = "binary"


@table()
class Scenario:
    """One scenario. `source` is the file's name; two scenarios that differ in nothing else are equal.

    `pose`: whether the receiver hears where the autopilot believes to be or where a simulator says that it is.
    `navigation_error` (None: there is none) is added to the estimate. Without `vehicles` there is one, the command
    line's, with one receiver. A file has `output_format` in a mapping `output`. Raises ValueError when an id or a name
    is there twice, and for a navigation_error of the truth.
    """

    spec: InitVar[Annotated[int, Spec(SPEC), Help("the version of this file format")]] = field(default=1, kw_only=True)
    transmitters: Annotated[tuple[Transmitter, ...], Tables(1, 255, "transmitters"), Help("who is to be found")]
    datum: Annotated[
        Datum,
        Either(Word(("home",), "home or a mapping with lat, lon, alt"), "home or a mapping with lat, lon, alt"),
        Help("the vehicle's home, or a place"),
    ] = "home"
    receiver: Annotated[ReceiverOptions, Help("what it is like")] = ReceiverOptions()
    output: InitVar[Annotated[OutputOptions | None, Help("what is sent")]] = field(default=None, kw_only=True)
    output_format: Annotated[str, FORMAT, NotAKey()] = "binary"
    seed: Annotated[int, SEED, Help("same seed, same noise, same faults")] = 1
    faults: Annotated[tuple[Fault, ...], _FAULTS, Help("on purpose and on time")] = ()
    source: Annotated[str, Text("a name", r"(?s:.*)"), NotAKey()] = field(default="default scenario", compare=False)
    pose: Annotated[
        Pose,
        Word(get_args(Pose)),
        Since(2),
        Help("the vehicle's: an autopilot's estimate or a simulator's truth"),
    ] = "estimate"
    navigation_error: Annotated[NavigationError | None, Since(2), Help("true pose = reported pose + this")] = None
    vehicles: Annotated[
        tuple[VehicleConfig, ...], Tables(1, 64, "vehicles"), Since(2), Help("without it one, the command line's")
    ] = ()

    def __post_init__(self, spec: int, output: OutputOptions | None) -> None:
        if output is not None:
            object.__setattr__(self, "output_format", output.format)
        ids = same_ids([{"id": transmitter.id} for transmitter in self.transmitters])
        if self.pose == "truth" and self.navigation_error is not None:
            raise ValueError("a scenario with `pose: truth` has no navigation_error")
        if mistakes := [*_below("transmitters", ids), *_below("vehicles", clashes(list(map(_named, self.vehicles))))]:
            raise ValueError("; ".join(map(str, mistakes)))

    @classmethod
    def misfits(cls, mapping: Mapping[str, Any]) -> Iterator[Mistake]:
        """What does not fit together in a file's mapping, whatever else is wrong in it."""
        transmitters, vehicles, faults = (_list(mapping, key) for key in ("transmitters", "vehicles", "faults"))
        yield from _below("transmitters", same_ids(transmitters))
        yield from _below("vehicles", clashes(vehicles))
        if right(cls, mapping, "pose") == "truth" and "navigation_error" in mapping:
            expected = "none with `pose: truth`, which has no error"
            yield Mistake(expected, "navigation_error", where=("navigation_error",), at_key=True)
        ids: list[Any] = [
            right(Transmitter, t, "id") if isinstance(t, Mapping) and "id" in t else None for t in transmitters
        ]
        known: Collection[int] = range(255) if not ids or None in ids else ids
        for at, item in enumerate(faults):
            try:
                fault = FaultItem().read(item)
            except (Mistake, Mistakes):
                continue
            for of in _formats(mapping):
                if wrong := misfit(fault, known, of):
                    yield Mistake(wrong[1], wrong[0], where=("faults", at))
                    break


def _below(key: str, mistakes: Iterator[Mistake]) -> Iterator[Mistake]:
    for wrong in mistakes:
        yield from below(key, wrong)


def _list(mapping: Mapping[str, Any], key: str) -> Sequence[Any]:
    """A list in a file, empty when it is none."""
    value = mapping.get(key)
    return value if isinstance(value, list) else []


def _format(mapping: Mapping[str, Any]) -> str:
    """The format in a file, as far as it is right."""
    output = mapping.get("output")
    of: str = (right(OutputOptions, output, "format") if isinstance(output, Mapping) else None) or "binary"
    return of


def _formats(mapping: Mapping[str, Any]) -> list[Any]:
    """The formats of all receivers in a file, as far as they are right."""
    receivers = [r for v in _list(mapping, "vehicles") if isinstance(v, Mapping) for r in _list(v, "receivers")]
    given = [r.get("format", "binary") for r in receivers if isinstance(r, Mapping)]
    formats = [str(of) for of in given if isinstance(of, str) and of in FORMATS]
    return formats or [_format(mapping)]


def _named(vehicle: VehicleConfig) -> dict[str, Any]:
    """What tells a vehicle from others, as a file has it."""
    receivers = [{"name": r.name} | ({"port": r.port} if r.port else {}) for r in vehicle.receivers]
    link = {"autopilot": vehicle.autopilot} if vehicle.autopilot else {}
    system = {"system": vehicle.system} if vehicle.system else {}
    return {"name": vehicle.name, "receivers": receivers} | link | system


DEFAULT: Final = Scenario((Transmitter(id=1, ned=(20.0, 5.0, 0.0)),))
"""One transmitter 20 m north, 5 m east of home."""


def load(path: str | os.PathLike[str]) -> Scenario:
    """The scenario in a file, or of a name as `builtin:default`. Raises ScenarioError, also when it cannot be read."""
    path = located(path)
    from arva_hil.config.yaml_tree import read_text  # slow to import

    return parse(read_text(path, "a scenario file"), path)


def parse(text: str, source: str) -> Scenario:
    """The scenario in `text`; `source` names it in messages. Raises ScenarioError with all mistakes."""
    from arva_hil.config.reading import read  # slow to import

    scenario = read(text, source, WHAT, _read, SPEC, lambda spec: NEWER if spec == 1 else ())
    return replace(scenario, source=source)


def _read(top: tree.Tree) -> Scenario:
    if isinstance(top, tree.Mapping):
        _inherit(top)
    return validate(Scenario, top)


def _inherit(top: tree.Mapping) -> None:
    """Give each receiver of a vehicle what it has not of its own: the keys of `receiver`, the format, and a seed, the
    n-th one (from 0) the scenario's plus n, so that no two hear the same noise."""
    receiver, output = top.get("receiver"), top.get("output")
    seed = right(Scenario, top, "seed") or 0
    entries = [r for v in _list(top, "vehicles") if isinstance(v, Mapping) for r in _list(v, "receivers")]
    for number, entry in enumerate(entries):
        if isinstance(entry, tree.Mapping):
            if isinstance(receiver, tree.Mapping):
                of_all = keys(ReceiverOptions)
                same = entry.get("model", receiver.get("model")) == receiver.get("model")
                entry.inherit(receiver, [name for name in receiver if same or name in of_all])
            if isinstance(output, tree.Mapping):
                entry.inherit(output, ["format"])
            entry.setdefault("seed", (seed + number) % (SEED.high + 1))


def to_dict(scenario: Scenario) -> dict[str, Any]:
    """The scenario as plain JSON types with every default written out; `parse` reads it back equal."""
    plain: dict[str, Any] = {
        "spec": 2 if any(parts_of_spec_2(scenario).values()) else 1,
        "datum": scenario.datum if scenario.datum == "home" else asdict(scenario.datum),
        "transmitters": [_plain_transmitter(t) for t in scenario.transmitters],
        "receiver": _plain_receiver(scenario.receiver),
        "output": {"format": scenario.output_format},
        "seed": scenario.seed,
        "faults": [plain_fault(fault) for fault in scenario.faults],
    }
    if plain["spec"] == 1:
        del plain["receiver"]["model"]
        return plain
    plain["pose"] = scenario.pose
    if error := scenario.navigation_error:
        plain["navigation_error"] = {
            "bias_ned": list(error.bias_ned),
            "walk": {"sigma_m": error.walk_sigma_m, "tau_s": error.walk_tau_s},
            "heading_deg": error.heading_deg,
            "latency_s": error.latency_s,
        }
    if scenario.vehicles:
        plain["vehicles"] = [_plain_vehicle(vehicle) for vehicle in scenario.vehicles]
    return plain


def parts_of_spec_2(scenario: Scenario) -> dict[str, bool]:
    """Which of the things are there that only a file of spec 2 can say."""
    return {
        "pose": scenario.pose != "estimate",
        "navigation_error": scenario.navigation_error is not None,
        "path": any(t.path for t in scenario.transmitters),
        "follows": any(t.follows for t in scenario.transmitters),
        "model": scenario.receiver.model != "paper",
        "vehicles": bool(scenario.vehicles),
    }


def _plain_transmitter(t: Transmitter) -> dict[str, Any]:
    plain: dict[str, Any] = {"id": t.id}
    if t.ned is not None:
        plain["ned"] = list(t.ned)
    elif t.lla is not None:
        plain["lla"] = list(astuple(t.lla))
    elif t.path is not None:
        plain["path"] = {"frame": "ned", "points": [list(p) for p in t.path.points_ned], "end": t.path.end}
    elif t.follows is not None:
        plain["follows"] = {"system": t.follows.system, "offset": list(t.follows.offset)}
    return plain | {"attitude": _plain_attitude(t.attitude), "strength": t.strength}


def _plain_receiver(receiver: ReceiverOptions) -> dict[str, Any]:
    mount, plain = receiver.mount, asdict(receiver)
    return {
        **(plain.pop("options") or {}),
        **plain,
        "sensitivity": list(receiver.sensitivity),
        "mount": {"position": list(mount.position), "attitude": _plain_attitude(mount.attitude)},
        "no_signal": list(receiver.no_signal),
    }


def _plain_vehicle(vehicle: VehicleConfig) -> dict[str, Any]:
    given = {"autopilot": vehicle.autopilot, "system": vehicle.system}
    receivers = [
        {"name": r.name}
        | ({} if r.port is None else {"port": r.port})
        | {"format": r.output_format, "seed": r.seed, **_plain_receiver(r.receiver)}
        for r in vehicle.receivers
    ]
    return {"name": vehicle.name, **{k: v for k, v in given.items() if v is not None}, "receivers": receivers}


def _plain_attitude(attitude: Triple) -> dict[str, float]:
    return dict(zip(("roll", "pitch", "yaw"), attitude, strict=True))
