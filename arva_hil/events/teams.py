"""Events of a search about the other searches of its team."""

from __future__ import annotations

from arva_hil.events.searches import SearchEvent


class TeammateLost(SearchEvent):
    """Another search of the team was not heard for 5 s while its vehicle was in the air, or does not know where it is.

    `number`: of its vehicle in the scenario, from 1. From here on, until it is heard, this search keeps `apart_m` off
    the place where it was, at every height: `north_m`, `east_m` of the own take-off point.
    """

    number: int
    north_m: float
    east_m: float
    apart_m: float


class TeammateBack(SearchEvent):
    """A search of the team that was lost is heard again, or its vehicle is on the ground. `number`: of its vehicle."""

    number: int
