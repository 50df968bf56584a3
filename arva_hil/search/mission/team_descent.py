"""The descent of one member of a team: beside those that have landed, and never onto another one."""

from __future__ import annotations

from typing import Final

from arva_hil.search.mission.ground import Height
from arva_hil.search.mission.height import Descent
from arva_hil.search.strategies.strategy import Position
from arva_hil.search.team.team import Teammate


def descent_of(
    team: Teammate | None, place: tuple[float, float], speed: float, start_s: float, height: float
) -> Descent:
    """The way down onto a place (north, east), in a team not onto another vehicle."""
    if team is None:
        return Descent(place, speed, start_s, height)
    return TeamDescent(team, place, speed, start_s, height)


_MOST: Final = 3  # descents, while another one stays below


class TeamDescent(Descent):
    """A descent that uses the places of the other vehicles at each step.

    While another vehicle stays below it begins again, at most twice; then it is `blocked`.
    """

    def __init__(self, team: Teammate, place: tuple[float, float], speed: float, start_s: float, height: float) -> None:
        super().__init__(place, speed, start_s, height)
        self._team = team
        self._wanted = place
        self._left = _MOST

    def velocity(self, time_s: float, position: Position, height: Height) -> tuple[float, float, float]:
        self.place = self._team.beside(self._wanted)
        velocity = super().velocity(time_s, position, height)
        if self.done and not self.blocked and self._team.above_another(position):
            self._left -= 1
            self.blocked = not self._left
            if not self.blocked:
                super().__init__(self._wanted, self._speed, time_s, height.metres)
        return velocity
