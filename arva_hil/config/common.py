"""Constraints that several tables share, and ranges that commands offer as options too."""

from collections.abc import Mapping
from typing import Any, Final, Literal, get_args

from arva_hil.config.constraints import Named, Number, Numbers, Whole
from arva_hil.config.nodes import NEWEST_SPEC
from arva_hil.config.ranges import FRAMES_HZ, LARGEST_SEED
from arva_hil.config.tables import Table, TableOf, key
from arva_hil.registry import FORMATS

Triple = tuple[float, float, float]
NoiseKind = Literal["uniform", "gaussian", "off"]
Pose = Literal["estimate", "truth"]

NOISE_KINDS: Final[tuple[NoiseKind, ...]] = get_args(NoiseKind)

SPEC: Final = Whole(1, NEWEST_SPEC, "a spec")
FORMAT: Final = Named(FORMATS)
RATE_HZ: Final = Number(*FRAMES_HZ, unit="Hz")
SEED: Final = Whole(0, LARGEST_SEED)
TRANSMITTER_ID: Final = Whole(0, 254)
SYSTEM_ID: Final = Whole(1, 255)
LATITUDE: Final = Number(-90, 90, "a latitude", unit="°")
LONGITUDE: Final = Number(-180, 180, "a longitude", unit="°")
ALTITUDE: Final = Number(-500, 9000, "an altitude", unit="m AMSL")
ANGLE: Final = Number(-360, 360, unit="°")
WORLD: Final = Number(-1_000_000, 1_000_000, unit="m")
ENU_POINT: Final = Numbers(WORLD, WORLD, WORLD, names="east, north, up")
NED_POINT: Final = Numbers(WORLD, WORLD, WORLD, names="north, east, down")
BODY_POINT: Final = Numbers(*[Number(-100, 100, unit="m")] * 3, names="forward, right, down")
SPAN: Final = Number(0, 1_000_000, "seconds", above=True, unit="s")


class Angles(Table):
    """An attitude as a file has it."""

    roll: float = key(ANGLE, "about x", default=0.0)
    pitch: float = key(ANGLE, "about y", default=0.0)
    yaw: float = key(ANGLE, "about z", default=0.0)


class Attitude(TableOf):
    """Roll, pitch and yaw: a mapping in a file, a tuple in Python."""

    unit = ANGLE.unit

    def __init__(self) -> None:
        super().__init__(Angles)

    def read(self, value: Any) -> Any:
        if not isinstance(value, Mapping) and not hasattr(value, "node"):
            return Numbers(ANGLE, ANGLE, ANGLE, names="roll, pitch, yaw").read(value)
        angles = super().read(value)
        return angles.roll, angles.pitch, angles.yaw

    def plain(self, value: Any, spec: int) -> Any:
        return super().plain(Angles(*value), spec)
