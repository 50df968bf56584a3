"""Sorts of values that several keys share. Importing this does not import pydantic."""

from __future__ import annotations

from typing import Final, Literal, get_args

from arva_hil.config.sorts import Number, Numbers, Whole
from arva_hil.config.text import Named
from arva_hil.config.words import FRAMES_HZ, LARGEST_SEED
from arva_hil.registry import FORMATS

Triple = tuple[float, float, float]
NoiseKind = Literal["uniform", "gaussian", "off"]
Pose = Literal["estimate", "truth"]

NOISE_KINDS: Final[tuple[NoiseKind, ...]] = get_args(NoiseKind)

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
WORLD_POINT: Final = Numbers(WORLD, WORLD, WORLD)
BODY_POINT: Final = Numbers(*[Number(-100, 100, unit="m")] * 3)
SPAN: Final = Number(0, 1_000_000, "seconds", above=True, unit="s")
