"""Additions of `spec: 2`: the error of the autopilot's estimate, several vehicles and receivers."""

from collections.abc import Iterator, Sequence
from dataclasses import InitVar, fields
from typing import Any, Final

from arva_hil.config.common import FORMAT, SEED, SYSTEM_ID, Triple
from arva_hil.config.constraints import ListOf, Number, Numbers, Text
from arva_hil.config.errors import Violation, wrong
from arva_hil.config.receiver import ReceiverOptions
from arva_hil.config.tables import Table, TableOf, duplicates, items_of, key, lacks
from arva_hil.links.url import AddressError, parse
from arva_hil.registry import over_mavlink

_NAME: Final = Text("a name of letters, digits, _, - and .", r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


class _LinkText(Text):
    """A connection string."""

    def read(self, value: Any) -> str:
        text = super().read(value)
        try:
            parse(text)
        except AddressError as error:
            raise wrong(f"{self} such as {error.cure}" if error.cure else str(self), error.found) from None
        return text


_LINK: Final = _LinkText("a connection string")
_SIGMA: Final = Number(0, 1000, unit="m")
_TAU: Final = Number(0, 1_000_000, above=True, unit="s")


class RandomWalk(Table):
    """A random walk about 0 (Gauss-Markov), on each axis."""

    sigma_m: float = key(_SIGMA, "standard deviation on each axis", default=0.0)
    tau_s: float = key(_TAU, "correlation time", default=60.0)


class NavigationError(Table):
    """The difference of the vehicle's true pose from the reported one: true pose = reported pose + this.

    - `bias_ned`: metres.
    - `walk_sigma_m`, `walk_tau_s`: standard deviation on each axis and correlation time of a random walk; a file has
      them in a mapping `walk`.
    - `heading_deg`: added to the yaw.
    - `latency_s`: age of the reported pose.
    """

    bias_ned: Triple = key(
        Numbers(*[Number(-10_000, 10_000, unit="m")] * 3, names="north, east, down"),
        "north, east, down",
        default=(0.0, 0.0, 0.0),
    )
    walk: InitVar[RandomWalk | None] = key(help="a random walk", default=None, kw_only=True)
    walk_sigma_m: float = key(_SIGMA, default=RandomWalk.sigma_m)
    walk_tau_s: float = key(_TAU, default=RandomWalk.tau_s)
    heading_deg: float = key(Number(-180, 180, unit="°"), "added to the yaw", default=0.0)
    latency_s: float = key(Number(0, 10, unit="s"), "age of the reported pose", default=0.0)

    def __post_init__(self, walk: RandomWalk | None) -> None:
        if walk is not None:
            object.__setattr__(self, "walk_sigma_m", walk.sigma_m)
            object.__setattr__(self, "walk_tau_s", walk.tau_s)

    def file_keys(self) -> dict[str, Any]:
        """Return the keys with another form in files than in Python."""
        return {"walk": {"sigma_m": self.walk_sigma_m, "tau_s": self.walk_tau_s}}


class ReceiverEntry(ReceiverOptions):
    """One receiver of a vehicle as a file has it: its own keys beside those of `receiver`."""

    name: str = key(_NAME, "unlike the vehicle's other receivers", kw_only=True)
    port: str | None = key(
        _LINK, "connection string for its frames; none for formats inside MAVLink", default=None, kw_only=True
    )
    format: str = key(FORMAT, "of its frames", default="binary", kw_only=True)
    seed: int = key(
        SEED,
        "of its noise and faults; default: the scenario's plus the number of receivers before it",
        default=1,
        kw_only=True,
    )

    @classmethod
    def conflicts(cls, of: Any) -> Iterator[Violation]:
        yield from super().conflicts(of)
        if of.format is None:  # a wrong value, already reported
            return
        if over_mavlink(of.format) and not lacks(of, "port"):
            yield Violation(
                "none, because they go over the autopilot's own link",
                f"a port for frames of the format {of.format}",
                None,
                ("port",),
                at_key=True,
            )
        elif not over_mavlink(of.format) and lacks(of, "port"):
            yield Violation(f"a mapping with port, because frames of the format {of.format} go there", "no port")


class ReceiverConfig(Table):
    """One receiver of a vehicle.

    `port`: the link of its frames; None: the autopilot's link. `output_format`: the format of the frames.

    Raises ValueError for a missing port, or a port that the format does not use.
    """

    name: str = key(_NAME)
    port: str | None = key(_LINK)
    receiver: ReceiverOptions = key(default=ReceiverOptions())
    output_format: str = key(FORMAT, default="binary")
    seed: int = key(SEED, default=1)

    def __post_init__(self) -> None:
        if (self.port is None) == (not over_mavlink(self.output_format)):
            has = "no port" if self.port is None else "a port"
            raise ValueError(f"receiver {self.name} has {has} and the format {self.output_format}")


class _Receiver(TableOf):
    """A ReceiverEntry in a file, a ReceiverConfig in Python."""

    def read(self, value: Any) -> ReceiverConfig:
        if isinstance(value, ReceiverConfig):
            return value
        entry: ReceiverEntry = super().read(value)
        return ReceiverConfig(
            entry.name,
            entry.port,
            ReceiverOptions(**{key.name: getattr(entry, key.name) for key in fields(ReceiverOptions)}),
            entry.format,
            entry.seed,
        )

    def plain(self, value: ReceiverConfig, spec: int) -> Any:
        own = {"name": value.name, "port": value.port, "format": value.output_format, "seed": value.seed}
        options = TableOf(ReceiverOptions).plain(value.receiver, spec)
        return {key: item for key, item in own.items() if item is not None} | options


class VehicleConfig(Table):
    """A vehicle and its receivers.

    `autopilot`: the link of its autopilot; None: the command line's. `system`: its MAVLink system id; None: the first
    vehicle on that link.
    """

    name: str = key(_NAME, "each its own")
    autopilot: str | None = key(_LINK, "the autopilot's link; two vehicles may have the same", default=None)
    system: int | None = key(SYSTEM_ID, "its MAVLink system id", default=None)
    receivers: tuple[ReceiverConfig, ...] = key(
        ListOf(_Receiver(ReceiverEntry), 1, 16, "receivers"), "what it carries", kw_only=True
    )


def vehicle_conflicts(vehicles: Sequence[tuple[tuple[str | int, ...], Any]]) -> Iterator[Violation]:
    """Yield the conflicts between the vehicles of a scenario, each with its path."""
    yield from duplicates(vehicles, "name", "vehicle")
    ports = []
    by_link: dict[Any, list[Any]] = {}
    for path, vehicle in vehicles:
        by_link.setdefault(vehicle.autopilot, []).append((path, vehicle))
        receivers = [((*path, *at), receiver) for at, receiver in items_of(vehicle, "receivers")]
        yield from duplicates(receivers, "name", "receiver")
        ports += [one for one in receivers if one[1].port != "pty"]  # each `pty` is a new one
    yield from duplicates(ports, "port", "port")
    for shared in by_link.values():
        for path, vehicle in shared if len(shared) > 1 else ():
            if lacks(vehicle, "system"):
                yield Violation(
                    "a mapping with system, the key that separates vehicles on one link", "no system", None, path
                )
        yield from duplicates(shared, "system", "system")
