"""The height that is held in a search, the minimum height, and the descent onto the place found."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from arva_hil.events import Event
from arva_hil.events.searches import TooLow
from arva_hil.search.mission.ground import Height
from arva_hil.search.strategies.strategy import STILL, Position, towards
from arva_hil.search.team.team import Teammate

_GAIN: Final = 1.0  # 1/s; k_z of the paper
_CLIMB: Final = 1.0  # m/s
_SINK: Final = 0.5
_SLOWER_M: Final = (1.0, 3.0)  # above the wanted height: fly slower, and stop
_LEAST: Final = 0.5  # below this share of the wanted height the vehicle only climbs
_CLEAR: Final = 0.75  # climb up to this share
_RECOVERY_S: Final = 10.0  # limit of that climb; it begins again after each rise, and with a new margin
_RISE_M: Final = 1.0  # of the height: a rise
_LONGEST_S: Final = 60.0  # limit of that climb in all

_LAND_M: Final = (0.5, 1.5)  # the height at which the autopilot lands, with and without a rangefinder
_APPROACH_M_S: Final = 1.0  # the highest horizontal speed in the descent
_ABOVE_M: Final = 0.4  # descend only within this distance of the place
_LOWEST: Final = 0.6  # below this share of the landing height it also lands beside the place
_SETTLED_M: Final = 0.15
_REST_M: Final = 0.5  # stop this far above the landing height
_LAST_SPEED: Final = 0.3  # m/s, down, for the last metres
_LAST_M: Final = 2.0
_WAIT_S: Final = 5.0  # wait this long for the stop
_MOST_DESCENTS: Final = 3  # tries, while another vehicle stays below
_LIMIT_S: Final = 30.0  # plus 5 s a metre; after that it lands where it is


class HeightKeeper:
    """The control of the height above the ground.

    - `too_low`: the vehicle only climbs. `failed`: it does not climb.
    - `pace`: the share of the speed at which the height can follow the ground, before a rangefinder loses it.
    - `wanted`: the height above the ground [m], with the margin of an uncertain height.
    - `ground`: the ground below, down from the take-off point [m]; None if it is not known.
    """

    def __init__(self, wanted: float, emit: Callable[[Event], None]) -> None:
        self.too_low = False
        self.failed = False
        self.pace = 1.0
        self.wanted = self.asked = wanted
        self.ground: float | None = None
        self._reached = False  # True if the height was reached once, after the climb from the take-off
        self._late_s = self._last_s = math.inf  # when it has failed without a rise, and in any case
        self._risen_m = math.nan  # the height at the last rise
        self._emit = emit

    def velocity(self, time_s: float, height: Height) -> float:
        """Return the vertical velocity [m/s], down. It climbs if the height is not a number."""
        metres, self.wanted = height.metres, self.asked + height.margin
        self.ground = None if height.ground is None else -height.ground
        from_m, to_m = _SLOWER_M
        above = (metres - self.wanted - from_m) / (to_m - from_m) if height.measured else 0.0
        self.pace = 0.0 if height.still else 1.0 - max(0.0, min(above, 1.0))
        enough = (_CLEAR if self.too_low else _LEAST) * self.wanted
        self._reached = self._reached or metres >= _CLEAR * self.wanted
        if metres >= enough:
            self.too_low, self._late_s = False, math.inf
            fastest = 0.0 if height.still else _SINK  # a descent would seem an error of the sensors
            return max(-_CLIMB, min(_GAIN * (metres - self.wanted), fastest))
        if not self.too_low:
            self.too_low, self._late_s = True, time_s + _RECOVERY_S + height.margin / _CLIMB
            self._risen_m, self._last_s = metres, time_s + _LONGEST_S
            if self._reached:
                self._emit(TooLow(time_s, metres, self.wanted))
        elif metres >= self._risen_m + _RISE_M:  # above a falling slope the climb may be long
            self._risen_m, self._late_s = metres, min(max(self._late_s, time_s + _RECOVERY_S), self._last_s)
        self.failed = time_s > self._late_s
        self.pace = 0.0
        return -_CLIMB


class Descent:
    """The descent onto `place` (north, east).

    `done`: the autopilot must land now. `blocked`: it cannot land there, because another vehicle stays below. `speed`:
    the highest of the search [m/s].

    The vehicle descends only above the place; elsewhere it first flies there. Low above the place it stops, and then
    only sinks.
    """

    def __init__(self, place: tuple[float, float], speed: float, start_s: float, height: float) -> None:
        self.done = self.blocked = False
        self.place = place
        self._speed = min(speed, _APPROACH_M_S)
        self._late_s = start_s + _LIMIT_S + 5 * max(height, 0.0)
        self._low_s = math.inf
        self._settled = False

    def velocity(self, time_s: float, position: Position, height: Height) -> tuple[float, float, float]:
        """Return the velocity, NED, m/s."""
        off = math.dist(position[:2], self.place)
        floor = _LAND_M[not height.measured] + height.margin
        rest = floor + _REST_M
        if height.metres <= rest + 0.1:
            self._low_s = min(self._low_s, time_s)
        waited = time_s - self._low_s
        self._settled |= waited > _WAIT_S or (waited >= 0 and off < _SETTLED_M)
        above = self._settled or off < _ABOVE_M
        low = height.metres <= (floor + 0.1 if above else _LOWEST * floor)
        self.done = self.done or low or height.landed or bool(height.doubt) or time_s > self._late_s
        if self.done:
            return *STILL, 0.0
        fastest = _SINK if height.metres > _LAST_M else _LAST_SPEED
        level = floor if self._settled else rest
        down = max(-_SINK, min(_GAIN * (height.metres - level), fastest))
        return *towards(position, self.place, self._speed), down if above else min(down, 0.0)


class TeamDescent(Descent):
    """A descent that uses the places of the other vehicles at each step.

    While another vehicle stays below it begins again, at most twice; then it is `blocked`.
    """

    def __init__(self, team: Teammate, place: tuple[float, float], speed: float, start_s: float, height: float) -> None:
        super().__init__(place, speed, start_s, height)
        self._team = team
        self._wanted = place
        self._left = _MOST_DESCENTS

    def velocity(self, time_s: float, position: Position, height: Height) -> tuple[float, float, float]:
        self.place = self._team.beside(self._wanted)
        velocity = super().velocity(time_s, position, height)
        if self.done and not self.blocked and self._team.above_another(position):
            self._left -= 1
            self.blocked = not self._left
            if not self.blocked:
                super().__init__(self._wanted, self._speed, time_s, height.metres)
        return velocity


def descent_of(
    team: Teammate | None, place: tuple[float, float], speed: float, start_s: float, height: float
) -> Descent:
    """Return the descent onto a place (north, east), in a team not onto another vehicle."""
    if team is None:
        return Descent(place, speed, start_s, height)
    return TeamDescent(team, place, speed, start_s, height)
