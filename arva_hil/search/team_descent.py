"""The descent of one member of a team: beside those that have landed, and never onto another one."""

from __future__ import annotations

from arva_hil.search.ground import Height
from arva_hil.search.height import Descent
from arva_hil.search.strategy import Position
from arva_hil.search.team import Teammate


def descent_of(
    team: Teammate | None, place: tuple[float, float], speed: float, start_s: float, height: float
) -> Descent:
    """The way down onto a place (north, east), in a team not onto another vehicle."""
    if team is None:
        return Descent(place, speed, start_s, height)
    return TeamDescent(team, place, speed, start_s, height)


class TeamDescent(Descent):
    """Looks at each step where the others are. One that takes too long begins again while another one is below."""

    def __init__(self, team: Teammate, place: tuple[float, float], speed: float, start_s: float, height: float) -> None:
        super().__init__(place, speed, start_s, height)
        self._team = team
        self._wanted = place

    def velocity(self, time_s: float, position: Position, height: Height) -> tuple[float, float, float]:
        self.place = self._team.beside(self._wanted)
        velocity = super().velocity(time_s, position, height)
        if self.done and self._team.above_another(position):
            super().__init__(self._wanted, self._speed, time_s, height.metres)
        return velocity
