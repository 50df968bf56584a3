"""The log of a search: its track, and the place that it reports."""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.events.reasons import Why, because
from arva_hil.events.words.reasons import in_words
from arva_hil.model.field import LocalFrame
from arva_hil.model.field.arrays import Array
from arva_hil.records.reading.lines import (
    Lines,
    NumberColumns,
    json_object,
    lat_lon,
    lat_lon_alt,
    mapping,
    number,
    objects,
    seconds_of,
    table,
    text,
    triple,
)
from arva_hil.records.writing.search_log import OUTCOME, TRACK

_NUMBERS: Final = "time_s north_m east_m down_m heading_deg id d_cm delta_deg zone".split()
_MOST_PHASES: Final = 64
_POINTS: Final = 48  # of an ellipse
PROBABILITY: Final = 0.95  # of the transmitter inside the ellipse
_INTERRUPTED: Final = 130  # an exit code
_SIGMAS: Final = math.sqrt(-2 * math.log(1 - PROBABILITY))  # to its edge


def ellipse_of(covariance: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the ellipse that contains the transmitter with PROBABILITY, for normal errors.

    `covariance`: of north and east, m² (nn, ne, ee). Semi-major and semi-minor axis [m], and the bearing of the major
    axis from north [rad].
    """
    nn, ne, ee = covariance
    values, vectors = np.linalg.eigh([[nn, ne], [ne, ee]])
    minor, major = (_SIGMAS * math.sqrt(max(float(value), 0.0)) for value in values)
    return major, minor, math.atan2(vectors[1, 1], vectors[0, 1])


@dataclass(frozen=True)
class RecordedPlace:
    """The place that a search reports, metres from the take-off point, NED; `lat_lon` in degrees, None if not known.

    `covariance`: of north and east, m² (nn, ne, ee); None if the strategy gives none. `id`: of the transmitter, None if
    it is not known; `sure`: the readings agree with the place. `relative_covariance`: of the place relative to the
    drone; `earth_covariance`: of the position on Earth. `autopilot_sigma_m`: of the drone's own position; None if the
    autopilot does not report it. `time_s`: from the start of a search for several until it was
    found; None if not known.
    """

    north: float
    east: float
    down: float | None
    covariance: tuple[float, float, float] | None
    lat_lon: tuple[float, float] | None
    id: int | None = None
    sure: bool = True
    relative_covariance: tuple[float, float, float] | None = None
    earth_covariance: tuple[float, float, float] | None = None
    autopilot_sigma_m: float | None = None
    time_s: float | None = None

    def ellipse(self) -> tuple[float, float, float] | None:
        """Return the ellipse on Earth, see `ellipse_of`; None without a covariance."""
        return None if self.earth_covariance is None else ellipse_of(self.earth_covariance)

    def outline(self) -> list[tuple[float, float]]:
        """Return that area's edge as (north, east), metres from the take-off point, closed; empty if unknown."""
        if (ellipse := self.ellipse()) is None:
            return []
        major, minor, bearing = ellipse
        cos, sin = math.cos(bearing), math.sin(bearing)
        edge = []
        for angle in (2 * math.pi * n / _POINTS for n in range(_POINTS)):
            along, across = major * math.cos(angle), minor * math.sin(angle)
            edge.append((self.north + along * cos - across * sin, self.east + along * sin + across * cos))
        return [*edge, edge[0]]


@dataclass(frozen=True, eq=False)
class RecordedSearch:
    """One search: K steps of its flight, metres from the take-off point, NED. What is empty is NaN.

    `outcome`: search.json as it is; if the search was killed, what its events have of it. `found`: the place reported.
    `origin`: the take-off point, degrees, degrees, metres AMSL; None without a take-off. `started_utc_s`: the time 0 of
    the steps in seconds since 1970, None if the search was killed. `start_s`: the same on the clock of the run in this
    folder, 0 without one.
    """

    time_s: Array  # (K,)
    phase: tuple[str, ...]  # (K,)
    position: Array  # (K, 3)
    heading_deg: Array  # (K,)
    id: Array  # (K,) id of the transmitter searched for, in steps with a frame
    d_cm: Array  # (K,)
    delta_deg: Array  # (K,)
    zone: Array  # (K,)
    outcome: Mapping[str, Any]
    found: RecordedPlace | None
    origin: tuple[float, float, float] | None
    started_utc_s: float | None
    start_s: float

    @property
    def how(self) -> str:
        """The reason why the search ended; "" if it has not."""
        return text(self.outcome.get("how"))

    @cached_property
    def victims(self) -> tuple[RecordedPlace, ...]:
        """The places of a search for several, in the order of probing."""
        return tuple(place for one in objects(self.outcome.get("victims")) if (place := _place(one, one)))

    @property
    def places(self) -> tuple[RecordedPlace, ...]:
        """The places of all victims that are reported, in the order of finding; of a search for one, its place."""
        found = sorted(self.victims, key=lambda one: math.inf if one.time_s is None else one.time_s)
        return tuple(found) or ((self.found,) if self.found else ())

    @property
    def flying(self) -> NDArray[np.bool_]:
        """True (K,) for steps after the take-off and before the landing."""
        return np.array([phase == "flying" for phase in self.phase], bool)


def read_search(
    folder: Path, start_utc_s: float | None, events: Sequence[Mapping[str, Any]]
) -> tuple[RecordedSearch | None, list[str]]:
    """Return the search in a folder, None if there is none, and notes. Raises RecordingError.

    `start_utc_s`: the run's time 0 in seconds since 1970, None if it is not known. `events`: of the search; they have
    the places of one that was killed.
    """
    if not (folder / TRACK).exists():
        return None, []
    lines = Lines(folder / TRACK)
    columns, rows = table(lines, ("phase", *_NUMBERS))
    numbers = NumberColumns(lines, columns, dict.fromkeys(_NUMBERS, "d"))
    phases, names = array("b"), dict[str, int]()
    for row in rows:
        lines.seconds(row[columns["time_s"]])
        numbers.add(row)
        phase = row[columns["phase"]]
        if phase not in names and len(names) >= _MOST_PHASES:
            raise lines.error(f"more than {_MOST_PHASES} kinds of phases")
        phases.append(names.setdefault(phase, len(names)))
    outcome = json_object(folder / OUTCOME) if (folder / OUTCOME).exists() else _so_far(events)
    values = np.stack([numbers.column(name, len(numbers)) for name in _NUMBERS], axis=1)
    id_, d_cm, delta_deg, zone = values[:, 5:].T
    every = list(names)
    started_s = seconds_of(text(outcome.get("started")))
    return RecordedSearch(
        values[:, 0],
        tuple(every[n] for n in phases),
        values[:, 1:4],
        values[:, 4],
        id_,
        d_cm,
        delta_deg,
        zone,
        outcome,
        _place(outcome.get("found"), {"id": outcome.get("id"), "sure": outcome.get("outcome") != "not sure"}),
        lat_lon_alt(outcome.get("origin")),
        started_s,
        0.0 if started_s is None or start_utc_s is None else started_s - start_utc_s,
    ), lines.note


def read_team(events: Sequence[Mapping[str, Any]], exit_code: float | None) -> dict[str, RecordedSearch]:
    """Return the searches of a team by vehicle, as far as the events of their run have them, without steps.

    `exit_code`: of the run; None if it was killed.
    """
    why = Why.INTERRUPTED if exit_code == _INTERRUPTED else Why.NO_END
    at_end = "" if exit_code is None else in_words(because(why))
    of: dict[str, list[Mapping[str, Any]]] = {}
    for event in events:
        if vehicle := text(event.get("of")):
            of.setdefault(vehicle, []).append(event)
    nothing, team = np.empty(0), dict[str, RecordedSearch]()
    for vehicle, own in of.items():
        how = next((text(event.get("how")) for event in own if event.get("event") == "search_ended"), at_end)
        outcome = {**_so_far(own), "how": how}
        origin = lat_lon_alt(outcome.get("origin"))
        track = nothing, (), np.empty((0, 3)), nothing, nothing, nothing, nothing, nothing
        team[vehicle] = RecordedSearch(*track, outcome, None, origin, None, 0.0)
    return team


def _so_far(events: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the contents of search.json as far as they are known from the events."""
    outcome, victims, begun_s = dict[str, Any](), dict[object, dict[str, Any]](), 0.0
    for event in events:
        kind = event.get("event")
        if kind == "take_off_point":
            outcome["origin"] = [event.get(name) for name in ("lat", "lon", "alt")]
        elif kind == "search_begun":
            outcome["wanted"], begun_s = event.get("wanted"), event["time_s"]
        north, east = place = number(event.get("north_m")), number(event.get("east_m"))
        if kind == "place_found":
            id_, took_s = event.get("transmitter"), event["time_s"] - begun_s
            ned = {"north": north, "east": east, "down": event.get("down_m")}
            victims[place] = found = {**event, "id": id_, **ned, "time_s": took_s}
            if (origin := lat_lon_alt(outcome.get("origin"))) and north is not None and east is not None:
                found["lat_lon"] = [float(degrees) for degrees in LocalFrame(*origin).lla([north, east, 0.0])[:2]]
        elif kind == "victim_noted" and place in victims:
            victims[place]["sure"] = event.get("sure")
        elif kind == "place_doubted":  # it is visited again
            victims.pop(place, None)
    return {**outcome, "victims": [*victims.values()]}


def _place(value: object, about: Mapping[str, Any]) -> RecordedPlace | None:
    """Return a place in search.json, None if there is none; `about`: its transmitter and certainty."""
    found = mapping(value)
    north, east = number(found.get("north")), number(found.get("east"))
    if north is None or east is None:
        return None
    id_ = about.get("id")
    return RecordedPlace(
        north,
        east,
        number(found.get("down")),
        triple(found.get("covariance")),
        lat_lon(found.get("lat_lon")),
        id_ if isinstance(id_, int) and id_ >= 0 else None,
        about.get("sure") is not False,
        triple(found.get("relative_covariance")),
        triple(found.get("earth_covariance")),
        number(found.get("autopilot_sigma_m")),
        number(about.get("time_s")),
    )
