"""The transmitters of a scenario: where each is and how it sends, what lies between, and what the vehicle adds."""

from collections.abc import Iterator, Mapping
from dataclasses import InitVar, field
from typing import Annotated, Any, Final, Literal, get_args

from arva_hil.config.common import (
    ALTITUDE,
    BODY_POINT,
    LATITUDE,
    LONGITUDE,
    SYSTEM_ID,
    TRANSMITTER_ID,
    WORLD,
    WORLD_POINT,
    Attitude,
    Triple,
)
from arva_hil.config.constraints import ListOf, Number, Numbers, Text, Word
from arva_hil.config.errors import ConstraintError, Violation
from arva_hil.config.tables import Help, NotAKey, Since, table, valid_value

KeyingKind = Literal["modern", "modern-tight", "old-digital", "analogue", "norm-weak", "norm-strong"]
DipoleKind = Literal["static", "full"]

_NOISE: Final = Number(0, 1_000_000, unit="nA/m")


@table()
class KeyingOptions:
    """When a transmitter sends. What is None is drawn from its class, by the scenario's seed and its id.

    Raises ValueError for a period that is not longer than the pulse.
    """

    kind: Annotated[KeyingKind, Word(get_args(KeyingKind)), Help("the class of sets it is of")] = "modern"
    period_s: Annotated[
        float | None, Number(0.05, 60, unit="s"), Help("from pulse to pulse; without it one of the class")
    ] = None
    pulse_s: Annotated[float | None, Number(0.001, 10, unit="s"), Help("length; without it that of the class")] = None
    phase_s: Annotated[
        float | None, Number(0, 60, unit="s"), Help("start of a pulse, from the start of the run; without it random")
    ] = None
    jitter_s: Annotated[float | None, Number(0, 1, unit="s"), Help("standard deviation of each pulse's start")] = None
    carrier_hz: Annotated[
        float | None, Number(-1000, 1000, unit="Hz"), Help("offset from 457 kHz; without it one of the class")
    ] = None
    leak_db: Annotated[float | None, Number(-200, 0, unit="dB"), Help("carrier in the pauses, relative to a pulse")] = (
        None
    )
    from_s: Annotated[
        float | None, Number(0, 1_000_000, unit="s"), Help("sends from then on: switched on, or back from searching")
    ] = None
    battery: Annotated[
        float, Number(0, 1), Help("charge at the start; below 0.2 the output falls, by 3 dB at most")
    ] = 1.0
    battery_life_h: Annotated[float, Number(0, 100_000, above=True, unit="h"), Help("from full to empty")] = 200.0
    temperature_c: Annotated[
        float, Number(-60, 60, unit="°C"), Help("the carrier of an analogue set falls by 1 Hz a degree below 20")
    ] = 20.0

    @classmethod
    def conflicts(cls, holder: Any) -> Iterator[Violation]:
        kind, period_s, pulse_s = (valid_value(cls, holder, name) for name in ("kind", "period_s", "pulse_s"))
        if kind is None or (period_s is None and pulse_s is None):
            return
        from arva_hil.field.keying import KEYING_CLASSES  # slow to import

        usual = KEYING_CLASSES[kind]
        shortest = usual.period_s - usual.spread_s if period_s is None else period_s
        pulse_s = usual.pulse_s if pulse_s is None else pulse_s
        if shortest <= pulse_s:
            key = "pulse_s" if period_s is None else "period_s"
            found = f"a pulse of {pulse_s:g} s in a period of {shortest:g} s"
            yield Violation("a period above the pulse", found, path=(key,))


@table()
class MediumOptions:
    """What lies between transmitters and receivers."""

    dipole: Annotated[
        DipoleKind, Word(get_args(DipoleKind)), Help("the near field alone, or with induction and radiation")
    ] = "static"
    snow_conductivity_s_m: Annotated[
        float, Number(0, 10, unit="S/m"), Help("of what covers them: dry snow 1e-5, wet 1e-4, moist soil 1e-2")
    ] = 0.0
    snow_permittivity: Annotated[float, Number(1, 100), Help("of that, relative: dry snow 1.8, wet 3")] = 1.8
    surface_m: Annotated[float, Number(-10_000, 10_000, unit="m"), Help("its surface, down from the datum")] = 0.0


@table()
class VehicleNoiseOptions:
    """What the vehicle's motors add to a receiver's noise."""

    motors: Annotated[
        tuple[Triple, ...], ListOf(BODY_POINT, 1, 16, "places", unit="m"), Help("body FRD, of each motor")
    ]
    motor_na_m: Annotated[float, _NOISE, Help("of one motor at full throttle, 0.5 m away")] = 5.2
    line_na_m: Annotated[float, _NOISE, Help("of one controller's harmonic in the band, 0.5 m away, always")] = 0.0
    full_current_a: Annotated[
        float | None,
        Number(0, 10_000, above=True, unit="A"),
        Help("of all motors at full throttle; then their load is what current they draw"),
    ] = None


Frame = Literal["enu", "ned"]
End = Literal["stay", "loop"]
PROFILE: Final = Text("the name of a profile")
Waypoint = tuple[float, float, float, float]  # seconds, then metres north, east, down (or as the file's frame has it)


@table()
class Lla:
    """WGS-84 latitude and longitude in degrees, altitude in metres AMSL."""

    lat: Annotated[float, LATITUDE, Help("WGS-84")]
    lon: Annotated[float, LONGITUDE, Help("WGS-84")]
    alt: Annotated[float, ALTITUDE, Help("above mean sea level")]


class _LlaList(Numbers):
    def read(self, value: Any) -> Any:
        return value if isinstance(value, Lla) else Lla(*super().read(value))

    def plain(self, value: Lla, spec: int) -> Any:
        return [value.lat, value.lon, value.alt]


_WAYPOINT: Final = Numbers(Number(0, 1_000_000, unit="s"), WORLD, WORLD, WORLD)
_WAYPOINTS: Final = ListOf(_WAYPOINT, 1, 10_000, "waypoints", unit="s, m, m, m")


@table(required="frame points")
class Path:
    """Timed waypoints, straight between them: `points_ned` (s, north, east, down in metres from the datum), at times
    from the start of the run that rise. After the last one the transmitter stays there, or starts again at the first.

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

    def file_keys(self) -> dict[str, Any]:
        """What a file has otherwise than Python."""
        return {"frame": "ned", "points": [list(point) for point in self.points_ned]}

    @classmethod
    def conflicts(cls, holder: Any) -> Iterator[Violation]:
        key = "points" if isinstance(holder, Mapping) else "points_ned"
        points = holder.get(key) if isinstance(holder, Mapping) else holder.points_ned
        before = None
        for at, item in enumerate(points if isinstance(points, list | tuple) else ()):
            try:
                time_s = _WAYPOINT.read(item)[0]
            except ConstraintError:
                continue
            if before is not None and time_s <= before:
                expected = f"later than the point before ({before:g} s)"
                yield Violation(expected, f"a point at {time_s:g} s", path=(key, at))
            before = time_s


@table()
class Follows:
    """Another MAVLink system that carries the transmitter, `offset` from it in its body FRD, metres."""

    system: Annotated[int, SYSTEM_ID, Help("a vehicle heard on any link")]
    offset: Annotated[Triple, BODY_POINT, Help("from that vehicle's position, in its body FRD")] = (0.0, 0.0, 0.0)


@table(one_of="enu ned lla path follows")
class Transmitter:
    """A buried beacon, its place as given: `ned` (metres from the datum), `lla`, `path` or `follows`; the others are
    None. `enu` is a way to give `ned`.

    `attitude`: roll, pitch, yaw in degrees, FRD → NED; the dipole is the x axis. `strength`: κ‖m‖ relative to
    the reference transmitter. `profile` is of files alone. Raises ValueError unless exactly one place is given.
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
    attitude: Annotated[Triple, Attitude(), Help("FRD to NED; the dipole is the x axis")] = (0.0, 0.0, 0.0)
    strength: Annotated[float, Number(0, 1000, above=True), Help("relative to the reference transmitter")] = 1.0
    path: Annotated[Path | None, Since(2), Help("where it is when")] = None
    follows: Annotated[Follows | None, Since(2), Help("which vehicle carries it")] = None
    keying: Annotated[KeyingOptions | None, Since(2), Help("when it sends; only receivers of pulses care")] = None
    depth_m: Annotated[
        float | None, Number(-100, 100, unit="m"), Since(2), Help("below the ground there; its place has the height 0")
    ] = None
    profile: InitVar[
        Annotated[str | None, PROFILE, Since(2), Help("a file whose keys it takes over, or builtin:NAME")]
    ] = field(default=None, kw_only=True)

    @classmethod
    def conflicts(cls, holder: Any) -> Iterator[Violation]:
        if valid_value(cls, holder, "depth_m") is None:
            return
        expected = "0 as its height beside depth_m, which counts from the ground"
        for key in "enu", "ned", "lla":
            place = valid_value(cls, holder, key)
            height = place.alt if isinstance(place, Lla) else place[2] if place else 0.0
            if height:
                yield Violation(expected, f"{height:g}", path=(key, 2))
        for key in "path", "follows":
            if valid_value(cls, holder, key) is not None:
                yield Violation("enu, ned or lla beside depth_m", key, path=(key,), at_key=True)

    def __post_init__(self, enu: Triple | None, profile: str | None) -> None:
        if sum(place is not None for place in (enu, self.ned, self.lla, self.path, self.follows)) != 1:
            raise ValueError("a transmitter has either ned or lla, path or follows")
        if enu is not None:
            object.__setattr__(self, "ned", (enu[1], enu[0], 0.0 - enu[2]))
