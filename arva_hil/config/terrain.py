"""The terrain of a scenario: an ESRI ASCII grid of heights, as of GDAL, or the autopilot's data."""

import math
import os
from array import array
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

from arva_hil.config.constraints import FLOAT, NamedFile
from arva_hil.config.errors import Problem, ScenarioError, Violation, short
from arva_hil.config.tables import items_of
from arva_hil.config.transmitter import Lla

if TYPE_CHECKING:
    from arva_hil.model.field.terrain import TerrainGrid

AUTOPILOT: Final = "autopilot"
_WHAT: Final = "an ESRI ASCII grid"
_LARGEST: Final = 16 << 20  # bytes
_MOST: Final = 10_000  # rows, columns
_HEADER: Final = ("ncols", "nrows", "xllcorner", "yllcorner", "xllcenter", "yllcenter", "cellsize", "nodata_value")


def _ground(value: Any) -> "TerrainGrid | str | None":
    """Return a grid, or `autopilot`; None for the name of a file."""
    from arva_hil.model.field.terrain import TerrainGrid  # slow to import

    if value == AUTOPILOT:
        return AUTOPILOT
    return value if isinstance(value, TerrainGrid) else None


def ground_conflicts(of: Any) -> Iterator[Violation]:
    """Yield a violation for each known place of a scenario at which its grid has no height."""
    grid, datum = of.terrain, of.datum
    if grid == AUTOPILOT or not isinstance(datum, str | Lla):
        return
    from arva_hil.model.field.geodesy import LocalFrame  # slow to import

    if isinstance(datum, Lla) and grid.height(datum.lat, datum.lon) is None:
        found = f"{grid.source}, which has no height at the datum"
        yield Violation("a terrain around the datum", found, path=("terrain",))
        return
    frame = LocalFrame(datum.lat, datum.lon, datum.alt) if isinstance(datum, Lla) else None
    for path, one in items_of(of, "transmitters"):
        ned = (one.enu[1], one.enu[0], 0.0) if one.enu else one.ned
        if one.depth_m is None or (one.lla is None and (ned is None or frame is None)):
            continue
        place = (one.lla.lat, one.lla.lon) if one.lla else [float(value) for value in frame.lla(ned)[:2]]  # type: ignore[union-attr]
        if grid.height(*place) is None:
            found = f"a transmitter outside of {grid.source}, or over a hole of it"
            yield Violation("a place with a height", found, path=path)


def load_grid(path: str) -> "TerrainGrid":
    """Return the grid in a file. Raises ScenarioError with the first mistake."""
    from arva_hil.config.reading import read_text  # slow to import

    return parse_grid(read_text(path, _WHAT, _LARGEST), path)


def parse_grid(text: str, source: str) -> "TerrainGrid":
    """Return the grid in a text; `source` names it. Raises ScenarioError with the first mistake."""
    from arva_hil.model.field.terrain import TerrainGrid  # slow to import

    def fail(line: int, found: str, expected: str) -> ScenarioError:
        return ScenarioError([Problem(source, line, 1, found, expected)])

    lines = text.split("\n")
    head: dict[str, float] = {}
    number = 0
    while number < len(lines) and (words := lines[number].split()) and words[0][:1].isalpha():
        key = words[0].lower()
        if key not in _HEADER or key in head or len(words) != 2 or not FLOAT.fullmatch(words[1]):
            raise fail(number + 1, repr(short(lines[number].strip())), f"{_WHAT}: {', '.join(_HEADER)}, each a number")
        head[key] = float(words[1])
        number += 1
    for name, other in ("ncols", ""), ("nrows", ""), ("cellsize", ""), ("xllcorner", "x"), ("yllcorner", "y"):
        if name not in head and not (other and f"{other}llcenter" in head):
            raise fail(number + 1, f"no {name}", f"{_WHAT}: a header with {name}")
    rows, columns, cell = (head[name] for name in ("nrows", "ncols", "cellsize"))
    if not (2 <= min(rows, columns) <= max(rows, columns) <= _MOST and rows == int(rows) and columns == int(columns)):
        raise fail(1, f"{columns:g} columns, {rows:g} rows", f"2 to {_MOST} of each")
    west, south = (head.get(f"{axis}llcenter", head.get(f"{axis}llcorner", 0.0) + cell / 2) for axis in "xy")
    if not (0 < cell <= 1 and -180 <= west <= 180 and -90 <= south <= south + (rows - 1) * cell <= 90):
        found = f"an origin of {west:g}, {south:g}, cells of {cell:g}"
        raise fail(1, found, "degrees of WGS-84 (gdalwarp -t_srs EPSG:4326)")
    heights = array("d")
    hole = head.get("nodata_value", -9999.0)
    for row in range(int(rows)):
        line = lines[number + row] if number + row < len(lines) else ""
        try:
            metres = [float(word) for word in line.split()]
        except ValueError:
            raise fail(number + row + 1, repr(short(line.strip())), "heights in metres") from None
        if len(metres) != columns:
            raise fail(number + row + 1, f"{len(metres)} heights", f"{columns:g} in a row, {rows:g} rows")
        if not all(-500 <= one <= 9000 or one == hole for one in metres):
            raise fail(
                number + row + 1, "a height of no place on Earth", f"-500 to 9000 m AMSL, or {hole:g} for a hole"
            )
        heights.extend(math.nan if one == hole else one for one in metres)
    if any(map(str.strip, lines[number + int(rows) :])):
        raise fail(number + int(rows) + 1, "more heights", f"{rows:g} rows, as nrows says")
    north = south + (rows - 1) * cell
    return TerrainGrid(os.path.abspath(source), north, west, cell, int(rows), int(columns), heights.tobytes())


TERRAIN: Final = NamedFile("a file of heights, or autopilot", _ground, load_grid)
