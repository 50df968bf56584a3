"""The transmitters of a scenario: where each is, at rest or moving, how it lies and how strong it is."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import InitVar, field
from itertools import pairwise
from typing import Annotated, Any, Final, Literal, get_args

from arva_hil.config.kinds import (
    ALTITUDE,
    BODY_POINT,
    LATITUDE,
    LONGITUDE,
    SYSTEM_ID,
    TRANSMITTER_ID,
    WORLD,
    WORLD_POINT,
    Triple,
)
from arva_hil.config.mapping_keys import first
from arva_hil.config.marks import Help, NotAKey, Since
from arva_hil.config.mistake import Mistake, Mistakes
from arva_hil.config.receiver import ATTITUDE
from arva_hil.config.sorts import Listed, Number, Numbers
from arva_hil.config.tables import right, table
from arva_hil.config.text import Word

Frame = Literal["enu", "ned"]
End = Literal["stay", "loop"]
Waypoint = tuple[float, float, float, float]  # seconds, then metres north, east, down (or as the file's frame has it)

PLACES: Final = "enu ned lla path follows"


@table()
class Lla:
    """WGS-84 latitude and longitude in degrees, altitude in metres AMSL."""

    lat: Annotated[float, LATITUDE, Help("WGS-84")]
    lon: Annotated[float, LONGITUDE, Help("WGS-84")]
    alt: Annotated[float, ALTITUDE, Help("above mean sea level")]


class _LlaList(Numbers):
    """In a file a list."""

    def read(self, value: Any) -> Any:
        return value if isinstance(value, Lla) else Lla(*super().read(value))


class _Waypoints(Listed):
    """Waypoints of which each is later than the one before."""

    def read(self, value: Any) -> tuple[Any, ...]:
        mistakes: list[Mistake] = []
        points: dict[int, Any] = {}
        try:
            points = dict(enumerate(super().read(value)))
        except Mistakes as error:
            mistakes += error.every
            points = dict(self._right(value))
        for (_, before), (at, point) in pairwise(points.items()):
            if point[0] <= before[0]:
                found = f"a point at {point[0]:g} s"
                mistakes.append(Mistake(f"later than the point before ({before[0]:g} s)", found, where=(at,)))
        if mistakes:
            raise Mistakes(mistakes)
        return tuple(points.values())

    def _right(self, items: Any) -> Iterator[tuple[int, Any]]:
        for at, item in enumerate(items):
            with suppress(Mistake, Mistakes):
                yield at, self.item.read(item)


_WAYPOINTS: Final = _Waypoints(
    Numbers(Number(0, 1_000_000, unit="s"), WORLD, WORLD, WORLD), 1, 10_000, "waypoints", unit="s, m, m, m"
)


@table("frame", "points")
class Path:
    """Timed waypoints, straight between them: `points_ned` (s, north, east, down in metres from the datum), at times
    from the start of the run that rise. Behind the last the transmitter stays there, or goes on with the first one.

    A file has `frame` and `points` instead. Raises ValueError without points, or if the times do not rise.
    """

    points_ned: Annotated[tuple[Waypoint, ...], _WAYPOINTS, NotAKey()] = ()
    frame: InitVar[Annotated[Frame | None, Word(get_args(Frame)), Help("the axes of the points")]] = field(
        default=None, kw_only=True
    )
    points: InitVar[
        Annotated[tuple[Waypoint, ...] | None, _WAYPOINTS, Help("[t, x, y, z] each, in time; straight between them")]
    ] = field(default=None, kw_only=True)
    end: Annotated[End, Word(get_args(End)), Help("what comes behind the last point")] = "stay"

    def __post_init__(self, frame: Frame | None, points: tuple[Waypoint, ...] | None) -> None:
        if points is not None:
            ned = [(t, y, x, 0.0 - z) if frame == "enu" else (t, x, y, z) for t, x, y, z in points]
            object.__setattr__(self, "points_ned", tuple(ned))
        if not self.points_ned:
            raise ValueError("a path has at least one point")


@table()
class Follows:
    """Another MAVLink system that carries the transmitter, `offset` from it in its body FRD, metres."""

    system: Annotated[int, SYSTEM_ID, Help("a vehicle heard on any link")]
    offset: Annotated[Triple, BODY_POINT, Help("from that vehicle's position, in its body FRD")] = (0.0, 0.0, 0.0)


@table(PLACES)
class Transmitter:
    """A buried beacon, its place as given: `ned` (metres from the datum), `lla`, `path` or `follows`; the others are
    None. `enu` is a way to give `ned`.

    `attitude`: roll, pitch, yaw in degrees, FRD → NED; the dipole is the x axis. `strength`: κ‖m‖ relative to
    the reference transmitter. Raises ValueError unless exactly one place is given.
    """

    id: Annotated[int, TRANSMITTER_ID, Help("each its own")]
    enu: InitVar[Annotated[Triple | None, WORLD_POINT, Help("east, north, up from the datum")]] = field(
        default=None, kw_only=True
    )
    ned: Annotated[Triple | None, WORLD_POINT, Help("north, east, down from the datum")] = None
    lla: Annotated[
        Lla | None,
        _LlaList(LATITUDE, LONGITUDE, ALTITUDE, unit="°, °, m AMSL"),
        Help("latitude, longitude, altitude AMSL"),
    ] = None
    attitude: Annotated[Triple, ATTITUDE, Help("FRD to NED; the dipole is the x axis")] = (0.0, 0.0, 0.0)
    strength: Annotated[float, Number(0, 1000, above=True), Help("relative to the reference transmitter")] = 1.0
    path: Annotated[Path | None, Since(2), Help("where it is when")] = None
    follows: Annotated[Follows | None, Since(2), Help("which vehicle carries it")] = None

    def __post_init__(self, enu: Triple | None) -> None:
        if enu is not None and self.ned is None:
            east, north, up = enu
            object.__setattr__(self, "ned", (north, east, 0.0 - up))
        elif enu is not None:
            raise ValueError("a transmitter has one place: both enu and ned are given")
        if sum(place is not None for place in (self.ned, self.lla, self.path, self.follows)) != 1:
            raise ValueError("a transmitter has either ned or lla, path or follows")


def same_ids(transmitters: Sequence[Any]) -> Iterator[Mistake]:
    """Ids that are there again, in the mappings of a file or what is like them."""
    seen: dict[int, Any] = {}
    for at, mapping in enumerate(transmitters):
        number = right(Transmitter, mapping, "id") if isinstance(mapping, Mapping) and "id" in mapping else None
        if number in seen:
            yield Mistake("an id of its own", f"id {number} again{first(seen[number])}", where=(at, "id"))
        elif number is not None:
            seen[number] = mapping["id"]
