"""The outcome of a finished mission."""

from __future__ import annotations

from arva_hil.events.reasons import Reason, Why, because
from arva_hil.model.field.geodesy import LocalFrame
from arva_hil.search.mission.mission import Mission
from arva_hil.search.mission.outcome import Kind, Outcome, lla
from arva_hil.search.mission.victims import probing_order


def kind_of(mission: Mission | None) -> Kind:
    """The kind of outcome for the places that are reported: "failed" if not all that were asked for are."""
    if mission is None:
        return "failed"
    complete = mission.at_goal if mission.victims.several else mission.found is not None
    if not complete:
        return "failed"
    return "found" if mission.sure else "not sure"


def conclusion(mission: Mission) -> tuple[Kind, Reason]:
    """The kind of outcome, and how it ended, of a mission whose flight ended as it should."""
    if (kind := kind_of(mission)) != "failed":
        return kind, because(Why.FOUND if mission.sure else Why.NOT_SURE)
    assert mission.ended is not None
    return "failed" if mission.broken else "not found", mission.ended


def outcome_of(mission: Mission, origin: LocalFrame | None, kind: Kind, how: tuple[Reason, ...]) -> Outcome:
    """The outcome. `origin`: the take-off point."""
    id_, found, victims = mission.target, mission.found, probing_order(mission.victims.places)
    if mission.victims.several:
        id_, found = (victims[0].id, victims[0].found) if victims else (None, None)
    lat_lon, take_off = None, None
    if origin is not None:
        take_off = lla(origin, 0.0, 0.0, 0.0)
        lat_lon = None if found is None else lla(origin, found.north, found.east, found.down or 0.0)[:2]
    flown, others = (mission.searched_s, mission.path_m, mission.frames), tuple(mission.others.items())
    return Outcome(kind, how, id_, found, lat_lon, take_off, *flown, others, victims, mission.plan.victims)
