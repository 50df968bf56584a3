"""The field of a team, and its division: a part of the area and a height for each vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from arva_hil.model.field.geodesy import LocalFrame
from arva_hil.search.strategies.strips import Area

_LAYER_M: Final = 3.0  # between the heights of neighbours
_LAYERS: Final = 2


def divide(area: Area, count: int) -> list[Area]:
    """Return `count` parts of an area side by side, from west to east. Raises ValueError for fewer than one."""
    if count < 1:
        raise ValueError(f"count: {count}, expected 1 or more")
    south, west, north, east = area
    width = (east - west) / count
    return [(south, west + n * width, north, west + (n + 1) * width) for n in range(count)]


@dataclass(frozen=True)
class TeamField:
    """The field of a team: `area` [m] in the common `frame`, in `count` parts."""

    area: Area
    frame: LocalFrame
    count: int

    def seen_from(self, origin: LocalFrame, part: int | None = None) -> Area:
        """Return the area, or one of its parts, from another origin."""
        north, east, _ = (float(value) for value in self.frame.ned(*origin.lla([0.0, 0.0, 0.0])))
        south_m, west_m, north_m, east_m = self.area if part is None else divide(self.area, self.count)[part]
        return south_m - north, west_m - east, north_m - north, east_m - east


def layer_m(number: int) -> float:
    """Return the height [m] of the vehicle of this number above the first one: neighbours differ."""
    return _LAYER_M * (number % _LAYERS)
