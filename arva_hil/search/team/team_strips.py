"""The strips of one member of a team: those of its own part of the area, then of the parts that others leave."""

from __future__ import annotations

from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import STILL, Position, Velocity, towards
from arva_hil.search.strategies.strips import Area, Strips
from arva_hil.search.team.team import Teammate


def strips_of(team: Teammate, plan: SearchPlan, position: Position) -> Strips:
    """Return strips over its own part of the team's area, then over those that others have left."""
    area = team.area()
    return Strips.of(plan, position) if area is None else TeamStrips(area, plan, position, team)


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
        return STILL
