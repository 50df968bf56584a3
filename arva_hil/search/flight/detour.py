"""The answer to a vehicle that does not follow its set-points: another way once, then the end of the search."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from arva_hil.autopilot.commanding.set_point_check import SetPointCheck
from arva_hil.events import Event
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.events.searches import SetPointsNotFollowed
from arva_hil.search.strategies.strategy import Position

_ASIDE_S: Final = 6.0  # longer than the check needs


class Detour:
    """Remembers the one way aside, and until when it is flown."""

    def __init__(self, emit: Callable[[Event], None]) -> None:
        self._emit = emit
        self._check = SetPointCheck()
        self._aside: tuple[float, float] | None = None  # north, east, m/s
        self._until_s = -math.inf

    def restart(self) -> None:
        """Forget the motion so far: the vehicle was not steered."""
        self._check.restart()

    def around(self, time_s: float, wanted: Position) -> Position:
        """Return the velocity to order instead of the one `wanted` by the search."""
        if self._aside is None or time_s >= self._until_s or not any(wanted[:2]):
            return wanted
        return *self._aside, wanted[2]

    def observe(self, time_s: float, order: Position, position: Position, velocity: Position) -> Reason | None:
        """Use the `order` that leaves now, and the motion reported. Return the reason to end the search, or None."""
        deviation = self._check.observe(time_s, order, position, velocity)
        if deviation is None:
            return None
        if deviation.off_deg is not None or self._aside:
            return because(Why.NOT_FOLLOWED, **deviation._asdict())
        self._emit(SetPointsNotFollowed(time_s, deviation.seconds, deviation.ordered_m, deviation.flown_m))
        self._check.restart()
        self._aside, self._until_s = _sideways(order, position), time_s + _ASIDE_S
        return None


def _sideways(order: Position, position: Position) -> tuple[float, float]:
    """The velocity perpendicular to the order, to the side of the take-off point."""
    north, east, _ = order
    side = 1.0 if east * position[0] - north * position[1] >= 0 else -1.0
    return -side * east, side * north
