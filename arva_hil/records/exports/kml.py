"""KML 2.2 with `gx:Track`: the flight with time and readings, places as points, the ellipse as an area."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import BinaryIO, Final

from arva_hil.records.exports.tracks import FlightTrack, Landmark, marks, moment, plain_rows, tracks
from arva_hil.records.exports.xml_text import element, text
from arva_hil.records.pictures.style import look_of
from arva_hil.records.reading import Recording

_HEAD: Final = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">
<Document>
"""
_STYLES: Final = """<Style id="receiver"><LineStyle><color>ffb27200</color><width>3</width></LineStyle></Style>
<Style id="search"><LineStyle><color>ff009fe6</color><width>2</width></LineStyle></Style>
<Style id="found">
<IconStyle><color>ff005ed5</color><scale>1.2</scale></IconStyle>
<LineStyle><color>ff005ed5</color><width>2</width></LineStyle><PolyStyle><color>40005ed5</color></PolyStyle></Style>
"""
_SCHEMA: Final = """<Schema id="reading">
<gx:SimpleArrayField name="d_m" type="float"><displayName>d of the nearest, m</displayName></gx:SimpleArrayField>
<gx:SimpleArrayField name="true_range_m" type="float"><displayName>true range, m</displayName></gx:SimpleArrayField>
</Schema>
"""
_TAIL: Final = "</Document>\n</kml>\n"


def write(recording: Recording, out: BinaryIO) -> None:
    """Write a record as KML. Altitudes are absolute: metres above mean sea level."""
    for part in _parts(recording):
        out.write(part.encode())


def _parts(recording: Recording) -> Iterator[str]:
    yield _HEAD
    yield element("name", recording.title)
    yield _STYLES
    places = marks(recording)
    for id_ in dict.fromkeys(mark.id for mark in places if mark.kind == "transmitter"):
        yield _look(id_)
    yield _SCHEMA
    for mark in places:
        yield from _mark(mark)
    for track in tracks(recording):
        yield from _track(recording, track)
    yield _TAIL


def _look(id_: int | None) -> str:
    """Return the style of a transmitter: the viewer's pin in the transmitter's colour of all pictures."""
    red, green, blue = (look_of(id_)[0][i : i + 2] for i in (1, 3, 5))
    colour = f"<color>ff{blue}{green}{red}</color><scale>1.1</scale>"
    return f'<Style id="transmitter{id_}"><IconStyle>{colour}</IconStyle></Style>\n'


def _mark(mark: Landmark) -> Iterator[str]:
    lat, lon, alt = mark.lla
    style = f"transmitter{mark.id}" if mark.kind == "transmitter" else mark.kind
    about = element("description", mark.about) + f"<styleUrl>#{style}</styleUrl>\n"
    point = (
        f"<Point><altitudeMode>clampToGround</altitudeMode><coordinates>{lon!r},{lat!r},{alt!r}</coordinates></Point>"
    )
    yield f"<Placemark>\n{element('name', mark.name)}{about}{point}\n</Placemark>\n"
    if mark.outline:
        edge = " ".join(f"{lon!r},{lat!r}" for lat, lon in reversed(mark.outline))
        ring = f"<outerBoundaryIs><LinearRing><coordinates>{edge}</coordinates></LinearRing></outerBoundaryIs>"
        yield f"<Placemark>\n{element('name', mark.name + ', 95 %')}{about}<Polygon>{ring}</Polygon>\n</Placemark>\n"


def _track(recording: Recording, track: FlightTrack) -> Iterator[str]:
    style = "receiver" if track.receiver is not None else "search"
    yield f"<Placemark>\n{element('name', track.name)}<styleUrl>#{style}</styleUrl>\n"
    yield "<gx:Track>\n<altitudeMode>absolute</altitudeMode>\n"
    for time_s in plain_rows(track.time_s):
        yield f"<when>{moment(recording, time_s)}</when>\n"
    for lat, lon, alt in plain_rows(track.lla):
        yield f"<gx:coord>{lon!r} {lat!r} {alt!r}</gx:coord>\n"
    if track.receiver is not None:
        yield '<ExtendedData><SchemaData schemaUrl="#reading">\n'
        yield from _array("d_m", plain_rows(track.heard_m()))
        yield from _array("true_range_m", plain_rows(track.receiver.true_range_m[track.receiver.begins[track.rows]]))
        yield "</SchemaData></ExtendedData>\n"
    yield "</gx:Track>\n</Placemark>\n"


def _array(name: str, values: Iterable[float]) -> Iterator[str]:
    yield f'<gx:SimpleArrayData name="{text(name)}">\n'
    for value in values:
        yield f"<gx:value>{'' if math.isnan(value) else repr(value)}</gx:value>\n"
    yield "</gx:SimpleArrayData>\n"
