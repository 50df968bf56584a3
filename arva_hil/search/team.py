"""Several searches, each of its own vehicle: who searches where, who flies to which transmitter, how they keep apart.

Each tells the others where it is, what it flies to and what it has found. Nobody gives orders to another's vehicle:
what is told only changes what the one that hears it does with its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from arva_hil.field.geodesy import LocalFrame
from arva_hil.search.strategy import Position
from arva_hil.search.strips import Area

LAYER_M: Final = 3.0  # between the heights of neighbours
_LAYERS: Final = 2
_EVERY_S: Final = 0.2  # how often it tells
_OLD_S: Final = 5.0  # without news of it, another one's transmitter is free again
_NEAR_M: Final = 6.0  # horizontally, and
_LEVEL_M: Final = 2.5  # vertically: nearer to another one it does not fly
_BELOW_M: Final = 8.0  # it does not descend onto one that is less below


def divide(area: Area, count: int) -> list[Area]:
    """`count` parts of an area side by side, from west to east. Raises ValueError for fewer than one."""
    if count < 1:
        raise ValueError(f"count: {count}, expected 1 or more")
    south, west, north, east = area
    width = (east - west) / count
    return [(south, west + n * width, north, west + (n + 1) * width) for n in range(count)]


def layer_m(number: int) -> float:
    """How much higher the vehicle of this number flies than the lowest ones [m]: neighbours differ."""
    return LAYER_M * (number % _LAYERS)


@dataclass(frozen=True)
class News:
    """What one search tells the others. `number`: its own; `time_s`: on the common clock.

    `lla`: of its vehicle, degrees, degrees, metres AMSL; `flying`: whether it is in the air. `hunting`: the id of the
    transmitter it flies to, or None; `found`: the ids of those that it has found.
    """

    number: int
    time_s: float
    lla: tuple[float, float, float]
    flying: bool
    hunting: int | None = None
    found: tuple[int, ...] = ()


class Teammate:
    """Remembers what the other searches have told last. `number`: its own; the lower one goes first in a conflict.

    `send`: passes news on to the others.
    """

    def __init__(self, number: int, send: Callable[[News], None]) -> None:
        self.number = number
        self._send = send
        self._others: dict[int, News] = {}
        self._told: News | None = None
        self._now = -math.inf

    def hear(self, news: News) -> None:
        """Another one has told this."""
        if news.number != self.number:
            self._others[news.number] = news

    def tell(
        self,
        now: float,
        lla: tuple[float, float, float],
        *,
        flying: bool,
        hunting: int | None = None,
        found: tuple[int, ...] = (),
    ) -> None:
        """Where its own vehicle is and what it does. It is passed on five times a second, and when that changes."""
        self._now = now
        news, told = News(self.number, now, lla, flying, hunting, found), self._told
        changed = told is None or (told.flying, told.hunting, told.found) != (flying, hunting, found)
        if told is None or changed or now - told.time_s >= _EVERY_S:
            self._told = news
            self._send(news)

    def taken(self, id_: int, *, own: bool) -> bool:
        """Whether a transmitter is another one's: found, or flown to. `own`: it flies there itself.

        Of two that fly there the lower number goes on.
        """
        return any(id_ in other.found or self._hunts(other, id_, own=own) for other in self._others.values())

    def apart(self, frame: LocalFrame, position: Position, velocity: Position) -> Position:
        """The velocity without what would lead to another vehicle. Position NED [m] in `frame`; velocity NED [m/s]."""
        north, east, down = velocity
        for other in self._others.values():
            n, e, d = (float(value) for value in frame.ned(*other.lla))
            to_n, to_e, below = n - position[0], e - position[1], d - position[2]
            distance = math.hypot(to_n, to_e)
            if distance >= _NEAR_M:
                continue
            if down > 0 and 0 < below < (_BELOW_M if other.flying else math.inf):
                down = 0.0
            if other.flying and abs(below) < _LEVEL_M and distance > 0:
                towards = max(0.0, (north * to_n + east * to_e) / distance)
                north, east = north - towards * to_n / distance, east - towards * to_e / distance
        return north, east, down

    def _hunts(self, other: News, id_: int, *, own: bool) -> bool:
        if other.hunting != id_ or self._now - other.time_s > _OLD_S:
            return False
        return not own or other.number < self.number


class Bus:
    """Passes the news of each search to all others in the same program."""

    def __init__(self) -> None:
        self._mates: list[Teammate] = []

    def join(self) -> Teammate:
        """One more search."""
        mate = Teammate(len(self._mates), self._pass_on)
        self._mates.append(mate)
        return mate

    def _pass_on(self, news: News) -> None:
        for mate in self._mates:
            mate.hear(news)
