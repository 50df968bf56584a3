"""The news of a search to its team about its own vehicle, and its messages about the vehicles of the others."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from arva_hil.autopilot.following.session import Session
from arva_hil.events import Event
from arva_hil.events.teams import TeammateBack, TeammateLost
from arva_hil.model.field.geodesy import LocalFrame
from arva_hil.search.mission.choice import NO_ID
from arva_hil.search.mission.mission import Mission
from arva_hil.search.mission.outcome import lla
from arva_hil.search.strategies.strategy import as_position
from arva_hil.search.team.team import Teammate
from arva_hil.search.team.team_tunnel import HeardAt

_OLD_S: Final = 1.0  # an older pose is no place of the vehicle


class TeamReport:
    """Remembers the last report. It also reports before the launch and after the search, while the vehicle sends."""

    def __init__(self, team: Teammate, session: Session, emit: Callable[[Event], None]) -> None:
        self._team = team
        self._session = session
        self._emit = emit
        self._handed: dict[int, HeardAt] = {}
        self._lost: set[int] = set()
        self._flying = False  # as in the last report

    def report_flown(
        self, now: float, place: tuple[float, float, float], origin: LocalFrame, mission: Mission | None
    ) -> None:
        """Report that the search flies the vehicle, which is at `place` (degrees, degrees, metres AMSL)."""
        self._report(now, place, origin, mission, flying=True, searching=True)
        lost = self._team.lost
        for number in lost.keys() - self._lost:
            self._emit(TeammateLost(now, number + 1, *lost[number]))
        for number in self._lost - lost.keys():
            self._emit(TeammateBack(now, number + 1))
        self._lost = set(lost)

    def report_left(self, now: float, origin: LocalFrame | None, mission: Mission | None, *, searching: bool) -> None:
        """Report a vehicle that stands on the ground before its launch, or that the search does not fly any more.

        After the search (not `searching`) a pilot may fly it. Once it has landed, it is not reported again.
        """
        vehicle, last = self._session.vehicle, self._session.navigation.track.last_position
        if vehicle is None or last is None or not (searching or vehicle.armed or self._flying):
            return
        origin = origin or last.frame
        state = self._session.navigation.state_at(now, origin)
        lost = state is None or state.age_s >= _OLD_S
        place = (last.lat, last.lon, last.alt) if state is None else lla(origin, *as_position(state.position))
        self._report(now, place, origin, mission, flying=vehicle.armed, searching=searching, lost=lost)

    def _report(
        self,
        now: float,
        place: tuple[float, float, float],
        origin: LocalFrame,
        mission: Mission | None,
        *,
        flying: bool,
        searching: bool,
        lost: bool = False,
    ) -> None:
        self._flying = flying
        if mission is None:
            self._team.report(now, place, flying=flying, searching=searching, lost=lost)
            return
        target = mission.choice.target
        searching = searching and not mission.ended
        hunting = target if mission.choice.hunting and searching else None
        found = {victim.id for victim in mission.victims.places if victim.sure} - {NO_ID}
        if mission.found_surely and target is not None:  # not before the last check of its place
            found.add(target)
        for id_, heard in mission.choice.heard.items():
            before = self._handed.get(id_)
            if id_ != NO_ID and (before is None or before.metres != heard.nearest_m):
                at = lla(origin, *heard.nearest_at, 0.0)
                self._handed[id_] = HeardAt(id_, heard.nearest_m, *at[:2])
        self._team.report(
            now,
            place,
            flying=flying,
            hunting=hunting,
            hunting_m=math.inf if hunting is None else mission.choice.heard[hunting].nearest_m,
            found=tuple(found),
            heard=list(self._handed.values()),
            searching=searching,
            lost=lost,
        )
