"""What `spec: 2` adds around the receiver: the error of the autopilot's estimate, several vehicles and receivers."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import InitVar, field, fields
from typing import Annotated, Any, Final

from arva_hil.config.kinds import FORMAT, SEED, SYSTEM_ID, Triple
from arva_hil.config.mapping_keys import first
from arva_hil.config.marks import Help, NotAKey
from arva_hil.config.mistake import Mistake
from arva_hil.config.nested import Tables
from arva_hil.config.receiver import ReceiverOptions
from arva_hil.config.sorts import Number, Numbers
from arva_hil.config.tables import right, table
from arva_hil.config.text import Text
from arva_hil.registry import MAVLINK_FORMATS

_NAME: Final = Text("a name of letters, digits, _, - and .", r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_LINK: Final = Text("a connection string")
_SIGMA: Final = Number(0, 1000, unit="m")
_TAU: Final = Number(0, 1_000_000, above=True, unit="s")


@table()
class Walk:
    """A random walk that keeps coming back (Gauss-Markov), on each axis."""

    sigma_m: Annotated[float, _SIGMA, Help("standard deviation on each axis")] = 0.0
    tau_s: Annotated[float, _TAU, Help("how long it remembers")] = 60.0


@table()
class NavigationError:
    """How the vehicle's true pose differs from the pose that its autopilot reports: true pose = reported pose + this.

    `bias_ned` in metres; a random walk of `walk_sigma_m` on each axis that forgets in `walk_tau_s`; `heading_deg` is
    added to the yaw; the pose reported is `latency_s` old. A file has the two of the walk in a mapping `walk`.
    """

    bias_ned: Annotated[Triple, Numbers(*[Number(-10_000, 10_000, unit="m")] * 3), Help("north, east, down")] = (
        0.0,
        0.0,
        0.0,
    )
    walk: InitVar[Annotated[Walk | None, Help("a wandering estimate")]] = field(default=None, kw_only=True)
    walk_sigma_m: Annotated[float, _SIGMA, NotAKey()] = Walk.sigma_m
    walk_tau_s: Annotated[float, _TAU, NotAKey()] = Walk.tau_s
    heading_deg: Annotated[float, Number(-180, 180, unit="°"), Help("added to the yaw")] = 0.0
    latency_s: Annotated[float, Number(0, 10, unit="s"), Help("how old the reported pose is")] = 0.0

    def __post_init__(self, walk: Walk | None) -> None:
        if walk is not None:
            object.__setattr__(self, "walk_sigma_m", walk.sigma_m)
            object.__setattr__(self, "walk_tau_s", walk.tau_s)


@table()
class ReceiverEntry(ReceiverOptions):
    """One receiver of a vehicle as a file has it: its own keys beside those of `receiver`."""

    name: Annotated[str, _NAME, Help("unlike the vehicle's other receivers")] = field(kw_only=True)
    port: Annotated[str | None, _LINK, Help("where its frames go, if not over the autopilot's link")] = field(
        default=None, kw_only=True
    )
    format: Annotated[str, FORMAT, Help("of its frames")] = field(default="binary", kw_only=True)
    seed: Annotated[
        int, SEED, Help("of its noise and faults; without it the scenario's plus the number of receivers before it")
    ] = field(default=1, kw_only=True)

    @classmethod
    def misfits(cls, mapping: Mapping[str, Any]) -> Iterator[Mistake]:
        yield from super().misfits(mapping)
        of = right(cls, mapping, "format")
        if of is not None and of not in MAVLINK_FORMATS and "port" not in mapping:
            yield Mistake(f"a mapping with port, because frames of the format {of} go there", "no port")
        if of in MAVLINK_FORMATS and "port" in mapping:
            expected = "none, because they go over the autopilot's own link"
            yield Mistake(expected, f"a port for frames of the format {of}", where=("port",), at_key=True)


@table()
class ReceiverConfig:
    """One receiver of a vehicle: where its frames go (None: over the autopilot's link), in which format, and what it
    is like. Raises ValueError for a format that needs a port and has none, or the other way round."""

    name: Annotated[str, _NAME]
    port: Annotated[str | None, _LINK]
    receiver: ReceiverOptions = ReceiverOptions()
    output_format: Annotated[str, FORMAT] = "binary"
    seed: Annotated[int, SEED] = 1

    def __post_init__(self) -> None:
        if (self.port is None) == (self.output_format not in MAVLINK_FORMATS):
            has = "no port" if self.port is None else "a port"
            raise ValueError(f"receiver {self.name} has {has} and the format {self.output_format}")


def _receiver(entry: ReceiverEntry) -> ReceiverConfig:
    receiver = ReceiverOptions(**{key.name: getattr(entry, key.name) for key in fields(ReceiverOptions)})
    return ReceiverConfig(entry.name, entry.port, receiver, entry.format, entry.seed)


@table()
class VehicleConfig:
    """A vehicle: the link of its autopilot (None: the command line's), its MAVLink system id (None: the first one
    heard there), and its receivers."""

    name: Annotated[str, _NAME, Help("each its own")]
    autopilot: Annotated[str | None, _LINK, Help("the autopilot's link; two vehicles may have the same")] = None
    system: Annotated[int | None, SYSTEM_ID, Help("its MAVLink system id")] = None
    receivers: Annotated[
        tuple[ReceiverConfig, ...], Tables(1, 16, "receivers", ReceiverEntry, _receiver), Help("what it carries")
    ] = field(kw_only=True)


def clashes(vehicles: Sequence[Any]) -> Iterator[Mistake]:
    """What is wrong between vehicles, in the mappings of a file or what is like them."""
    names, ports = _Seen(), _Seen()
    mappings = [(at, vehicle) for at, vehicle in enumerate(vehicles) if isinstance(vehicle, Mapping)]
    by_link: dict[Any, list[tuple[int, Mapping[str, Any]]]] = {}
    for at, vehicle in mappings:
        yield from names.check(vehicle, "name", (at,), f"vehicle {vehicle.get('name')}", VehicleConfig)
        by_link.setdefault(right(VehicleConfig, vehicle, "autopilot"), []).append((at, vehicle))
        of_vehicle = _Seen()
        receivers = vehicle.get("receivers")
        for number, receiver in enumerate(receivers if isinstance(receivers, Sequence) else ()):
            if isinstance(receiver, Mapping):
                where = (at, "receivers", number)
                yield from of_vehicle.check(receiver, "name", where, f"receiver {receiver.get('name')}", ReceiverConfig)
                yield from ports.check(receiver, "port", where, f"port {receiver.get('port')}", ReceiverConfig)
    for shared in by_link.values():
        systems = _Seen()
        for at, vehicle in shared if len(shared) > 1 else ():
            if "system" not in vehicle:
                yield Mistake("a mapping with system, which tells vehicles on one link apart", "no system", where=(at,))
            yield from systems.check(vehicle, "system", (at,), f"system {vehicle.get('system')}", VehicleConfig)


class _Seen:
    """Remembers the values of one key, which may be there only once."""

    def __init__(self) -> None:
        self._first: dict[Any, Any] = {}

    def check(
        self, mapping: Mapping[str, Any], key: str, where: tuple[str | int, ...], what: str, cls: type
    ) -> Iterator[Mistake]:
        value = right(cls, mapping, key) if key in mapping else None
        if value is None or value == "pty":  # each `pty` is a new one
            return
        if value in self._first:
            yield Mistake(f"a {key} of its own", f"{what} again{first(self._first[value])}", where=(*where, key))
        self._first.setdefault(value, mapping[key])
