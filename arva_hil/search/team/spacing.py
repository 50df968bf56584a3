"""The spacing of the vehicles of a team: none flies, descends or lands where another one is.

Each search limits only its own vehicle. Of two that want the same place, one has precedence and the other one makes
room. All make room for a silent vehicle in the air: it continues for some seconds with its last velocity, then it may
climb, descend, or hover for the rest of the search.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

from arva_hil.model.field.geodesy import LocalFrame
from arva_hil.search.strategies.strategy import Position
from arva_hil.search.team.team_tunnel import News

NEAR_M: Final = 6.0  # least horizontal distance to another vehicle
_LEVEL_M: Final = 2.5  # least vertical distance to another vehicle
_BELOW_M: Final = 8.0  # no descent onto a vehicle that is less below
_OVER_M: Final = 4.0  # the same, if that vehicle has landed
_ROOM_M: Final = 9.0  # make room up to this horizontal distance
_OVERDUE_S: Final = 1.0  # after this time without news a vehicle may be nearer, and at any height
_COASTS_S: Final = 3.0  # an autopilot follows its last velocity for this time: GUID_TIMEOUT
_UP_M: Final = 4.0  # no take-off within this horizontal distance below another one; a team may stand 5 m apart
_ABOVE_M: Final = 1.0  # a vehicle that is less above takes off at the same time
_DIRECTIONS: Final = 24  # radius of the search for a free place
_ROUNDING: Final = 1e-9  # m/s

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


def goes_first(other: News, own: News) -> bool:
    """Return True if the other vehicle has precedence.

    A vehicle whose search has ended may land and goes first, then one that searches, then one that waits. Of two that
    search, the one that received its transmitter nearer goes first; of two equal ones, the one with the lower number.
    """
    return _rank(other) < _rank(own)


def apart_m(other: News, age_s: float, speed: float) -> float:
    """Return the least horizontal distance to another vehicle with news of this age. `speed`: of the search, m/s."""
    if not other.flying or age_s <= _OVERDUE_S:
        return NEAR_M
    return NEAR_M + speed * min(age_s, _COASTS_S)


def neighbours(others: Iterable[tuple[News, float]], frame: LocalFrame, position: Position, speed: float) -> list[Near]:
    """Return the vehicles for which it may have to make room.

    `others`: with the age of their news; position NED [m] in `frame`.
    """
    return [near for near in _seen(others, frame, position, speed) if near.metres < near.room_m]


def may_take_off(others: Iterable[tuple[News, float]], lla: tuple[float, float, float], speed: float) -> bool:
    """Return True if no vehicle is, or may be, above one that stands at a place (degrees, degrees, metres AMSL)."""
    return not any(near.in_the_way_up for near in _seen(others, LocalFrame(*lla), (0.0, 0.0, 0.0), speed))


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
    share = min(1.0, speed / max(math.hypot(north, east), 1e-9))
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
    return not news.ended, news.free, news.hunting_m, news.number
