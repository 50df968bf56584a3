"""GPX 1.1 and KML 2.2 from templates (`templates/`): texts are escaped, on one line, and without control characters.

Altitudes are metres above mean sea level. In GPX the flight is a track, a place a waypoint, the ellipse of the place
found a closed route, and a point with a signal has d in metres as an extension, `arva:d_m`. In KML the flight is a
`gx:Track` with time and readings, a place a point, the ellipse an area.
"""

from __future__ import annotations

from functools import partial
from typing import BinaryIO, Final

import jinja2

from arva_hil import __version__
from arva_hil.records.exports.tracks import marks, moment, plain_rows, tracks
from arva_hil.records.pictures.style import look_of
from arva_hil.records.reading import Recording
from arva_hil.safe_text import one_line


def _write(template: str, recording: Recording, out: BinaryIO) -> None:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("arva_hil.records.exports"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        finalize=one_line,
    )
    stream = environment.get_template(template).stream(
        version=__version__,
        title=recording.title,
        marks=marks(recording),
        tracks=tracks(recording),
        moment=partial(moment, recording),
        rows=plain_rows,
        colour=_colour,
    )
    stream.enable_buffering(1000)
    stream.dump(out, "utf-8")


def _colour(id_: int) -> str:
    """Return a transmitter's colour of all pictures, in the order of KML."""
    red, green, blue = (look_of(id_)[0][i : i + 2] for i in (1, 3, 5))
    return f"ff{blue}{green}{red}"


write_gpx: Final = partial(_write, "gpx.xml")
write_kml: Final = partial(_write, "kml.xml")
