"""GPX 1.1: the flight as tracks, places as waypoints, the ellipse of the place found as a closed route."""

from __future__ import annotations

from collections.abc import Iterator
from typing import BinaryIO, Final

from arva_hil import __version__
from arva_hil.records.exports.tracks import FlightTrack, Landmark, marks, moment, tracks
from arva_hil.records.exports.xml_text import element, text
from arva_hil.records.reading import Recording

_NAMESPACES: Final = 'xmlns="http://www.topografix.com/GPX/1/1" xmlns:arva="https://arva-hil.invalid/gpx/1"'


def write(recording: Recording, out: BinaryIO) -> None:
    """Write a record as GPX. Elevations are metres above mean sea level.

    A point with a signal has d in metres as an extension, `arva:d_m`.
    """
    for part in _parts(recording):
        out.write(part.encode())


def _parts(recording: Recording) -> Iterator[str]:
    yield '<?xml version="1.0" encoding="UTF-8"?>\n'
    yield f'<gpx version="1.1" creator="arva-hil {text(__version__)}" {_NAMESPACES}>\n'
    yield f"<metadata>\n{element('name', recording.title)}<time>{moment(recording, 0.0)}</time>\n</metadata>\n"
    places = marks(recording)
    for mark in places:
        yield _waypoint(mark)
    for mark in places:
        if mark.outline:
            yield f"<rte>\n{element('name', mark.name + ', 95 %')}"
            yield from (f'<rtept lat="{lat!r}" lon="{lon!r}"></rtept>\n' for lat, lon in mark.outline)
            yield "</rte>\n"
    for track in tracks(recording):
        yield from _track(recording, track)
    yield "</gpx>\n"


def _waypoint(mark: Landmark) -> str:
    lat, lon, alt = mark.lla
    about = f"{element('name', mark.name)}{element('desc', mark.about)}{element('type', mark.kind)}"
    return f'<wpt lat="{lat!r}" lon="{lon!r}">\n<ele>{alt!r}</ele>\n{about}</wpt>\n'


def _track(recording: Recording, track: FlightTrack) -> Iterator[str]:
    yield f"<trk>\n{element('name', track.name)}"
    heard = track.heard_m()
    for part in track.parts():
        yield "<trkseg>\n"
        for n in part:
            lat, lon, alt = track.lla[n].tolist()
            d = float(heard[n])
            of_reading = f"<extensions><arva:d_m>{d!r}</arva:d_m></extensions>" if d == d else ""
            when = moment(recording, float(track.time_s[n]))
            yield f'<trkpt lat="{lat!r}" lon="{lon!r}"><ele>{alt!r}</ele><time>{when}</time>{of_reading}</trkpt>\n'
        yield "</trkseg>\n"
    yield "</trk>\n"
