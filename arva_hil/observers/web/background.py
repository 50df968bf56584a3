"""The picture under the map: a local file, or hillshade and contour lines of the scenario's terrain."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.model.field import LocalFrame
from arva_hil.model.field.terrain import TerrainGrid

REACH_M: Final = 500.0  # from the middle to each side
_PIXELS: Final = 1000
_CONTOURS: Final = 20  # at most
_STEPS_M: Final = (1, 2, 5, 10, 20, 50, 100)
_SUN: Final = (-0.5, 0.5, math.sqrt(0.5))  # north-west, 45° high: east, north, up

Origin = tuple[float, float, float]


class Background(NamedTuple):
    """A picture, PNG, of `REACH_M` to each side of the map's origin. `about`: the distance of its contour lines.

    `source`: draws it once there is an origin.
    """

    png: bytes = b""
    about: str = ""
    source: Source | None = None


Source = Callable[[Origin], Background]
"""Makes the picture around a place: degrees, degrees, metres AMSL."""


def terrain(grid: TerrainGrid) -> Source:
    """Return the source of pictures of a grid of heights."""
    return lambda origin: _shaded(_sampled(grid, origin))


def map_file(path: Path) -> Source:
    """Return the source of pictures of a GeoTIFF or MBTiles file.

    A file with one band of other than bytes has heights. Raises ImportError without rasterio, and ValueError for a file
    that is no map.
    """
    import rasterio
    from rasterio.errors import RasterioError

    try:
        with rasterio.open(path) as file:
            if file.crs is None or not file.count:
                raise ValueError(f"{path}: has no coordinates: expected a GeoTIFF or MBTiles file")
    except RasterioError as error:
        raise ValueError(f"{path}: cannot be read as a GeoTIFF or MBTiles file: {error}") from None
    return lambda origin: _warped(path, origin)


def _warped(path: Path, origin: Origin) -> Background:
    import rasterio
    from rasterio.enums import Resampling
    from rasterio.transform import from_bounds
    from rasterio.vrt import WarpedVRT

    here = f"+proj=aeqd +lat_0={origin[0]} +lon_0={origin[1]} +datum=WGS84 +units=m"
    grid = from_bounds(-REACH_M, -REACH_M, REACH_M, REACH_M, _PIXELS, _PIXELS)
    sized: dict[str, Any] = {"transform": grid, "width": _PIXELS, "height": _PIXELS}
    with rasterio.open(path) as file:
        kinds = [kind.name for kind in file.colorinterp]
        colours = file.colormap(1) if kinds[0] == "palette" else None
        sized["resampling"] = Resampling.nearest if colours else Resampling.bilinear
        with WarpedVRT(file, crs=here, **sized, add_alpha="alpha" not in kinds) as warped:
            bands = warped.read()
    if colours:
        rgb = np.array([colours.get(n, (0, 0, 0, 0))[:3] for n in range(256)], np.uint8)[bands[0]].transpose(2, 0, 1)
    elif bands.dtype == np.uint8:
        rgb = bands[:3] if len(bands) > 3 else np.repeat(bands[:1], 3, axis=0)
    else:
        return _shaded(np.where(bands[-1] > 0, bands[0], np.nan).astype(float))
    return Background(_png(np.dstack([*rgb, bands[-1]])))


def _sampled(grid: TerrainGrid, origin: Origin) -> NDArray[np.float64]:
    """Return heights at the pixels, rows from the north; NaN outside of the grid."""
    frame, metres = LocalFrame(*origin), (np.arange(_PIXELS) + 0.5) / _PIXELS * 2 * REACH_M - REACH_M
    zero = np.zeros(_PIXELS)
    lat = np.asarray(frame.lla(np.stack([-metres, zero, zero], axis=-1))[0])
    lon = np.asarray(frame.lla(np.stack([zero, metres, zero], axis=-1))[1])
    heights = np.frombuffer(grid.heights).reshape(grid.rows, grid.columns)
    down, right = (grid.north_deg - lat) / grid.cell_deg, (lon - grid.west_deg) / grid.cell_deg
    row, column = (np.clip(x.astype(int), 0, most - 2) for x, most in ((down, grid.rows), (right, grid.columns)))
    v, u = (down - row)[:, None], (right - column)[None, :]
    a, b = (heights[np.ix_(row + i, column)] * (1 - u) + heights[np.ix_(row + i, column + 1)] * u for i in (0, 1))
    return np.where((v >= 0) & (v <= 1) & (u >= 0) & (u <= 1), a * (1 - v) + b * v, np.nan)


def _shaded(heights: NDArray[np.float64]) -> Background:
    """Return hillshade and contour lines, transparent so that both themes of the page show through."""
    down, right = np.gradient(heights, 2 * REACH_M / _PIXELS)
    slope = np.sqrt(1 + down**2 + right**2)
    light = (-right * _SUN[0] + down * _SUN[1] + _SUN[2]) / slope - _SUN[2]  # 0 on level ground
    span = float(np.nanmax(heights) - np.nanmin(heights)) if np.isfinite(heights).any() else 0.0
    step = next((one for one in _STEPS_M if span / one <= _CONTOURS), _STEPS_M[-1])
    level = np.floor(heights / step)
    on_line = np.zeros(heights.shape, bool)
    on_line[:-1] |= level[:-1] < level[1:]
    on_line[1:] |= level[1:] < level[:-1]
    on_line[:, :-1] |= level[:, :-1] < level[:, 1:]
    on_line[:, 1:] |= level[:, 1:] < level[:, :-1]
    known = np.isfinite(light) & np.isfinite(heights)
    grey = np.where(light > 0, 255, 0)
    alpha = np.where(known, np.minimum(200, np.abs(np.nan_to_num(light)) * 400), 0)
    picture = np.dstack([grey, grey, grey, alpha])
    picture[on_line & known] = (150, 110, 50, 255)
    return Background(_png(picture.astype(np.uint8)), f"contours {step} m" if on_line.any() else "")


def _png(rgba: NDArray[np.uint8]) -> bytes:
    """Return a picture (rows, columns, 4) as PNG."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    height, width, _ = rgba.shape
    rows = np.hstack([np.zeros((height, 1), np.uint8), rgba.reshape(height, 4 * width)])
    head = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    parts = chunk(b"IHDR", head), chunk(b"IDAT", zlib.compress(rows.tobytes())), chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)
