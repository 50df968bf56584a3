"""Several searches, each of its own vehicle: their parts of the area, their transmitters, and their distances.

Each reports its place, its transmitter and what it has found. A search commands its own vehicle only.

No vehicle flies, descends or lands where another one is. Each search limits only its own vehicle. Of two that want the
same place, one has precedence and the other one makes room. All make room for a silent vehicle in the air: it continues
for some seconds with its last velocity, then it may climb, descend, or hover for the rest of the search.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from arva_hil.model.field.geodesy import LocalFrame
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import STILL, Position, Velocity, towards
from arva_hil.search.strategies.strips import Area, Strips
from arva_hil.search.team.team_tunnel import MOST_HEARD, HeardAt, News

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


NEAR_M: Final = 6.0  # least horizontal distance to another vehicle
_LEVEL_M: Final = 2.5  # least vertical distance to another vehicle
_BELOW_M: Final = 8.0  # no descent onto a vehicle that is less below
_OVER_M: Final = 4.0  # the same, if that vehicle has landed
_ROOM_M: Final = 9.0  # make room up to this horizontal distance
_OVERDUE_S: Final = 1.0  # after this time without news a vehicle may be nearer, and at any height
_COASTS_S: Final = 3.0  # an autopilot follows its last velocity for this time: GUID_TIMEOUT
_UP_M: Final = 4.0  # no take-off within this horizontal distance below another one; a team may stand 5 m apart
_ABOVE_M: Final = 1.0  # a vehicle that is less above takes off at the same time
_CLOSE_M: Final = 4.5  # nearer, each makes room for the other, which may not have received its news
_DIRECTIONS: Final = 24  # radius of the search for a free place
_ROUNDING: Final = 1e-9  # m/s
_BRAKES: Final = 0.5  # m/s², braking: half of that of the slowest vehicle to be expected, because news are late

Direction = tuple[float, float]  # north, east


class Near(NamedTuple):
    """Another vehicle relative to the own one: direction (a unit vector), distance and height below [m].

    `apart_m`: the least horizontal distance. `overdue`: it is in the air, and its news are late.
    """

    other: News
    north: float
    east: float
    metres: float
    below: float
    apart_m: float = NEAR_M
    overdue: bool = False

    @property
    def room_m(self) -> float:
        """Horizontal distance up to which room is made for it."""
        return self.apart_m if self.overdue else _ROOM_M

    @property
    def level(self) -> bool:
        return self.other.flying and (self.overdue or abs(self.below) < _LEVEL_M)

    @property
    def fastest(self) -> float:
        """Highest speed towards it [m/s] from which both can stop in time, if it is level."""
        return math.sqrt(1.0 + _BRAKES * max(self.metres - self.apart_m, 0.0))

    @property
    def in_the_way_down(self) -> bool:
        below = self.overdue or 0 < self.below < (_BELOW_M if self.other.flying else _OVER_M)
        return below and self.metres < NEAR_M

    @property
    def in_the_way_up(self) -> bool:
        """Seen from the ground."""
        if self.overdue:
            return self.metres < self.apart_m
        return self.other.flying and self.below < -_ABOVE_M and self.metres < _UP_M

    @property
    def coming_down(self) -> bool:
        return self.other.flying and self.other.ended and -_BELOW_M < self.below < 0


def apart_m(other: News, age_s: float, speed: float) -> float:
    """Return the least horizontal distance to another vehicle with news of this age. `speed`: of the search, m/s."""
    if not other.flying or age_s <= _OVERDUE_S:
        return NEAR_M
    return NEAR_M + speed * min(age_s, _COASTS_S)


def kept_apart(
    near: Sequence[Near], room_for: Iterable[Near], velocity: Position, speed: float, edges: Iterable[Direction] = ()
) -> Position:
    """Return the velocity (NED, m/s) without the parts that lead to another vehicle.

    It also leads away from vehicles that have precedence, at `speed` from 3 m closer on. `edges`: directions in which
    the vehicle makes no room.
    """
    wanted, down = velocity[:2], velocity[2]
    for one in room_for:
        north, east = _not_towards(wanted, (one.north, one.east))
        away = speed * min((one.room_m - one.metres) / (_ROOM_M - NEAR_M), 1.0)
        wanted = north - away * one.north, east - away * one.east
    barred = [(one.north, one.east) for one in near if one.level and one.metres < one.apart_m]
    north, east = _clear(wanted, [*barred, *edges])
    if any(one.in_the_way_down for one in near):
        down = min(down, 0.0)
    most = [one.fastest / max(_along((north, east), (one.north, one.east)), 1e-9) for one in near if one.level]
    share = min(1.0, speed / max(math.hypot(north, east), 1e-9), *most)
    return north * share, east * share, down


def clear_of(place: tuple[float, float], taken: list[tuple[tuple[float, float], float]]) -> tuple[float, float]:
    """Return the place nearest to a goal that keeps off the `taken` ones, each with its radius [m]."""
    around = [math.tau * n / _DIRECTIONS for n in range(_DIRECTIONS)]
    ring = [(n + (off + 1) * math.cos(a), e + (off + 1) * math.sin(a)) for (n, e), off in taken for a in around]
    clear = [at for at in (place, *ring) if all(math.dist(at, there) >= off for there, off in taken)]
    return min(clear, key=lambda at: math.dist(at, place), default=place)


def _seen(others: Iterable[tuple[News, float]], frame: LocalFrame, position: Position, speed: float) -> Iterator[Near]:
    for other, age_s in others:
        north, east, down = (float(there) - here for there, here in zip(frame.ned(*other.lla), position, strict=True))
        metres = math.hypot(north, east)
        towards = (north / metres, east / metres) if metres else (0.0, 0.0)
        overdue = other.flying and age_s > _OVERDUE_S
        yield Near(other, *towards, metres, down, apart_m(other, age_s, speed), overdue)


def _clear(velocity: Direction, barred: Sequence[Direction]) -> Direction:
    """Return the velocity nearest to this one that leads in none of the barred directions."""
    every = [velocity, *(_not_towards(velocity, one) for one in barred), (0.0, 0.0)]
    clear = [way for way in every if all(_along(way, one) < _ROUNDING for one in barred)]
    return min(clear, key=lambda way: math.dist(way, velocity))


def _not_towards(velocity: Direction, there: Direction) -> Direction:
    towards = max(0.0, _along(velocity, there))
    return velocity[0] - towards * there[0], velocity[1] - towards * there[1]


def _along(velocity: Direction, there: Direction) -> float:
    return velocity[0] * there[0] + velocity[1] * there[1]


def _rank(news: News) -> tuple[bool, bool, float, int]:
    """Return the order of precedence.

    A vehicle whose search has ended may land and goes first, then one that searches, then one that waits. Of two that
    search, the one that received its transmitter nearer goes first; of two equal ones, the one with the lower number.
    """
    return not news.ended, news.free, news.hunting_m, news.number


_EVERY_S: Final = 0.18  # between its reports: a step of a search, less its jitter
_OLD_S: Final = 5.0  # after this silence, a search's transmitter and part of the area are free again
_ABSENT_S: Final = 60.0  # after its own first news: the parts of searches that sent nothing are free
_MUCH_NEARER: Final = 0.5  # a search at this share of the distance gets the transmitter
THERE_M: Final = 2.0  # radius about a place at which a transmitter was received
_OUTSIDE_M: Final = 20.0  # limit outside of the area: other vehicles neither push nor send it farther


class OtherNews:
    """Remembers the `newest` news of the other searches, by their numbers. `now`: the time of the own last report."""

    def __init__(self) -> None:
        self.newest: dict[int, News] = {}
        self.now = -math.inf

    def skip(self, now: float, seconds: float) -> None:
        """Handle a delay of this length until now, in which no news could be received: it does not count as silence."""
        for number, other in self.newest.items():
            self.newest[number] = replace(other, time_s=min(other.time_s + seconds, now))

    def age_s(self, other: News) -> float:
        return math.inf if other.lost else self.now - other.time_s

    def is_old(self, other: News) -> bool:
        return self.age_s(other) > _OLD_S

    @property
    def alive(self) -> list[News]:
        return [other for other in self.newest.values() if not self.is_old(other)]

    @property
    def ages(self) -> list[tuple[News, float]]:
        """The news, each with its age."""
        return [(other, self.age_s(other)) for other in self.newest.values()]


class OwnSearch(NamedTuple):
    """The search of one vehicle of a team, once it has taken off."""

    origin: LocalFrame
    """The take-off point."""
    speed: float
    """The highest [m/s]."""
    area: Area
    """That of all, from the take-off point."""


class Teammate:
    """One search of a team. `number`: its own; the lower one goes first in a conflict. `others`: their news.

    `send`: passes news on to the others. `field`: the area that they divide.
    """

    def __init__(self, number: int, send: Callable[[News], None], field: TeamField) -> None:
        self.number = number
        self.others = OtherNews()
        self._send = send
        self._field = field
        self._search: OwnSearch | None = None
        self._raised_m = 0.0  # above the lowest layer
        self._part: int | None = number  # that it searches
        self._flown: set[int] = set()
        self._own: set[int] = set()  # transmitters that it has found for sure
        self._visited: set[int] = set()  # transmitters that it did not find at the places of reception
        self._began = math.inf
        self._told: News | None = None

    def on_news(self, news: News) -> None:
        """Use the news of another search."""
        if news.number != self.number:
            self.others.newest[news.number] = news
            self._flown.update(news.flown)

    def report(
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
        lost: bool = False,
    ) -> None:
        """Pass on the place and the task of its own vehicle, five times a second and when they change."""
        self.others.now = now
        self._began = min(self._began, now)
        self._own = set(found)
        part = self._part if searching else None
        free = searching and self._part is None and hunting is None
        ever, flown = tuple(sorted(self._own)), tuple(sorted(self._flown))
        left = sorted((one for one in heard if not self._is_found(one.id)), key=lambda one: one.metres)[:MOST_HEARD]
        news = News(self.number, now, lla, flying, hunting, ever, part, flown, hunting_m, free, tuple(left), lost)
        told = self._told
        if told is None or replace(told, time_s=now, lla=lla) != news or now - told.time_s >= _EVERY_S:
            self._told = news
            self._send(news)

    def taken(self, id_: int, *, own: bool, metres: float = math.inf) -> bool:
        """Return True if a transmitter is another one's: found, or flown to. `own`: it flies there itself.

        `metres`: its smallest distance. Of two that fly there the one with half the distance goes on,
        otherwise the lower number.
        """
        hunted = any(self._hunts(other, id_, own=own, metres=metres) for other in self.others.newest.values())
        return hunted or any(id_ in other.found for other in self.others.newest.values())

    def layered(self, plan: SearchPlan) -> SearchPlan:
        """Return the plan at the height of its own layer."""
        self._raised_m = layer_m(self.number)
        return replace(plan, height=plan.height + self._raised_m, take_off=plan.take_off + self._raised_m)

    def plan(self, plan: SearchPlan, origin: LocalFrame) -> SearchPlan:
        """Return the plan with the team's area as it is seen from the take-off point."""
        plan = replace(plan, area=self._field.seen_from(origin))
        self._search = OwnSearch(origin, plan.speed, plan.area)
        return plan

    def area(self) -> Area | None:
        """Return the part that it searches, from its take-off point."""
        if self._search is None or self._part is None:
            return None
        return self._field.seen_from(self._search.origin, self._part)

    def done(self) -> None:
        """Mark the strips of its part as flown."""
        if self._part is not None:
            self._flown.add(self._part)
            self._part = None

    def claim(self) -> Area | None:
        """Take a free part, the nearest to its own first. Returns None if there is none."""
        left = self._left()
        if left:
            self._part = min(left, key=lambda part: (abs(part - self.number), part))
        return self.area() if left else None

    @property
    def yields(self) -> bool:
        """True if it gives up another one's part: the part is flown, or its owner or a lower number searches it too.

        It never gives up its own part: news may be wrong.
        """
        part = self._part
        if part is None or part == self.number:
            return False
        searching = [other.number for other in self.others.alive if other.part == part]
        if part in self._flown or any(number == part or number < self.number for number in searching):
            self._part = None
        return self._part is None

    @property
    def waits(self) -> bool:
        """True if others still search parts that they may leave."""
        return len(self._flown) < self._field.count and bool(self._held())

    def handed(self, position: Position) -> tuple[float, float] | None:
        """Return the place to fly to, north and east of its take-off point, or None.

        It is the place of a transmitter that was received and to which no vehicle flies. Of the vehicles whose strips
        are flown the nearest one goes there, each to one place.
        """
        news = [told for told in (self._told, *self.others.newest.values()) if told]
        every = sorted((one for told in news for one in told.heard), key=lambda one: -one.metres)
        left = [one for one in every if one.id not in self._own and not self.taken(one.id, own=False)]
        places = {one.id: self._seen(one.lat, one.lon) for one in left}
        places = {id_: place for id_, place in places.items() if not self._edges(place)}
        free = {other.number: self._seen(*other.lla[:2]) for other in self.others.alive if other.free}
        free[self.number] = position[:2]
        self._visited |= {
            id_
            for id_, place in places.items()
            if math.dist(place, position[:2]) < THERE_M or self.bars(place, position)
        }
        pairs = sorted((math.dist(at, places[id_]), number, id_) for number, at in free.items() for id_ in places)
        pairs = [pair for pair in pairs if pair[1] != self.number or pair[2] not in self._visited]
        while pairs:
            _, number, id_ = pairs[0]
            if number == self.number:
                return places[id_]
            pairs = [pair for pair in pairs if pair[1] != number and pair[2] != id_]
        return None

    def forgive(self) -> None:
        """Allow places to be visited again where nothing was found."""
        self._visited.clear()

    def beside(self, place: tuple[float, float]) -> tuple[float, float]:
        """Return the point to land, north and east of its take-off point: at a place, or beside vehicles near it.

        These make no room: they have landed, are silent, or descend themselves and have precedence.
        """
        taken = [
            other
            for other in self.others.newest.values()
            if not other.flying or self.others.is_old(other) or (other.ended and self._goes_first(other))
        ]
        return clear_of(place, [(self._seen(*other.lla[:2]), self._apart_m(other)) for other in taken])

    @property
    def lost(self) -> dict[int, tuple[float, float, float]]:
        """Return the vehicles in the air whose reports have stopped, by their numbers.

        Each has north and east of its take-off point, and the distance kept from it [m].
        """
        if self._search is None:
            return {}
        gone = [other for other in self.others.newest.values() if other.flying and self.others.is_old(other)]
        return {other.number: (*self._seen(*other.lla[:2]), self._apart_m(other)) for other in gone}

    def bars(self, place: tuple[float, float], position: Position) -> bool:
        """Return True if a lost vehicle, which may be at a place (north, east), keeps it away from there."""
        return any(
            math.dist(place, (north, east)) < metres > math.dist(position[:2], (north, east)) - 1.0
            for north, east, metres in self.lost.values()
        )

    def height(self, wanted_m: float, height_m: float, position: Position) -> float:
        """Return the height to fly at: `wanted_m`, that of its layer, or lower.

        It is lower once all vehicles of the layer below have ended and are on the ground: one without news may fly.
        The vehicle, now at `height_m`, does not descend above another one: it flies on as high as it is.
        """
        newest = self.others.newest
        below = [
            newest.get(number) for number in {*range(self._field.count), *newest} if layer_m(number) < self._raised_m
        ]
        if below and all(other is not None and other.ended and not other.flying for other in below):
            wanted_m -= self._raised_m
        return max(wanted_m, height_m) if self.above_another(position) else wanted_m

    def above_another(self, position: Position) -> bool:
        """Return True if another one is below its position, NED [m] from its take-off point: it must not land there."""
        return any(near.in_the_way_down for near in self._neighbours(position))

    @property
    def under_another(self) -> bool:
        """True if another one is above its vehicle, which is on the ground, or may be: it must not take off."""
        speed = self._search.speed if self._search else 1.0
        if self._told is None:
            return False
        near = _seen(self.others.ages, LocalFrame(*self._told.lla), (0.0, 0.0, 0.0), speed)
        return any(one.in_the_way_up for one in near)

    def apart(self, position: Position, velocity: Position, speed: float) -> Position:
        """Return the velocity without the part that leads to another vehicle, at most `speed` [m/s] horizontally.

        The vehicle makes room for one at its height that has precedence, and for one that descends. Both vectors are
        NED from its take-off point.
        """
        near = self._neighbours(position)
        room_for = [one for one in near if self._makes_room(one)]
        edges = [way for way in self._edges(position[:2]) if velocity[0] * way[0] + velocity[1] * way[1] <= 0]
        return kept_apart(near, room_for, velocity, speed, edges)

    def _edges(self, place: tuple[float, float]) -> list[tuple[float, float]]:
        """Return the directions in which a place is too far outside of the area."""
        assert self._search is not None
        (north, east), (south, west, most_north, most_east) = place, self._search.area
        outside = {
            (1.0, 0.0): north - most_north,
            (-1.0, 0.0): south - north,
            (0.0, 1.0): east - most_east,
            (0.0, -1.0): west - east,
        }
        return [way for way, metres in outside.items() if metres > _OUTSIDE_M]

    def _neighbours(self, position: Position) -> list[Near]:
        own = self._search
        return list(_seen(self.others.ages, own.origin, position, own.speed)) if own else []

    def _makes_room(self, one: Near) -> bool:
        first, close = self._goes_first(one.other), one.metres < _CLOSE_M
        there = (one.level and (first or one.overdue or close)) or (one.coming_down and first)
        return there and one.metres < one.room_m

    def _goes_first(self, other: News) -> bool:
        return self._told is not None and _rank(other) < _rank(self._told)

    def _apart_m(self, other: News) -> float:
        assert self._search is not None
        return apart_m(other, self.others.age_s(other), self._search.speed)

    def _held(self) -> set[int]:
        """Return the parts that others search. A search that sent nothing so far may still come."""
        held = {other.part for other in self.others.alive if other.part is not None}
        if self.others.now - self._began < _ABSENT_S:
            held |= set(range(self._field.count)) - self.others.newest.keys() - {self.number}
        return held - self._flown

    def _left(self) -> set[int]:
        return set(range(self._field.count)) - self._flown - self._held()

    def _hunts(self, other: News, id_: int, *, own: bool, metres: float) -> bool:
        if other.hunting != id_ or self.others.is_old(other) or metres < _MUCH_NEARER * other.hunting_m:
            return False
        return not own or other.number < self.number or other.hunting_m < _MUCH_NEARER * metres

    def _is_found(self, id_: int) -> bool:
        return id_ in self._own or any(id_ in other.found for other in self.others.newest.values())

    def _seen(self, lat: float, lon: float) -> tuple[float, float]:
        """Return a place from the own take-off point."""
        assert self._search is not None
        origin = self._search.origin
        alt = float(origin.lla([0.0, 0.0, 0.0])[2])
        north, east, _ = (float(value) for value in origin.ned(lat, lon, alt))
        return north, east


class Bus:
    """Passes the news of each search to all others in the same program. `field`: the area that they divide."""

    def __init__(self, field: TeamField) -> None:
        self._mates: list[Teammate] = []
        self._field = field

    def join(self) -> Teammate:
        """Add a search."""
        mate = Teammate(len(self._mates), self._pass_on, self._field)
        self._mates.append(mate)
        return mate

    def _pass_on(self, news: News) -> None:
        for mate in self._mates:
            mate.on_news(news)


def strips_of(team: Teammate | None, plan: SearchPlan, position: Position) -> Strips:
    """Return strips over a plan's area; in a team over its own part of it, then over those that others have left."""
    if team is not None and (area := team.area()) is not None:
        return TeamStrips(area, plan, position, team)
    return Strips(plan.area, plan.speed, position, width=plan.strip_width)


class TeamStrips(Strips):
    """The strips of a team's search.

    After its own part, a drone flies to transmitters that others received and that no drone flies to, then over parts
    that other drones leave. While others still search, it hovers and waits for either.
    """

    def __init__(self, area: Area, plan: SearchPlan, position: Position, team: Teammate) -> None:
        super().__init__(area, plan.speed, position, width=plan.strip_width)
        self._plan = plan
        self._team = team
        self._handed = False

    @property
    def exhausted(self) -> bool:
        return self.flown and not self._handed and not self._team.waits

    def velocity(self, time_s: float, position: Position) -> Velocity:
        velocity = super().velocity(time_s, position)
        if self.flown:
            self._team.done()
        elif self._team.yields:
            self._next = len(self.lanes)
        if not self.flown:
            return velocity
        place = self._team.handed(position)
        self._handed = place is not None
        if place is not None:
            return towards(position, place, self._plan.speed)
        if (area := self._team.claim()) is None:
            return STILL
        Strips.__init__(self, area, self._plan.speed, position, width=self._plan.strip_width)
        return super().velocity(time_s, position)

    def _reaches(self, position: Position, place: tuple[float, float]) -> bool:
        return super()._reaches(position, place) or self._team.bars(place, position)

    def again(self) -> Velocity:
        self._team.forgive()
        self.twice = True
        return STILL
