"""Several searches, each of its own vehicle: who searches where, who flies to which transmitter, how they keep apart.

Each tells the others where it is, what it flies to and what it has found. Nobody gives orders to another's vehicle:
what is told only changes what the one that hears it does with its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from arva_hil.field.geodesy import LocalFrame
from arva_hil.search.plan import SearchPlan
from arva_hil.search.strategy import Position
from arva_hil.search.strips import Area
from arva_hil.search.team_news import MOST_HEARD, HeardAt, News

LAYER_M: Final = 3.0  # between the heights of neighbours
_LAYERS: Final = 2
_EVERY_S: Final = 0.2  # how often it tells
_OLD_S: Final = 5.0  # without news of it, another one's transmitter and part of the area are free again
_ABSENT_S: Final = 60.0  # from its own first news: then the parts of those that were never heard are free
_NEAR_M: Final = 6.0  # horizontally, and
_LEVEL_M: Final = 2.5  # vertically: nearer to another one it does not fly
_BELOW_M: Final = 8.0  # it does not descend onto one that is less below
_MUCH_NEARER: Final = 0.5  # times as far: it has the transmitter then, whoever flies there
_THERE_M: Final = 2.0  # from where a transmitter was heard


def divide(area: Area, count: int) -> list[Area]:
    """`count` parts of an area side by side, from west to east. Raises ValueError for fewer than one."""
    if count < 1:
        raise ValueError(f"count: {count}, expected 1 or more")
    south, west, north, east = area
    width = (east - west) / count
    return [(south, west + n * width, north, west + (n + 1) * width) for n in range(count)]


@dataclass(frozen=True)
class TeamField:
    """What a team searches: `area` [m] of `frame`, which all of them have in common, in `count` parts."""

    area: Area
    frame: LocalFrame
    count: int

    def seen_from(self, origin: LocalFrame, part: int | None = None) -> Area:
        """The area, or one of its parts, from another origin."""
        north, east, _ = (float(value) for value in self.frame.ned(*origin.lla([0.0, 0.0, 0.0])))
        south_m, west_m, north_m, east_m = self.area if part is None else divide(self.area, self.count)[part]
        return south_m - north, west_m - east, north_m - north, east_m - east


def layered(plan: SearchPlan, number: int) -> SearchPlan:
    """The plan at the height of the vehicle of this number: neighbours differ."""
    higher = LAYER_M * (number % _LAYERS)
    return replace(plan, height=plan.height + higher, take_off=plan.take_off + higher)


class Teammate:
    """Remembers what the other searches have told last. `number`: its own; the lower one goes first in a conflict.

    `send`: passes news on to the others. `field`: what they divide; None: each searches its plan's own area.
    """

    def __init__(self, number: int, send: Callable[[News], None], field: TeamField | None = None) -> None:
        self.number = number
        self._send = send
        self._field = field
        self._origin: LocalFrame | None = None
        self._alt = 0.0  # of its take-off point
        self._part: int | None = number  # that it searches
        self._flown: set[int] = set()
        self._own: set[int] = set()  # transmitters that it has found
        self._visited: set[int] = set()  # whom it did not find where they were heard
        self._began = math.inf
        self._others: dict[int, News] = {}
        self._told: News | None = None
        self._now = -math.inf

    def hear(self, news: News) -> None:
        """Another one has told this."""
        if news.number != self.number:
            self._others[news.number] = news
            self._flown.update(news.flown)

    def tell(
        self,
        now: float,
        lla: tuple[float, float, float],
        *,
        flying: bool,
        hunting: int | None = None,
        hunting_m: float = math.inf,
        found: tuple[int, ...] = (),
        heard: Sequence[HeardAt] = (),
        searching: bool = True,
    ) -> None:
        """Where its own vehicle is and what it does. It is passed on five times a second, and when that changes."""
        self._now = now
        self._began = min(self._began, now)
        self._own.update(found)
        part = self._part if searching else None
        free = searching and self._part is None and hunting is None
        ever, flown = tuple(sorted(self._own)), tuple(sorted(self._flown))
        left = sorted((one for one in heard if not self._is_found(one.id)), key=lambda one: one.metres)[:MOST_HEARD]
        news = News(self.number, now, lla, flying, hunting, ever, part, flown, hunting_m, free, tuple(left))
        told = self._told
        if told is None or replace(told, time_s=now, lla=lla) != news or now - told.time_s >= _EVERY_S:
            self._told = news
            self._send(news)

    def taken(self, id_: int, *, own: bool, metres: float = math.inf) -> bool:
        """Whether a transmitter is another one's: found, or flown to. `own`: it flies there itself.

        `metres`: how near it has heard it. Of two that fly there the one that has heard it twice as near goes on,
        otherwise the lower number.
        """
        hunted = any(self._hunts(other, id_, own=own, metres=metres) for other in self._others.values())
        return hunted or any(id_ in other.found for other in self._others.values())

    def plan(self, plan: SearchPlan, origin: LocalFrame) -> SearchPlan:
        """The plan with the team's area as it is seen from the take-off point."""
        self._origin, self._alt = origin, float(origin.lla([0.0, 0.0, 0.0])[2])
        return plan if self._field is None else replace(plan, area=self._field.seen_from(origin))

    def area(self) -> Area | None:
        """The part that it searches, from its take-off point."""
        if self._field is None or self._origin is None or self._part is None:
            return None
        return self._field.seen_from(self._origin, self._part)

    def done(self) -> None:
        """All strips of its part are flown."""
        if self._part is not None:
            self._flown.add(self._part)
            self._part = None

    def claim(self) -> Area | None:
        """A part that is nobody's, the next one to its own first: from now on it is this one's. None: there is none."""
        left = self._left()
        if left:
            self._part = min(left, key=lambda part: (abs(part - self.number), part))
        return self.area() if left else None

    @property
    def yields(self) -> bool:
        """Whether one with a lower number searches the same part, or it is flown: it is given up."""
        part = self._part
        if part is None:
            return False
        lower = any(other.part == part and other.number < self.number for other in self._alive())
        if lower or part in self._flown:
            self._part = None
        return self._part is None

    @property
    def waits(self) -> bool:
        """Whether others still search parts that they might leave."""
        if self._field is None:
            return False
        return len(self._flown) < self._field.count and bool(self._held())

    def handed(self, position: Position) -> tuple[float, float] | None:
        """Where to fly, north and east of its take-off point, because somebody has heard a transmitter there that
        nobody flies to. Of those whose strips are flown the nearest one goes there, each to one; None: it is not this.
        """
        news = [told for told in (self._told, *self._others.values()) if told]
        every = sorted((one for told in news for one in told.heard), key=lambda one: -one.metres)
        places = {one.id: self._seen(one.lat, one.lon) for one in every if not self._is_someones(one.id)}
        free = {other.number: self._seen(*other.lla[:2]) for other in self._alive() if other.free}
        free[self.number] = position[:2]
        self._visited |= {id_ for id_, place in places.items() if math.dist(place, position[:2]) < _THERE_M}
        pairs = sorted((math.dist(at, places[id_]), number, id_) for number, at in free.items() for id_ in places)
        pairs = [pair for pair in pairs if pair[1] != self.number or pair[2] not in self._visited]
        while pairs:
            _, number, id_ = pairs[0]
            if number == self.number:
                return places[id_]
            pairs = [pair for pair in pairs if pair[1] != number and pair[2] != id_]
        return None

    def forgive(self) -> None:
        """Who was not found where they were heard is looked for there again."""
        self._visited.clear()

    def beside(self, place: tuple[float, float]) -> tuple[float, float]:
        """Where to land, north and east of its take-off point: at a place, but not near another that has landed."""
        for other in self._others.values():
            there = self._seen(*other.lla[:2])
            if not other.flying and (off := math.dist(place, there)) < _NEAR_M:
                north, east = ((place[n] - there[n]) / off if off else 1.0 - n for n in range(2))
                place = there[0] + (_NEAR_M + 1) * north, there[1] + (_NEAR_M + 1) * east
        return place

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

    def _alive(self) -> list[News]:
        return [other for other in self._others.values() if self._now - other.time_s <= _OLD_S]

    def _held(self) -> set[int]:
        """The parts that others search. One that was never heard may still come."""
        assert self._field is not None
        held = {other.part for other in self._alive() if other.part is not None}
        if self._now - self._began < _ABSENT_S:
            held |= set(range(self._field.count)) - self._others.keys() - {self.number}
        return held - self._flown

    def _left(self) -> set[int]:
        if self._field is None:
            return set()
        return set(range(self._field.count)) - self._flown - self._held()

    def _hunts(self, other: News, id_: int, *, own: bool, metres: float) -> bool:
        if other.hunting != id_ or self._now - other.time_s > _OLD_S or metres < _MUCH_NEARER * other.hunting_m:
            return False
        return not own or other.number < self.number or other.hunting_m < _MUCH_NEARER * metres

    def _is_found(self, id_: int) -> bool:
        return id_ in self._own or any(id_ in other.found for other in self._others.values())

    def _is_someones(self, id_: int) -> bool:
        return id_ in self._own or self.taken(id_, own=False)

    def _seen(self, lat: float, lon: float) -> tuple[float, float]:
        """A place from its own take-off point."""
        assert self._origin is not None
        north, east, _ = (float(value) for value in self._origin.ned(lat, lon, self._alt))
        return north, east


class Bus:
    """Passes the news of each search to all others in the same program. `field`: what they divide."""

    def __init__(self, field: TeamField | None = None) -> None:
        self._mates: list[Teammate] = []
        self._field = field

    def join(self) -> Teammate:
        """One more search."""
        mate = Teammate(len(self._mates), self._pass_on, self._field)
        self._mates.append(mate)
        return mate

    def _pass_on(self, news: News) -> None:
        for mate in self._mates:
            mate.hear(news)
