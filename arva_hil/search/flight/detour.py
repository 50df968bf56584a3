"""The check that a vehicle follows its set-points; if it does not, one detour, then the end of the search.

The horizontal velocity ordered is compared with the motion reported. Velocities are complex numbers, north + i·east.
Over a window the motion is fitted as a multiple of the order. The factor is 1 for a vehicle that follows, 0 for one
that stands, i for one that flies 90° to the right of the order.
"""

from __future__ import annotations

import cmath
import math
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from arva_hil.events import Event
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.events.searches import SetPointsNotFollowed
from arva_hil.search.strategies.strategy import Position

_ASIDE_S: Final = 6.0  # longer than the check needs
_WINDOW_S: Final = 5.0  # of an order that the vehicle has had time to follow
_LEAST: Final = 2.5  # m²/s, the sum of squared orders: a slower order needs a longer window
_OLDEST_S: Final = 30.0
_GAP_S: Final = 1.0  # between two observations: the check begins again
_ACCELERATION: Final = 1.0  # m/s², of the slowest vehicle to be expected
_SETTLED: Final = 0.5  # share of the order: the slowest vehicle deviates by less
_SLOW: Final = 0.2  # share of the order, and m/s: by its velocity, a slower vehicle does not follow
_DRIFT: Final = 0.5  # the same by its position, which drifts
_ASTRAY: Final = 0.5  # share of the order, and m/s: a vehicle that does not follow and is faster flies elsewhere


class Deviation(NamedTuple):
    """A vehicle that does not follow: what it was ordered to fly in the window [s, m], and what it flew [m].

    `off_deg`: the direction flown, to the right of the one ordered; None if the vehicle hardly moves.
    """

    seconds: float
    ordered_m: float
    flown_m: float
    off_deg: float | None


class _Sample(NamedTuple):
    """One step of the comparison of commanded and flown velocity.

    The fields are its end and length [s], the integral of the squared command [m²/s], and the integrals of the
    conjugate command times the motion: by the reported velocity, and by the position.
    """

    time_s: float
    seconds: float
    squared: float
    products: tuple[complex, complex]


class SetPointCheck:
    """Remembers the window, the last order, and the velocity of the slowest vehicle to be expected."""

    def __init__(self) -> None:
        self._window: deque[_Sample] = deque()
        self._last: tuple[float, complex, complex] | None = None  # time, order and place at the last observation
        self._slowest = 0j  # the velocity of a vehicle that accelerates by no more than `_ACCELERATION`

    def restart(self) -> None:
        """Forget everything: the vehicle was not steered, or the deviation was reported."""
        self._window.clear()
        self._last = None

    def observe(self, time_s: float, order: Position, position: Position, velocity: Position) -> Deviation | None:
        """Use the `order` sent now, and the position and velocity reported now.

        Returns the deviation if the vehicle does not follow.
        """
        place, moving = complex(*position[:2]), complex(*velocity[:2])
        last, self._last = self._last, (time_s, complex(*order[:2]), place)
        if last is None or time_s - last[0] > _GAP_S:
            self._window.clear()
            self._slowest = moving
            return None
        before_s, ordered, there = last
        seconds = time_s - before_s
        lag = ordered - self._slowest
        self._slowest += lag * min(1.0, _ACCELERATION * seconds / max(abs(lag), 1e-9))
        if abs(lag) <= _SETTLED * abs(ordered):
            along = ordered.conjugate()
            products = along * moving * seconds, along * (place - there)
            self._window.append(_Sample(time_s, seconds, abs(ordered) ** 2 * seconds, products))
        return self._judge(time_s)

    def _judge(self, time_s: float) -> Deviation | None:
        window = self._window
        seconds = squared = 0.0
        for sample in window:
            seconds += sample.seconds
            squared += sample.squared
        while window:
            first = window[0]
            without = seconds - first.seconds, squared - first.squared
            if time_s - first.time_s <= _OLDEST_S and not _is_enough(*without):
                break
            window.popleft()
            seconds, squared = without
        if not _is_enough(seconds, squared):
            return None
        by_velocity, by_position = (sum(values) / squared for values in zip(*(s.products for s in window), strict=True))
        speed = math.sqrt(squared / seconds)
        scale = min(1.0, 1.0 / speed)
        if by_velocity.real >= _SLOW * scale or by_position.real >= _DRIFT * scale:
            return None
        astray = min(abs(by_velocity), abs(by_position)) > _ASTRAY * scale
        off_deg = math.degrees(cmath.phase(by_velocity)) if astray else None
        return Deviation(seconds, speed * seconds, abs(by_velocity) * speed * seconds, off_deg)


def _is_enough(seconds: float, squared: float) -> bool:
    """Return True if a window is long enough [s], and the sum of its squared commands large enough [m²/s]."""
    return seconds >= _WINDOW_S - 1e-6 and squared >= _LEAST


class Detour:
    """Remembers the detour and its end."""

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
        """Use the `order` sent now, and the motion reported now. Return the reason to end the search, or None."""
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
    """Return the velocity perpendicular to the order, to the side of the take-off point."""
    north, east, _ = order
    side = 1.0 if east * position[0] - north * position[1] >= 0 else -1.0
    return -side * east, side * north
