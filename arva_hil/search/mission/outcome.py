"""The outcome of a search, and the steps of its flight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from arva_hil.events.reasons import Reason, Why, because
from arva_hil.model.field.geodesy import LocalFrame
from arva_hil.search.mission.accuracy import UNKNOWN, Accuracy
from arva_hil.search.mission.choice import HeardTransmitter
from arva_hil.search.mission.mission import Mission
from arva_hil.search.mission.victims import Victim, probing_order
from arva_hil.search.strategies.history import Track
from arva_hil.search.strategies.strategy import Found

Kind = Literal["found", "not sure", "not found", "no link", "failed", "refused", "would fly"]


class Refusal(NamedTuple):
    """Why a search ends on the ground."""

    kind: Kind
    how: Reason


@dataclass(frozen=True)
class Outcome:
    """The outcome of a search. Places are NED metres from the take-off point; `time_s` from the end of the take-off.

    `kind`: found. Not sure: a place is reported, but the readings contradict it, or ± relative to the drone is above
    0.4 m. Not found: the whole area was searched. No link: one of the two was missing. Refused: the vehicle may not be
    armed. Would fly: a dry run has ended. Failed: anything else. `victims`: of a search for several, the surest place
    first; it is "found" if all that were asked for are. `found`, `id` and `lat_lon` are then those of the first.
    """

    kind: Kind
    how: tuple[Reason, ...]
    id: int | None = None  # of the transmitter searched for, -1 when frames carry none
    found: Found | None = None
    lat_lon: tuple[float, float] | None = None  # of `found`, degrees
    origin: tuple[float, float, float] | None = None  # the take-off point: degrees, degrees, metres AMSL
    time_s: float = 0.0
    path_m: float = 0.0
    frames: int = 0
    others: tuple[tuple[int, HeardTransmitter], ...] = ()
    victims: tuple[Victim, ...] = ()
    wanted: int | None = 1  # the number to find; None: all
    from_drone: tuple[float, float] | None = None  # of `found`: north and east of the drone at the end, m
    moving: tuple[tuple[int, Track], ...] = ()  # transmitters that move, with their last tracks
    accuracy: Accuracy = UNKNOWN  # of the drone's position on Earth


class SearchStep(NamedTuple):
    """One step of the flight, for a log. The last four values are of a frame that came in this step, else None."""

    time_s: float
    phase: str
    north_m: float
    east_m: float
    down_m: float
    heading_deg: float
    v_north: float
    v_east: float
    v_down: float
    id: int | None
    d_cm: int | None
    delta_deg: int | None
    zone: int | None = None


def lla(origin: LocalFrame, north: float, east: float, down: float) -> tuple[float, float, float]:
    """Return a place [m from the take-off point] in degrees, degrees, metres AMSL."""
    lat, lon, alt = map(float, origin.lla([north, east, down]))
    return lat, lon, alt


def kind_of(mission: Mission | None) -> Kind:
    """Return the kind of outcome for the places that are reported: "failed" if not all that were asked for are."""
    if mission is None:
        return "failed"
    complete = mission.at_goal if mission.victims.several else mission.found is not None
    if not complete:
        return "failed"
    return "found" if mission.sure else "not sure"


def conclusion(mission: Mission) -> tuple[Kind, Reason]:
    """Return the kind of outcome, and how it ended, of a mission whose flight ended as it should."""
    if (kind := kind_of(mission)) != "failed":
        return kind, because(Why.FOUND if mission.sure else Why.NOT_SURE)
    assert mission.ended is not None
    return "failed" if mission.broken else "not found", mission.ended


def outcome_of(mission: Mission, origin: LocalFrame, kind: Kind, how: tuple[Reason, ...]) -> Outcome:
    """Return the outcome. `origin`: the take-off point."""
    id_, found, victims = mission.choice.target, mission.found, probing_order(mission.victims.places)
    if mission.victims.several:
        id_, found = (victims[0].id, victims[0].found) if victims else (None, None)
    done, others = mission.progress, tuple(mission.others.items())
    flown = done.searched_s, done.path_m, done.frames
    lat_lon = from_drone = None
    if found is not None:
        lat_lon = lla(origin, found.north, found.east, found.down or 0.0)[:2]
        north, east, _ = done.position
        from_drone = found.goal[0] - north, found.goal[1] - east
    return Outcome(
        kind,
        how,
        id_,
        found,
        lat_lon,
        lla(origin, 0.0, 0.0, 0.0),
        *flown,
        others,
        victims,
        mission.plan.victims,
        from_drone=from_drone,
        moving=tuple(mission.victims.aside.moving.items()),
        accuracy=mission.reports.accuracy,
    )
