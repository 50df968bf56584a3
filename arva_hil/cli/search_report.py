"""The results of a search: its outcome in words and as a JSON object, its log and its picture."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

from arva_hil import __version__
from arva_hil.cli.outcome import FAILED, NO_LINK, OK, USAGE
from arva_hil.clock import utc
from arva_hil.events import Event
from arva_hil.events.event_json import event_object
from arva_hil.events.reasons import Why, because
from arva_hil.events.words.reasons import in_words
from arva_hil.events.words.text import placed, sigma, unless_reported
from arva_hil.links import files
from arva_hil.model.field.geodesy import LocalFrame
from arva_hil.records.pictures.run import of_search
from arva_hil.records.reading import RecordingError, load
from arva_hil.records.writing import RecordError
from arva_hil.records.writing.search_log import TRACK, SearchLog
from arva_hil.search.mission.accuracy import Accuracy
from arva_hil.search.mission.choice import NO_ID
from arva_hil.search.mission.outcome import Outcome, lla
from arva_hil.search.mission.victims import Victim
from arva_hil.search.strategies.history import speed_of
from arva_hil.search.strategies.strategy import Found, sigma_of

_NEAR_M: Final = 0.1  # a nearer place is not given in tenths of a metre


def name(id_: int | None) -> str:
    """Return the name of a transmitter."""
    return "a transmitter" if id_ in (None, NO_ID) else f"transmitter {id_}"


def where(found: Found, accuracy: Accuracy, from_drone: tuple[float, float] | None = None) -> str:
    """Return a place from the take-off point, and relative to the drone with its sigma [m]."""
    metres = sigma_of(accuracy.relative(found))
    place = f"{placed(found.north, found.east)} of the take-off point"
    spread = "" if metres is None else f" ± {sigma(metres)}"
    if from_drone is not None:
        near = math.hypot(*from_drone) < _NEAR_M
        return f"{place}; {'less than 10 cm from' if near else placed(*from_drone) + ' of'} the drone{spread}"
    return place + (spread and f";{spread} relative to the drone")


def on_earth(lat_lon: tuple[float, float], found: Found, accuracy: Accuracy) -> str:
    """Return a position on Earth, with its sigma."""
    metres = sigma_of(accuracy.on_earth(found))
    spread = "" if metres is None else f" ± {sigma(metres)} on Earth"
    unknown = unless_reported(accuracy.reported_m) if spread else ""
    return f"position: {lat_lon[0]:.7f}, {lat_lon[1]:.7f}{spread}{unknown}"


def place_as_dict(found: Found, lat_lon: tuple[float, float] | None, accuracy: Accuracy) -> dict[str, Any]:
    """Return a place as a JSON object.

    `relative_covariance`: of the place relative to the drone; `earth_covariance`: of the position on Earth [m²].
    """
    return {
        **found._asdict(),
        "lat_lon": lat_lon,
        "relative_covariance": accuracy.relative(found),
        "earth_covariance": accuracy.on_earth(found),
        "autopilot_sigma_m": accuracy.reported_m,
    }


def victims_found(outcome: Outcome) -> list[str]:
    """Return the outcome of a search for several victims and the list of places, the surest first."""
    asked = "all that are received" if outcome.wanted is None else str(outcome.wanted)
    count = sum(victim.sure for victim in outcome.victims)
    lines = [f"found {count} of {asked}" if outcome.wanted else f"found {count}; searched for {asked}"]
    if outcome.how != (because(Why.FOUND),):
        lines[0] += f": {in_words(outcome.how)}"
    if outcome.victims:
        lines.append("order of probing, the surest place first:")
    origin = LocalFrame(*outcome.origin) if outcome.origin else None
    for number, victim in enumerate(outcome.victims, 1):
        lines.append(f"{number}. {name(victim.id)}: {where(victim.found, outcome.accuracy)}{_about(victim)}")
        if origin:
            lines.append(f"   {on_earth(_lat_lon(origin, victim.found), victim.found, outcome.accuracy)}")
    return lines


def victims_as_dicts(outcome: Outcome) -> list[dict[str, Any]]:
    """Return the list as JSON objects."""
    origin = LocalFrame(*outcome.origin) if outcome.origin else None
    return [
        {
            "id": None if victim.id == NO_ID else victim.id,
            **place_as_dict(victim.found, _lat_lon(origin, victim.found) if origin else None, outcome.accuracy),
            "sure": victim.sure,
            "marked": victim.marked,
            "time_s": victim.time_s,
        }
        for victim in outcome.victims
    ]


def _about(victim: Victim) -> str:
    parts = [] if victim.sure else [in_words(because(Why.NOT_SURE))]
    if victim.found.down is not None and math.isfinite(victim.found.down):
        level = "below" if victim.found.down >= 0 else "above"
        parts.append(f"{abs(victim.found.down):.1f} m {level} the take-off point")
    parts.append("marked by the receiver" if victim.marked else "not marked")
    return "".join(f", {part}" for part in parts) + f", found after {victim.time_s:.0f} s"


def _lat_lon(origin: LocalFrame, found: Found) -> tuple[float, float]:
    lat, lon, _ = lla(origin, found.north, found.east, found.down or 0.0)
    return lat, lon


PICTURE: Final = "search.png"
EXIT: Final = {
    "found": OK,
    "not sure": FAILED,
    "not found": FAILED,
    "failed": FAILED,
    "no link": NO_LINK,
    "refused": USAGE,
    "would fly": OK,
}


def close_log(log: SearchLog, outcome: Outcome, code: int, started_us: float) -> list[str]:
    """Close the log and draw the picture. Returns lines about both.

    `started_us`: the steps' time 0 in microseconds since 1970.
    """
    about = {"started": utc(round(started_us)), "command": sys.argv, "version": __version__}
    try:
        log.close({"exit_code": code, **about, **as_dict(outcome)})
    except RecordError as error:
        return [f"error: {error}"]
    picture = log.folder / PICTURE
    try:
        files.replace(picture, of_search(load(log.folder)))
    except ImportError:
        return [f"log: {log.folder / TRACK}; for a picture: pip install 'arva-hil[plots]'"]
    except (OSError, RecordingError) as error:
        return [f"log: {log.folder / TRACK}; no picture: {error}"]
    return [f"log: {log.folder / TRACK}, picture: {picture}"]


def result(outcome: Outcome, found_by: Mapping[int, str] = MappingProxyType({})) -> list[str]:
    """Return the outcome in words. `found_by`: the drone of the team that has found each transmitter."""
    found, how = outcome.found, in_words(outcome.how)
    if outcome.wanted != 1:
        lines = victims_found(outcome)
    elif found is None:
        lines = [f"{how}; nothing found" if outcome.frames and outcome.kind == "failed" else how]
    else:
        place = where(found, outcome.accuracy, outcome.from_drone)
        first = f"found {name(outcome.id)}: {place}"
        if outcome.kind == "not sure":
            first = f"{how}, {name(outcome.id)} at {place}"
        elif outcome.how != (because(Why.FOUND),):
            first += f", but {how}"
        lines = [first]
    if found and outcome.lat_lon and outcome.wanted == 1:
        lines.append(on_earth(outcome.lat_lon, found, outcome.accuracy))
    if outcome.frames:
        lines.append(f"searched {outcome.time_s:.0f} s, flew {outcome.path_m:.0f} m, frames: {outcome.frames}")
    for id_, heard in outcome.others:
        if finder := found_by.get(id_):
            lines.append(f"{name(id_)} was received, and found by {finder}")
            continue
        there = f"{placed(*heard.nearest_at)} of the take-off point"
        lines.append(f"{name(id_)} was received, but not found; nearest, {heard.nearest_m:.1f} m away, at {there}")
    for id_, track in outcome.moving:
        there = f"{placed(*track[-1][1:])} of the take-off point"
        lines.append(f"{name(id_)} moves, at about {speed_of(track):.1f} m/s, and was put aside; last {there}")
    return lines


def exit_code(outcomes: Sequence[Outcome]) -> int:
    """Return 0 if a place is sure and no search has failed.

    A search of a team that finds nothing on its strips has not failed.
    """
    kinds = [outcome.kind for outcome in outcomes]
    wrong = [kind for kind in kinds if kind not in ("found", "would fly", "not found", "not sure")]
    if wrong or not {"found", "would fly"} & set(kinds):
        return max(EXIT[kind] for kind in wrong or kinds)
    return OK


def found_by(outcomes: Mapping[str, Outcome]) -> dict[int, str]:
    """Return the drone that has found each transmitter for sure, by the transmitter's id."""
    return {
        outcome.id: name for name, outcome in outcomes.items() if outcome.kind == "found" and outcome.id is not None
    }


def as_dict(outcome: Outcome) -> dict[str, Any]:
    """Return the outcome as a JSON object."""
    found = outcome.found
    return {
        "outcome": outcome.kind,
        "how": in_words(outcome.how),
        "id": None if outcome.id == NO_ID else outcome.id,
        "found": found and place_as_dict(found, outcome.lat_lon, outcome.accuracy) | {"from_drone": outcome.from_drone},
        "origin": outcome.origin,
        "time_s": outcome.time_s,
        "path_m": outcome.path_m,
        "frames": outcome.frames,
        "others": [
            {"id": None if id_ == NO_ID else id_, "nearest_m": heard.nearest_m, "nearest_at": heard.nearest_at}
            for id_, heard in outcome.others
        ],
        "moving": [{"id": id_, "track": track} for id_, track in outcome.moving],
        "wanted": outcome.wanted,
        "victims": victims_as_dicts(outcome),
    }


def would_order(planned: Iterable[Event]) -> list[dict[str, Any]]:
    """Return the orders of a dry run, for a program: those of `WouldOrder` and `SetPointPlanned`, with their fields."""
    every = [{"order": "SET_POSITION_TARGET_LOCAL_NED", **event_object(event)} for event in planned]
    return [{name: value for name, value in one.items() if name != "event"} for one in every]
