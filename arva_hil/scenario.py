"""The scenario file: where the transmitters are and what the receiver is like, typed, frozen and validated.

The file is YAML; `configs/default.yaml` shows every key with its default. Units are those of the file:
metres, degrees, seconds, hertz. World frame NED, body frame FRD.
"""

from __future__ import annotations

import os
from dataclasses import asdict, astuple, dataclass, field
from typing import Any, Final, Literal, get_args

import yaml

from arva_hil._yaml import Problem, Range, Reader, ScenarioError, read_text
from arva_hil.faults.spec import Fault, plain_fault, read_faults

__all__ = [
    "DEFAULT",
    "FORMATS",
    "RATE_HZ",
    "SEED",
    "Datum",
    "Fault",
    "Format",
    "Lla",
    "Mount",
    "Noise",
    "Problem",
    "Receiver",
    "Scenario",
    "ScenarioError",
    "Transmitter",
    "load",
    "parse",
    "to_dict",
]

Triple = tuple[float, float, float]
NoiseKind = Literal["uniform", "gaussian", "off"]
Format = Literal["binary", "nmea", "text", "tunnel", "named", "named_float", "debug_vect"]

SPEC: Final = 1
FORMATS: Final[tuple[Format, ...]] = get_args(Format)
NOISE_KINDS: Final[tuple[NoiseKind, ...]] = get_args(NoiseKind)
NO_SIGNAL: Final = ((-1, -1), (-1, 0), (0, 0))

RATE_HZ: Final = Range(0.1, 50)
SEED: Final = Range(0, 2**63 - 1, "a whole number")
_ID: Final = Range(0, 254, "a whole number")
_IDS: Final = range(255)
_TRANSMITTERS: Final = range(1, 256)
_CHANNELS: Final = Range(1, 16, "a whole number")
_STRENGTH: Final = Range(0, 1000, above=True)
_JITTER_S: Final = Range(0, 5)
_KAPPA_EQ: Final = Range(0, 1000, above=True)
_FLOOR_M: Final = Range(0, 1_000_000, above=True)
_SIGNAL: Final = Range(-1, 0, "a whole number")
_SENSITIVITY: Final = (Range(0, 1, above=True),) * 3
_WORLD_M: Final = (Range(-1_000_000, 1_000_000),) * 3
_BODY_M: Final = (Range(-100, 100),) * 3
_ANGLE_DEG: Final = Range(-360, 360)
_LLA: Final = {
    "lat": Range(-90, 90, "a latitude"),
    "lon": Range(-180, 180, "a longitude"),
    "alt": Range(-500, 9000, "an altitude"),
}


@dataclass(frozen=True)
class Lla:
    """WGS-84 latitude and longitude in degrees, altitude in metres AMSL."""

    lat: float
    lon: float
    alt: float


Datum = Literal["home"] | Lla


@dataclass(frozen=True)
class Transmitter:
    """A buried beacon, its position as given: `ned` (metres from the datum) or `lla`, the other is None.

    `attitude`: roll, pitch, yaw in degrees, FRD → NED; the dipole is the x axis. `strength`: κ‖m‖ relative to
    the reference transmitter. Raises ValueError unless exactly one position is given.
    """

    id: int
    ned: Triple | None = None
    lla: Lla | None = None
    attitude: Triple = (0.0, 0.0, 0.0)
    strength: float = 1.0

    def __post_init__(self) -> None:
        if (self.ned is None) == (self.lla is None):
            raise ValueError("a transmitter has either ned or lla")


@dataclass(frozen=True)
class Noise:
    """The noise of eq. 4; `floor_range_m` is r_en, where it is as strong as the reference transmitter."""

    kind: NoiseKind = "uniform"
    floor_range_m: float = 80.0


@dataclass(frozen=True)
class Mount:
    """Where the receiver sits: `position` in body FRD, metres; `attitude` roll, pitch, yaw in degrees."""

    position: Triple = (0.0, 0.0, 0.0)
    attitude: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Receiver:
    """The receiver. `sensitivity`: the diagonal of Q; `no_signal`: (d, δ) when there is nothing to report.

    Each frame is up to `jitter_s` late, less than half the period.
    """

    channels: int = 4
    rate_hz: float = 1.0
    jitter_s: float = 0.0
    kappa_eq: float = 1.542
    sensitivity: Triple = (1.0, 0.8, 0.6)
    noise: Noise = Noise()
    mount: Mount = Mount()
    no_signal: tuple[int, int] = (-1, -1)


@dataclass(frozen=True)
class Scenario:
    """One scenario. `source` is the file's name; two scenarios that differ in nothing else are equal."""

    transmitters: tuple[Transmitter, ...]
    datum: Datum = "home"
    receiver: Receiver = Receiver()
    output_format: Format = "binary"
    seed: int = 1
    faults: tuple[Fault, ...] = ()
    source: str = field(default="default scenario", compare=False)


DEFAULT: Final = Scenario((Transmitter(id=1, ned=(20.0, 5.0, 0.0)),))
"""One transmitter 20 m north, 5 m east of home."""


def load(path: str | os.PathLike[str]) -> Scenario:
    """The scenario in a file. Raises ScenarioError, also when the file cannot be read."""
    return parse(read_text(path, "a scenario file"), os.fspath(path))


def parse(text: str, source: str) -> Scenario:
    """The scenario in `text`; `source` names it in messages. Raises ScenarioError with all mistakes."""
    r = Reader(text, source)
    f = r.mapping(r.root, "spec datum transmitters receiver output seed faults", need=["transmitters"])
    r.spec(f.get("spec"), SPEC)
    transmitters = _transmitters(r, f.get("transmitters"))
    datum = _datum(r, f.get("datum"))
    receiver = _receiver(r, f.get("receiver"))
    output = r.mapping(f.get("output"), "format")
    output_format = r.word(output.get("format"), DEFAULT.output_format, FORMATS)
    seed = r.integer(f.get("seed"), DEFAULT.seed, SEED)
    ids = [t.id for t in transmitters]
    faults = read_faults(r, f.get("faults"), ids if min(ids, default=-1) >= 0 else _IDS, output_format)
    r.finish()
    return Scenario(transmitters, datum, receiver, output_format, seed, faults, source)


def to_dict(scenario: Scenario) -> dict[str, Any]:
    """The scenario as plain JSON types with every default written out; `parse` reads it back equal."""
    transmitters = []
    for t in scenario.transmitters:
        frame, position = ("ned", t.ned) if t.lla is None else ("lla", astuple(t.lla))
        transmitters.append(
            {
                "id": t.id,
                frame: list(position or ()),
                "attitude": _plain_attitude(t.attitude),
                "strength": t.strength,
            }
        )
    receiver = scenario.receiver
    mount = receiver.mount
    return {
        "spec": SPEC,
        "datum": scenario.datum if scenario.datum == "home" else asdict(scenario.datum),
        "transmitters": transmitters,
        "receiver": {
            **asdict(receiver),
            "sensitivity": list(receiver.sensitivity),
            "mount": {"position": list(mount.position), "attitude": _plain_attitude(mount.attitude)},
            "no_signal": list(receiver.no_signal),
        },
        "output": {"format": scenario.output_format},
        "seed": scenario.seed,
        "faults": [plain_fault(fault) for fault in scenario.faults],
    }


def _transmitters(r: Reader, node: yaml.Node | None) -> tuple[Transmitter, ...]:
    transmitters = []
    first: dict[int, int] = {}  # id → its line
    for item in r.items(node, _TRANSMITTERS, "transmitters"):
        f = r.mapping(item, "id enu ned lla attitude strength", need=["id", "enu ned lla"])
        number = r.integer(f.get("id"), -1, _ID)
        if number in first:
            r.wrong(f["id"], f"id {number} again (first on line {first[number]})", "an id of its own")
        elif number >= 0:
            first[number] = f["id"].start_mark.line + 1
        east, north, up = r.triple(f.get("enu"), (0.0, 0.0, 0.0), _WORLD_M)
        ned = r.triple(f.get("ned"), (north, east, 0.0 - up), _WORLD_M)
        lla = Lla(*r.triple(f.get("lla"), (0.0, 0.0, 0.0), tuple(_LLA.values()))) if "lla" in f else None
        attitude = _attitude(r, f.get("attitude"))
        strength = r.number(f.get("strength"), 1.0, _STRENGTH)
        transmitters.append(Transmitter(number, None if lla else ned, lla, attitude, strength))
    return tuple(transmitters)


def _datum(r: Reader, node: yaml.Node | None) -> Datum:
    if isinstance(node, yaml.MappingNode):
        f = r.mapping(node, "lat lon alt", need=list(_LLA))
        return Lla(*(r.number(f.get(key), 0.0, valid) for key, valid in _LLA.items()))
    r.word(node, "home", ("home",), "home or a mapping with lat, lon, alt")
    return "home"


def _receiver(r: Reader, node: yaml.Node | None) -> Receiver:
    default = Receiver()
    f = r.mapping(node, "channels rate_hz jitter_s kappa_eq sensitivity noise mount no_signal")
    channels = r.integer(f.get("channels"), default.channels, _CHANNELS)
    mistakes = len(r.problems)
    rate_hz = r.number(f.get("rate_hz"), default.rate_hz, RATE_HZ)
    jitter_s = r.number(f.get("jitter_s"), default.jitter_s, _JITTER_S)
    if jitter_s >= 0.5 / rate_hz and mistakes == len(r.problems):
        half = f"less than half the period ({0.5 / rate_hz:.4g} s)"
        r.wrong(f["jitter_s"], f"jitter_s {jitter_s:.4g}", half)
    noise = r.mapping(f.get("noise"), "kind floor_range_m")
    mount = r.mapping(f.get("mount"), "position attitude")
    return Receiver(
        channels,
        rate_hz,
        jitter_s,
        kappa_eq=r.number(f.get("kappa_eq"), default.kappa_eq, _KAPPA_EQ),
        sensitivity=r.triple(f.get("sensitivity"), default.sensitivity, _SENSITIVITY),
        noise=Noise(
            r.word(noise.get("kind"), default.noise.kind, NOISE_KINDS),
            r.number(noise.get("floor_range_m"), default.noise.floor_range_m, _FLOOR_M),
        ),
        mount=Mount(
            r.triple(mount.get("position"), default.mount.position, _BODY_M),
            _attitude(r, mount.get("attitude")),
        ),
        no_signal=_no_signal(r, f.get("no_signal"), default.no_signal),
    )


def _attitude(r: Reader, node: yaml.Node | None) -> Triple:
    f = r.mapping(node, "roll pitch yaw")
    roll, pitch, yaw = (r.number(f.get(key), 0.0, _ANGLE_DEG) for key in ("roll", "pitch", "yaw"))
    return roll, pitch, yaw


def _no_signal(r: Reader, node: yaml.Node | None, default: tuple[int, int]) -> tuple[int, int]:
    items = r.items(node, range(2, 3), "whole numbers")
    if node is None or len(items) != 2:
        return default
    distance, angle = r.integer(items[0], -1, _SIGNAL), r.integer(items[1], 0, _SIGNAL)
    if (distance, angle) not in NO_SIGNAL:
        r.wrong(node, f"[{distance}, {angle}]", "[-1, -1], [-1, 0] or [0, 0]")
    return distance, angle


def _plain_attitude(attitude: Triple) -> dict[str, float]:
    return dict(zip(("roll", "pitch", "yaw"), attitude, strict=True))
