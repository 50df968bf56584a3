"""GeoJSON (RFC 7946): tracks as lines, each frame as a point with its reading, places, and the ellipse as a polygon."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any, BinaryIO, Final

from arva_hil.records.exports.tracks import FlightTrack, Landmark, marks, moment, plain_rows, tracks
from arva_hil.records.reading import Recording
from arva_hil.safe_text import one_line

_LONGEST_LINE: Final = 10_000  # points


def write(recording: Recording, out: BinaryIO) -> None:
    """Write a record as a FeatureCollection, one feature a line. Heights are metres above mean sea level.

    Each feature has a `kind`: found, ellipse, transmitter, track or reading.
    """
    out.write(b'{"type": "FeatureCollection", "features": [\n')
    before = b""
    for feature in _features(recording):
        out.write(before)
        out.write(json.dumps(feature, allow_nan=False).encode())
        before = b",\n"
    out.write(b"\n]}\n")


def _features(recording: Recording) -> Iterator[dict[str, Any]]:
    for mark in marks(recording):
        yield from _mark(mark)
    for track in tracks(recording):
        for part in track.parts():  # a long one has several lines, end to end
            for first in range(0, len(part.rows) - 1, _LONGEST_LINE):
                line = part.lla[first : first + _LONGEST_LINE + 1, [1, 0, 2]].tolist()
                yield _feature("track", "LineString", line, name=one_line(track.name))
        if track.receiver is not None:
            yield from _readings(recording, track)


def _feature(kind: str, shape: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "geometry": {"type": shape, "coordinates": coordinates},
        "properties": {"kind": kind, **properties},
    }


def _mark(mark: Landmark) -> Iterator[dict[str, Any]]:
    lat, lon, alt = mark.lla
    about = {"name": one_line(mark.name), "about": one_line(mark.about)}
    yield _feature(mark.kind, "Point", [lon, lat, alt], **about)
    if mark.outline:
        ring = [[lon, lat] for lat, lon in reversed(mark.outline)]  # anticlockwise
        yield _feature("ellipse", "Polygon", [ring], **about)


def _readings(recording: Recording, track: FlightTrack) -> Iterator[dict[str, Any]]:
    """Yield a point for each frame, with the slots that have a signal."""
    receiver = track.receiver
    assert receiver is not None
    for n, frame in enumerate(plain_rows(track.rows)):
        lat, lon, alt = track.lla[n].tolist()
        time_s = float(track.time_s[n])
        heard: list[dict[str, Any]] = [
            {
                "id": id_,
                "zone": zone,
                "d_cm": d,
                "delta_deg": delta,
                "true_range_m": range_m if range_m == range_m else None,
            }
            for id_, zone, d, delta, range_m in receiver.slots(frame)
            if zone
        ]
        yield _feature(
            "reading",
            "Point",
            [lon, lat, alt],
            name=one_line(track.name),
            utc=moment(recording, time_s),
            time_s=time_s,
            seq=int(receiver.sequence[frame]),
            d_m=heard[0]["d_cm"] / 100 if heard else None,
            heard=heard,
        )
