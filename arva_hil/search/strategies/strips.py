"""The strips flown before the first signal: parallel lanes over an area, as rescuers search."""

from __future__ import annotations

import math
from typing import Final

from arva_hil.search.strategies.strategy import STILL, Position, Velocity, towards

_REACHED_M: Final = 1.0

Area = tuple[float, float, float, float]  # south, west, north, east of the take-off point, m


class Strips:
    """The lanes of a search, and those that were flown.

    They are parallel to the longer side of `area`, at most `width` apart and half of that from the edges, and begin at
    the corner nearest to `position`. `lanes`: their ends, in order. `twice`: they are flown again,
    since the last place found.

    Raises ValueError for an empty area, or a width or speed that is not positive.
    """

    twice = False

    def __init__(self, area: Area, speed: float, position: Position, *, width: float = 40.0) -> None:
        south, west, north, east = area
        if not (south < north and west < east and width > 0 and speed > 0):
            raise ValueError(f"area {area}, width {width:g}, speed {speed:g}: nothing to fly over")
        self.lanes = _lanes(area, width, position)
        self._speed = speed
        self._next = 0
        self._back: tuple[float, float] | None = None  # where to return to the lane that was left

    @property
    def flown(self) -> bool:
        """True if the last lane was flown."""
        return self._next == len(self.lanes)

    @property
    def exhausted(self) -> bool:
        """True if no lane is left to fly, and none can be added."""
        return self.flown

    def velocity(self, time_s: float, position: Position) -> Velocity:
        """Return the velocity to the next end of a lane; STILL after the last one."""
        if self._back and not self._reaches(position, self._back):
            return towards(position, self._back, self._speed)
        self._back = None
        while not self.flown and self._reaches(position, self.lanes[self._next]):
            self._next += 1
        return STILL if self.flown else towards(position, self.lanes[self._next], self._speed)

    def _reaches(self, position: Position, place: tuple[float, float]) -> bool:
        return math.dist(position[:2], place) < _REACHED_M

    def resume(self, position: Position) -> None:
        """Return to the lane that was left, at its point nearest to `position`."""
        self._back = None
        if self.flown or self._next % 2 == 0:
            return
        (a_n, a_e), (b_n, b_e) = self.lanes[self._next - 1 : self._next + 1]
        along = (position[0] - a_n) * (b_n - a_n) + (position[1] - a_e) * (b_e - a_e)
        share = min(max(along / math.dist((a_n, a_e), (b_n, b_e)) ** 2, 0.0), 1.0)
        self._back = a_n + share * (b_n - a_n), a_e + share * (b_e - a_e)

    def again(self) -> Velocity:
        """Begin with the first lane again."""
        self._next, self._back, self.twice = 0, None, True
        return STILL


def _lanes(area: Area, width: float, position: Position) -> list[tuple[float, float]]:
    south, west, north, east = area
    along_north = north - south >= east - west
    (low, high), (left, right) = ((south, north), (west, east)) if along_north else ((west, east), (south, north))
    at = position if along_north else position[1::-1]
    count = math.ceil((right - left) / width)
    spacing = (right - left) / count
    across = [left + (lane + 0.5) * spacing for lane in range(count)]
    if abs(at[1] - across[-1]) < abs(at[1] - across[0]):
        across.reverse()
    near, far = (low, high) if abs(at[0] - low) <= abs(at[0] - high) else (high, low)
    ends = []
    for place in across:
        ends += [(near, place), (far, place)]
        near, far = far, near
    return ends if along_north else [(along, place)[::-1] for along, place in ends]
