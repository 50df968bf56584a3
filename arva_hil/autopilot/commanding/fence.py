"""The fence of an autopilot, by its parameters: how far from home and how high the vehicle may fly."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

FENCE_PARAMETERS: Final = {  # by: the autopilot is PX4
    False: ("FENCE_ENABLE", "FENCE_TYPE", "FENCE_ALT_MAX", "FENCE_RADIUS", "FENCE_TOTAL"),
    True: ("GF_ACTION", "GF_MAX_HOR_DIST", "GF_MAX_VER_DIST"),
}
_HEIGHT, _CIRCLE, _POLYGONS = 1, 2, 4  # bits of FENCE_TYPE


class FenceLimit(NamedTuple):
    """One limit of a fence: its parameter, and the value [m]."""

    parameter: str
    metres: float


class Fence(NamedTuple):
    """The limits of a fence, None where there is none."""

    radius: FenceLimit | None = None
    """Horizontally, from home."""
    height: FenceLimit | None = None
    """Above home."""
    points: int = 0
    """The number of the points of polygons and other circles, whose places are not known."""


def fence_of(values: Mapping[str, float], *, px4: bool) -> Fence:
    """Return the fence by the parameters that the autopilot reported."""
    if px4:
        on = int(values.get("GF_ACTION", 0))
        return Fence(_limit(values, "GF_MAX_HOR_DIST", on), _limit(values, "GF_MAX_VER_DIST", on))
    kinds = int(values.get("FENCE_TYPE", 0)) if values.get("FENCE_ENABLE") else 0
    points = int(values.get("FENCE_TOTAL", 0)) if kinds & _POLYGONS else 0
    circle = _limit(values, "FENCE_RADIUS", kinds & _CIRCLE)
    return Fence(circle, _limit(values, "FENCE_ALT_MAX", kinds & _HEIGHT), points)


def _limit(values: Mapping[str, float], name: str, on: int) -> FenceLimit | None:
    metres = values.get(name, 0.0) if on else 0.0
    return FenceLimit(name, metres) if metres > 0 else None
