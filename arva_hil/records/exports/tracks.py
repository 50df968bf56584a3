"""Places on Earth: the tracks, transmitters and places of a record, for maps.

Latitude and longitude are WGS-84 degrees, altitudes metres above mean sea level.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.clock import utc
from arva_hil.events.words.text import in_metres, unless_reported
from arva_hil.model.field import LocalFrame
from arva_hil.model.field.arrays import Array
from arva_hil.records.reading import RecordedPlace, RecordedReceiver, RecordedSearch, Recording
from arva_hil.records.reading.search import PROBABILITY
from arva_hil.records.writing import layout
from arva_hil.search.strategies.strategy import sigma_of

Lla = tuple[float, float, float]

_BATCH: Final = 4096  # rows


class FlightTrack(NamedTuple):
    """The track of one receiver, or of the search. Only instants with a place: N of them.

    `rows`: their numbers among the frames or steps. `gaps` (N,): True after a missing place.
    """

    name: str
    receiver: RecordedReceiver | None  # None: the search's own track
    rows: NDArray[np.int64]
    time_s: Array
    lla: Array  # (N, 3)
    gaps: NDArray[np.bool_]

    def heard_m(self) -> Array:
        """Return d (N,) of the nearest transmitter received [m]; NaN without any."""
        if self.receiver is None:
            return np.full(len(self.rows), np.nan)
        nearest = self.receiver.begins[self.rows]
        return np.where(self.receiver.zone[nearest] > 0, self.receiver.d_cm[nearest] / 100, np.nan)

    def range_m(self) -> Array:
        """Return the true range (N,) of the same transmitter [m]; NaN if it is not known."""
        assert self.receiver is not None
        return self.receiver.true_range_m[self.receiver.begins[self.rows]]

    def parts(self) -> Iterator[FlightTrack]:
        """Yield the pieces without gaps."""
        for first, end in pairwise([0, *np.flatnonzero(self.gaps).tolist(), len(self.rows)]):
            here = slice(first, end)
            yield self._replace(
                rows=self.rows[here], time_s=self.time_s[here], lla=self.lla[here], gaps=self.gaps[here]
            )

    def points(self) -> Iterator[tuple[float, list[float], float]]:
        """Yield time, place and d of each instant."""
        return zip(*map(plain_rows, (self.time_s, self.lla, self.heard_m())), strict=True)


class Landmark(NamedTuple):
    """A point with a name.

    `kind`: found or transmitter. `outline`: around it, (latitude, longitude), closed. `id`: of the transmitter.
    """

    kind: str
    name: str
    about: str
    lla: Lla
    outline: Sequence[tuple[float, float]] = ()
    id: int | None = None


def rounded(lla: NDArray[Any]) -> Array:
    """Return places (…, 3) with degrees to 8 decimals (1 mm) and altitudes to 3."""
    return np.concatenate([np.round(lla[..., :2], 8), np.round(lla[..., 2:], 3)], axis=-1)


def moment(recording: Recording, time_s: float) -> str:
    """Return a time of the run in UTC, ISO 8601; in 1970 if the date is unknown."""
    return layout.moment(time_s, round((recording.start_utc_s or 0.0) * 1e6)) or utc(0)


def plain_rows(values: NDArray[Any]) -> Iterator[Any]:
    """Yield the rows of an array in Python's numbers, made a few at a time."""
    for first in range(0, len(values), _BATCH):
        yield from values[first : first + _BATCH].tolist()


def tracks(recording: Recording) -> list[FlightTrack]:
    """Return the track of each receiver, and that of the search, as far as their places on Earth are known."""
    found = []
    for receiver in recording.receivers:
        lla = recording.lla(receiver.vehicle, receiver.time_s, receiver.position)
        if lla is not None:
            found.append(_track(receiver.name or "receiver", receiver, receiver.time_s, lla))
    if (search := recording.search) and search.origin:
        lla = np.stack(LocalFrame(*search.origin).lla(np.nan_to_num(search.position)), axis=-1)
        lla[~np.isfinite(search.position).all(axis=1)] = np.nan
        found.append(_track("search", None, search.time_s + search.start_s, lla))
    return [track for track in found if len(track.rows)]


def marks(recording: Recording) -> list[Landmark]:
    """Return the place found with its ellipse, and the true places of the transmitters at the end."""
    return [*_found(recording), *_transmitters(recording)]


def _track(name: str, receiver: RecordedReceiver | None, time_s: Array, lla: Array) -> FlightTrack:
    rows = np.flatnonzero(np.isfinite(lla).all(axis=1) & np.isfinite(time_s))
    return FlightTrack(name, receiver, rows, time_s[rows], rounded(lla[rows]), np.diff(rows, prepend=rows[:1]) > 1)


def _found(recording: Recording) -> Iterator[Landmark]:
    for vehicle, search in recording.searches.items():
        for number, found in enumerate(search.victims, 1):
            order = f"by {vehicle}" if vehicle else f"{number} of {len(search.victims)} in the order of probing"
            yield from _place_found(search, found, f"{order}; {'' if found.sure else 'not sure; '}")
        if search.found and not search.victims:
            yield from _place_found(search, search.found, "")


def _place_found(search: RecordedSearch, found: RecordedPlace, order: str) -> Iterator[Landmark]:
    """Yield the place, if it is known on Earth."""
    if found.lat_lon is None:
        return
    alt = search.origin[2] - (found.down or 0.0) if search.origin else 0.0
    there = LocalFrame(*found.lat_lon, alt)
    outline = [(north - found.north, east - found.east, 0.0) for north, east in found.outline()]
    edge = np.stack(there.lla(outline), axis=-1)[:, :2].tolist() if outline else []
    order += search.how or "the search has not ended"
    about = f"{order}; no uncertainty is known"
    if ellipse := found.ellipse():
        major, minor, bearing = ellipse
        about = (
            f"{order}; on Earth {PROBABILITY:.0%} inside an ellipse of {in_metres(major)} × "
            f"{in_metres(minor)} (semi-axes), long axis {math.degrees(bearing) % 180:.0f}°"
            f"{unless_reported(found.autopilot_sigma_m)}"
        )
        if (spread := sigma_of(found.relative_covariance)) is not None:
            about += f"; relative to the drone ± {in_metres(spread)}"
    name = "place found" if found.id is None else f"place found: transmitter {found.id}"
    lat, lon, alt = rounded(np.array([*found.lat_lon, alt])).tolist()
    yield Landmark("found", name, about, (lat, lon, alt), [(round(a, 8), round(b, 8)) for a, b in edge], found.id)


def _transmitters(recording: Recording) -> Iterator[Landmark]:
    end_s = recording.span_s[1]
    for vehicle in dict.fromkeys(receiver.vehicle for receiver in recording.receivers):
        there = recording.transmitters(vehicle, end_s)
        lla = recording.lla(vehicle, np.full(len(there.ids), end_s), there.positions) if there else None
        if there is None or lla is None:
            continue
        for id_, strength, place in zip(there.ids, there.strengths.tolist(), rounded(lla).tolist(), strict=True):
            if id_ not in there.unplaced:
                of = f" (datum of {vehicle})" if vehicle else ""
                about = f"true place at the end of the run, strength {strength:g}"
                yield Landmark("transmitter", f"transmitter {id_}{of}", about, (place[0], place[1], place[2]), (), id_)
        if recording.scenario and recording.scenario.datum != "home":
            return  # the same for every vehicle
