"""The transmitters of a scenario, their keying, the medium, and the noise of the vehicle."""

from collections.abc import Iterator
from dataclasses import InitVar
from typing import Any, Final, Literal, get_args

from arva_hil.config.common import (
    ALTITUDE,
    BODY_POINT,
    ENU_POINT,
    LATITUDE,
    LONGITUDE,
    NED_POINT,
    SYSTEM_ID,
    TRANSMITTER_ID,
    WORLD,
    Attitude,
    Triple,
)
from arva_hil.config.constraints import ListOf, Number, Numbers, Text, Word
from arva_hil.config.errors import Violation
from arva_hil.config.tables import Table, items_of, key

KeyingKind = Literal["modern", "modern-tight", "old-digital", "analogue", "norm-weak", "norm-strong"]
DipoleKind = Literal["static", "full"]

_NOISE: Final = Number(0, 1_000_000, unit="nA/m")
Level = tuple[float, float]  # load 0…1, nA/m


def _seconds(low: float, high: float) -> Number:
    return Number(low, high, unit="s")


class KeyingOptions(Table):
    """The times at which a transmitter sends. Values that are None are drawn by its class, the seed and its id.

    Raises ValueError for a period without a pause, or a jitter of a twelfth of the pause or more.
    """

    kind: KeyingKind = key(Word(get_args(KeyingKind)), "the class of transmitter", default="modern")
    period_s: float | None = key(_seconds(0.05, 60), "from pulse to pulse; default: drawn by the class", default=None)
    pulse_s: float | None = key(_seconds(0.001, 10), "length of a pulse; default: the class's", default=None)
    phase_s: float | None = key(
        _seconds(0, 60), "start of a pulse, from the start of the run; default: random", default=None
    )
    jitter_s: float | None = key(_seconds(0, 1), "standard deviation of each pulse's start", default=None)
    carrier_hz: float | None = key(
        Number(-1000, 1000, unit="Hz"), "offset from 457 kHz; default: drawn by the class", default=None
    )
    leak_db: float | None = key(Number(-200, 0, unit="dB"), "carrier in the pauses, relative to a pulse", default=None)
    from_s: float | None = key(
        _seconds(0, 1_000_000), "sends from then on: switched on, or back from searching", default=None
    )
    battery: float = key(Number(0, 1), "charge at the start; below 0.2 the output falls, by 3 dB at most", default=1.0)
    battery_life_h: float = key(Number(0, 100_000, above=True, unit="h"), "from full to empty", default=200.0)
    temperature_c: float = key(
        Number(-60, 60, unit="°C"), "the carrier of an analogue set falls by 1 Hz a degree below 20", default=20.0
    )

    @classmethod
    def conflicts(cls, of: Any) -> Iterator[Violation]:
        if of.kind is None or (of.period_s is None and of.pulse_s is None and of.jitter_s is None):
            return
        from arva_hil.model.field.keying import JITTER_S, KEYING_CLASSES, jitter_limit_s  # slow to import

        usual = KEYING_CLASSES[of.kind]
        period_s = usual.shortest_s if of.period_s is None else of.period_s
        pulse_s = usual.pulse_s if of.pulse_s is None else of.pulse_s
        jitter_s = JITTER_S if of.jitter_s is None else of.jitter_s
        where = "pulse_s" if of.period_s is None else "period_s"
        if period_s <= pulse_s:
            found = f"a pulse of {pulse_s:g} s in a period of {period_s:g} s"
            yield Violation("a period above the pulse", found, path=(where,))
        elif jitter_s >= jitter_limit_s(period_s, pulse_s):
            found = f"a jitter of {jitter_s:g} s and a pause of {period_s - pulse_s:.4g} s"
            where = where if of.jitter_s is None else "jitter_s"
            yield Violation("a jitter below a twelfth of the pause", found, path=(where,))


class MediumOptions(Table):
    """The medium between transmitters and receivers."""

    dipole: DipoleKind = key(
        Word(get_args(DipoleKind)), "the near field alone, or with induction and radiation", default="static"
    )
    snow_conductivity_s_m: float = key(
        Number(0, 10, unit="S/m"), "conductivity: dry snow 1e-5, wet 1e-4, moist soil 1e-2", default=0.0
    )
    snow_permittivity: float = key(Number(1, 100), "relative permittivity: dry snow 1.8, wet 3", default=1.8)
    surface_m: float = key(Number(-10_000, 10_000, unit="m"), "its surface, down from the datum", default=0.0)


class VehicleNoiseOptions(Table):
    """The noise that the vehicle's motors add to that of a receiver."""

    motors: tuple[Triple, ...] = key(
        ListOf(BODY_POINT, 1, 16, "places", unit="m"), "body FRD, of each motor; needed without levels", default=()
    )
    motor_na_m: float = key(_NOISE, "of one motor at full throttle, 0.5 m away", default=5.2)
    line_na_m: float = key(_NOISE, "of one controller's harmonic in the band, 0.5 m away, always", default=0.0)
    levels: tuple[Level, ...] = key(
        ListOf(Numbers(Number(0, 1), _NOISE, names="load, nA/m"), 2, 100, "levels"),
        "measured at the receiver: [load 0…1, nA/m], instead of motors",
        default=(),
    )
    full_current_a: float | None = key(
        Number(0, 10_000, above=True, unit="A"),
        "of all motors at full throttle; their load is then computed from their current",
        default=None,
    )

    @classmethod
    def conflicts(cls, of: Any) -> Iterator[Violation]:
        if of.motors is not None and of.levels is not None and bool(of.motors) == bool(of.levels):
            yield Violation("motors, or levels", "both" if of.motors else "neither")
        before = None
        for path, (load, _) in items_of(of, "levels"):
            if before is not None and load <= before:
                yield Violation(f"a load above the one before ({before:g})", f"{load:g}", path=path)
            before = load


Frame = Literal["enu", "ned"]
End = Literal["stay", "loop"]
PROFILE: Final = Text("the name of a profile")
Waypoint = tuple[float, float, float, float]  # seconds, then metres north, east, down (or as the file's frame has it)


class Lla(Table):
    """WGS-84 latitude and longitude in degrees, altitude in metres AMSL."""

    lat: float = key(LATITUDE, "WGS-84")
    lon: float = key(LONGITUDE, "WGS-84")
    alt: float = key(ALTITUDE, "above mean sea level")


class _LlaList(Numbers):
    def read(self, value: Any) -> Any:
        return value if isinstance(value, Lla) else Lla(*super().read(value))

    def plain(self, value: Lla, spec: int) -> Any:
        return [value.lat, value.lon, value.alt]


_WAYPOINT: Final = Numbers(Number(0, 1_000_000, unit="s"), WORLD, WORLD, WORLD, names="seconds, then a place")
_WAYPOINTS: Final = ListOf(_WAYPOINT, 1, 10_000, "waypoints", unit="s, m, m, m")


class Path(Table, required="frame points"):
    """Timed waypoints with straight lines between them.

    `points_ned`: each (s, north, east, down in metres from the datum). The times count from the start of the run, and
    increase. `end`: after the last point the transmitter stays there, or starts again at the first.

    A file has `frame` and `points` instead. Raises ValueError without points, or if the times do not increase.
    """

    points_ned: tuple[Waypoint, ...] = key(_WAYPOINTS, default=())
    frame: InitVar[Frame | None] = key(Word(get_args(Frame)), "the axes of the points", default=None, kw_only=True)
    points: InitVar[tuple[Waypoint, ...] | None] = key(
        _WAYPOINTS, "[t, x, y, z] each, in time; straight between them", default=None, kw_only=True
    )
    end: End = key(Word(get_args(End)), "after the last point", default="stay")

    def __post_init__(self, frame: Frame | None, points: tuple[Waypoint, ...] | None) -> None:
        if points is not None:
            object.__setattr__(
                self,
                "points_ned",
                tuple((t, y, x, 0.0 - z) if frame == "enu" else (t, x, y, z) for t, x, y, z in points),
            )
        if not self.points_ned:
            raise ValueError("a path has at least one point")

    def file_keys(self) -> dict[str, Any]:
        """Return the keys with another form in files than in Python."""
        return {"frame": "ned", "points": [list(point) for point in self.points_ned]}

    @classmethod
    def conflicts(cls, of: Any) -> Iterator[Violation]:
        where = "points" if of.points else "points_ned"
        before = None
        for path, (time_s, *_) in items_of(of, where):
            if before is not None and time_s <= before:
                yield Violation(f"later than the point before ({before:g} s)", f"a point at {time_s:g} s", path=path)
            before = time_s


class Follows(Table):
    """Another MAVLink system that carries the transmitter, `offset` from it in its body FRD, metres."""

    system: int = key(SYSTEM_ID, "a vehicle on any of the links")
    offset: Triple = key(BODY_POINT, "from that vehicle's position, in its body FRD", default=(0.0, 0.0, 0.0))


STRENGTH: Final = Number(0, 1000, above=True)


class Transmitter(Table, one_of="enu ned lla path follows"):
    """A buried transmitter.

    Its place is given by one of `ned` (metres from the datum), `lla`, `path` and `follows`; the others are None. `enu`
    is an alternative to `ned`.

    - `attitude`: roll, pitch, yaw in degrees, FRD → NED; the dipole is the x axis.
    - `strength`: κ‖m‖ relative to the reference transmitter.
    - `profile`: a key of files only.

    Raises ValueError unless exactly one place is given.
    """

    id: int = key(TRANSMITTER_ID, "each its own")
    enu: InitVar[Triple | None] = key(ENU_POINT, "east, north, up from the datum", default=None, kw_only=True)
    ned: Triple | None = key(NED_POINT, "north, east, down from the datum", default=None)
    lla: Lla | None = key(
        _LlaList(LATITUDE, LONGITUDE, ALTITUDE, unit="°, °, m AMSL", names="latitude, longitude, altitude"),
        "latitude, longitude, altitude AMSL",
        default=None,
    )
    attitude: Triple = key(Attitude(), "FRD to NED; the dipole is the x axis", default=(0.0, 0.0, 0.0))
    strength: float = key(STRENGTH, "relative to the reference transmitter", default=1.0)
    path: Path | None = key(help="timed waypoints", since=2, default=None)
    follows: Follows | None = key(help="the vehicle that carries it", since=2, default=None)
    keying: KeyingOptions | None = key(help="when it sends; only for the model `pulsed`", since=2, default=None)
    depth_m: float | None = key(
        Number(-100, 100, unit="m"), "depth below the ground; its place has the height 0", since=2, default=None
    )
    profile: InitVar[str | None] = key(
        PROFILE, "the file with default keys, or builtin:NAME", since=2, default=None, kw_only=True
    )

    @classmethod
    def conflicts(cls, of: Any) -> Iterator[Violation]:
        if of.depth_m is None:
            return
        expected = "0 as its height beside depth_m, which counts from the ground"
        for name in "enu", "ned", "lla":
            place = getattr(of, name)
            at = (0.0, 0.0, place.alt) if isinstance(place, Lla) else place
            height = at[2] if at else 0.0
            if height:
                yield Violation(expected, f"{height:g}", path=(name, 2))
        for name in "path", "follows":
            if getattr(of, name) is not None:
                yield Violation("enu, ned or lla beside depth_m", name, path=(name,), at_key=True)

    def __post_init__(self, enu: Triple | None, profile: str | None) -> None:
        if (enu, self.ned, self.lla, self.path, self.follows).count(None) != 4:
            raise ValueError("a transmitter has either ned or lla, path or follows")
        if enu is not None:
            object.__setattr__(self, "ned", (enu[1], enu[0], 0.0 - enu[2]))
