"""What `spec: 2` adds around the receiver: the error of the autopilot's estimate, several vehicles and receivers."""

from collections.abc import Iterator
from dataclasses import InitVar, field, fields
from typing import Annotated, Any, Final

from arva_hil.config.common import FORMAT, SEED, SYSTEM_ID, Triple
from arva_hil.config.constraints import ListOf, Number, Numbers, Text
from arva_hil.config.errors import Violation
from arva_hil.config.receiver import ReceiverOptions
from arva_hil.config.tables import Help, NotAKey, TableOf, duplicates, items_of, table, valid_value
from arva_hil.registry import MAVLINK_FORMATS

_NAME: Final = Text("a name of letters, digits, _, - and .", r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_LINK: Final = Text("a connection string")
_SIGMA: Final = Number(0, 1000, unit="m")
_TAU: Final = Number(0, 1_000_000, above=True, unit="s")
_BIAS: Final = Numbers(*[Number(-10_000, 10_000, unit="m")] * 3)


@table()
class RandomWalk:
    """A random walk that keeps coming back (Gauss-Markov), on each axis."""

    sigma_m: Annotated[float, _SIGMA, Help("standard deviation on each axis")] = 0.0
    tau_s: Annotated[float, _TAU, Help("how long it remembers")] = 60.0


@table()
class NavigationError:
    """How the vehicle's true pose differs from the pose that its autopilot reports: true pose = reported pose + this.

    `bias_ned` in metres; a random walk of `walk_sigma_m` on each axis that forgets in `walk_tau_s`; `heading_deg` is
    added to the yaw; the pose reported is `latency_s` old. A file has the two of the walk in a mapping `walk`.
    """

    bias_ned: Annotated[Triple, _BIAS, Help("north, east, down")] = (0.0, 0.0, 0.0)
    walk: InitVar[Annotated[RandomWalk | None, Help("a wandering estimate")]] = field(default=None, kw_only=True)
    walk_sigma_m: Annotated[float, _SIGMA, NotAKey()] = RandomWalk.sigma_m
    walk_tau_s: Annotated[float, _TAU, NotAKey()] = RandomWalk.tau_s
    heading_deg: Annotated[float, Number(-180, 180, unit="°"), Help("added to the yaw")] = 0.0
    latency_s: Annotated[float, Number(0, 10, unit="s"), Help("how old the reported pose is")] = 0.0

    def __post_init__(self, walk: RandomWalk | None) -> None:
        if walk is not None:
            object.__setattr__(self, "walk_sigma_m", walk.sigma_m)
            object.__setattr__(self, "walk_tau_s", walk.tau_s)

    def file_keys(self) -> dict[str, Any]:
        """What a file has otherwise than Python."""
        return {"walk": {"sigma_m": self.walk_sigma_m, "tau_s": self.walk_tau_s}}


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
    def conflicts(cls, holder: Any) -> Iterator[Violation]:
        yield from super().conflicts(holder)
        of, port = valid_value(cls, holder, "format"), holder.get("port") if isinstance(holder, dict) else holder.port
        if of in MAVLINK_FORMATS and port is not None:
            expected = "none, because they go over the autopilot's own link"
            yield Violation(expected, f"a port for frames of the format {of}", None, ("port",), at_key=True)
        elif of is not None and of not in MAVLINK_FORMATS and port is None:
            yield Violation(f"a mapping with port, because frames of the format {of} go there", "no port")


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


class _Receiver(TableOf):
    """In a file an entry with all keys, in Python what it means."""

    def read(self, value: Any) -> ReceiverConfig:
        if isinstance(value, ReceiverConfig):
            return value
        entry: ReceiverEntry = super().read(value)
        receiver = ReceiverOptions(**{key.name: getattr(entry, key.name) for key in fields(ReceiverOptions)})
        return ReceiverConfig(entry.name, entry.port, receiver, entry.format, entry.seed)

    def plain(self, value: ReceiverConfig, spec: int) -> Any:
        own = {"name": value.name, "port": value.port, "format": value.output_format, "seed": value.seed}
        options = TableOf(ReceiverOptions).plain(value.receiver, spec)
        return {key: item for key, item in own.items() if item is not None} | options


@table()
class VehicleConfig:
    """A vehicle: the link of its autopilot (None: the command line's), its MAVLink system id (None: the first one
    heard there), and its receivers."""

    name: Annotated[str, _NAME, Help("each its own")]
    autopilot: Annotated[str | None, _LINK, Help("the autopilot's link; two vehicles may have the same")] = None
    system: Annotated[int | None, SYSTEM_ID, Help("its MAVLink system id")] = None
    receivers: Annotated[
        tuple[ReceiverConfig, ...], ListOf(_Receiver(ReceiverEntry), 1, 16, "receivers"), Help("what it carries")
    ] = field(kw_only=True)


def vehicle_conflicts(scenario: Any) -> Iterator[Violation]:
    """What is wrong between the vehicles of a scenario, or of a file's mapping."""
    vehicles = [(("vehicles", at), vehicle) for at, vehicle in items_of(scenario, "vehicles")]
    yield from duplicates(VehicleConfig, vehicles, "name", "vehicle")
    ports = []
    by_link: dict[Any, list[Any]] = {}
    for path, vehicle in vehicles:
        by_link.setdefault(valid_value(VehicleConfig, vehicle, "autopilot"), []).append((path, vehicle))
        receivers = [((*path, "receivers", at), receiver) for at, receiver in items_of(vehicle, "receivers")]
        yield from duplicates(ReceiverConfig, receivers, "name", "receiver")
        ports += [one for one in receivers if valid_value(ReceiverConfig, one[1], "port") != "pty"]  # each is a new one
    yield from duplicates(ReceiverConfig, ports, "port", "port")
    for shared in by_link.values():
        for path, vehicle in shared if len(shared) > 1 else ():
            if "system" not in vehicle if isinstance(vehicle, dict) else vehicle.system is None:
                yield Violation(
                    "a mapping with system, which tells vehicles on one link apart", "no system", None, path
                )
        yield from duplicates(VehicleConfig, shared, "system", "system")
