"""Events of a search about the other searches of its team."""

from __future__ import annotations

from arva_hil.events.searches import SearchEvent


class TeammateLost(SearchEvent):
    """Another search of the team was silent for 5 s with its vehicle in the air, or does not know its place.

    `number`: of its vehicle in the scenario, from 1. Until it sends again, this search keeps `apart_m` off its last
    place, `north_m`, `east_m` of the own take-off point, at every height.
    """

    number: int
    north_m: float
    east_m: float
    apart_m: float


class TeammateBack(SearchEvent):
    """A lost search of the team sends again, or its vehicle is on the ground. `number`: of its vehicle."""

    number: int
