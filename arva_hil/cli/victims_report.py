"""The places that a search reports, in words and as JSON objects: one, or several in the order of probing."""

from __future__ import annotations

import math
from typing import Any

from arva_hil.events.reasons import Why, because
from arva_hil.events.words.reasons import in_words
from arva_hil.events.words.text import sigma
from arva_hil.model.field.geodesy import LocalFrame
from arva_hil.search.mission.accuracy import Accuracy
from arva_hil.search.mission.choice import NO_ID
from arva_hil.search.mission.outcome import Outcome, lla
from arva_hil.search.mission.victims import Victim
from arva_hil.search.strategies.strategy import Found, sigma_of


def name(id_: int | None) -> str:
    """Return the name of a transmitter."""
    return "a transmitter" if id_ in (None, NO_ID) else f"transmitter {id_}"


def where(found: Found, accuracy: Accuracy, from_drone: tuple[float, float] | None = None) -> str:
    """Return a place from the take-off point, and relative to the drone with its sigma [m]."""
    metres = sigma_of(accuracy.relative(found))
    place = f"{found.north:z.1f} m north, {found.east:z.1f} m east of the take-off point"
    spread = "" if metres is None else f" ± {sigma(metres)}"
    if from_drone is not None:
        north, east = from_drone
        return f"{place}; {north:z.1f} m north, {east:z.1f} m east of the drone{spread}"
    return place + (spread and f";{spread} relative to the drone")


def on_earth(lat_lon: tuple[float, float], found: Found, accuracy: Accuracy) -> str:
    """Return a position on Earth, with its sigma."""
    metres = sigma_of(accuracy.on_earth(found))
    spread = "" if metres is None else f" ± {sigma(metres)} on Earth"
    unknown = "" if accuracy.reported else ", or more: the autopilot does not report its accuracy"
    return f"position: {lat_lon[0]:.7f}, {lat_lon[1]:.7f}{spread}{unknown if spread else ''}"


def place_as_dict(found: Found, lat_lon: tuple[float, float] | None, accuracy: Accuracy) -> dict[str, Any]:
    """Return a place as a JSON object.

    `relative_covariance`: of the place relative to the drone; `earth_covariance`: of the position on Earth [m²].
    """
    return {
        **found._asdict(),
        "lat_lon": lat_lon,
        "relative_covariance": accuracy.relative(found),
        "earth_covariance": accuracy.on_earth(found),
        "autopilot_sigma_m": accuracy.sigma_m if accuracy.reported else None,
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
    parts = [] if victim.sure else ["not sure: the readings do not agree with it"]
    if victim.found.down is not None and math.isfinite(victim.found.down):
        level = "below" if victim.found.down >= 0 else "above"
        parts.append(f"{abs(victim.found.down):.1f} m {level} the take-off point")
    parts.append("marked by the receiver" if victim.marked else "not marked")
    return "".join(f", {part}" for part in parts) + f", found after {victim.time_s:.0f} s"


def _lat_lon(origin: LocalFrame, found: Found) -> tuple[float, float]:
    lat, lon, _ = lla(origin, found.north, found.east, found.down or 0.0)
    return lat, lon
