"""The picture under the map: where its pixels are on Earth, and what is no map."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image

from arva_hil.model.field import LocalFrame
from arva_hil.model.field.terrain import TerrainGrid
from arva_hil.observers.web.background import REACH_M, Background, map_file, terrain

HOME = (46.0123, 7.7456, 1650.0)


def pixel(made: Background, north_m: float, east_m: float) -> list[int]:
    picture = image.imread(io.BytesIO(made.png))
    side = len(picture)
    at = int((REACH_M - north_m) / (2 * REACH_M) * side), int((east_m + REACH_M) / (2 * REACH_M) * side)
    return [round(255 * float(value)) for value in picture[at]]


def test_a_slope_is_bright_towards_the_sun_and_has_contour_lines() -> None:
    cell, n = 0.0002, 100  # 22 m from north to south; it rises to the south-east, so it faces the sun in the north-west
    rows, columns = np.mgrid[:n, :n]
    heights = 1500.0 + 2.0 * (rows + columns)
    grid = TerrainGrid("", HOME[0] + n / 2 * cell, HOME[1] - n / 2 * cell, cell, n, n, heights.tobytes())
    made = terrain(grid)(HOME)
    grey, alpha = pixel(made, 100.5, 100.5)[::3]
    assert (grey, made.about) == (255, "contours 20 m")
    assert alpha > 0
    turned = TerrainGrid("", grid.north_deg, grid.west_deg, cell, n, n, heights[::-1, ::-1].tobytes())
    assert pixel(terrain(turned)(HOME), 100.5, 100.5)[0] == 0
    assert pixel(terrain(grid)((47.0, 7.0, 0.0)), 0, 0)[3] == 0  # there is no height


@pytest.mark.parametrize("suffix", ["tif", "mbtiles"])
def test_a_map_file_lies_where_it_is_on_earth(tmp_path: Path, suffix: str) -> None:
    rasterio = pytest.importorskip("rasterio")
    from rasterio.shutil import copy
    from rasterio.transform import from_bounds
    from rasterio.warp import transform_bounds

    lat, lon, _ = (float(x) for x in LocalFrame(*HOME).lla([100.0, 200.0, 0.0]))  # the corner of four colours
    bounds = transform_bounds("EPSG:4326", "EPSG:3857", lon - 0.01, lat - 0.01, lon + 0.01, lat + 0.01)
    colours = np.zeros((3, 1000, 1000), np.uint8)
    colours[0, :500, :500], colours[1, :500, 500:], colours[2, 500:, 500:] = 255, 255, 255
    where = {"crs": "EPSG:3857", "transform": from_bounds(*bounds, 1000, 1000)}
    with rasterio.open(tmp_path / "map.tif", "w", width=1000, height=1000, count=3, dtype="uint8", **where) as file:
        file.write(colours)
    if suffix == "mbtiles":
        copy(tmp_path / "map.tif", tmp_path / "map.mbtiles", driver="MBTiles", ZOOM_LEVEL_STRATEGY="UPPER")
    made = map_file(tmp_path / f"map.{suffix}")(HOME)
    for north, east, colour in ((10, -10, 0), (10, 10, 1), (-10, 10, 2)):
        assert np.argmax(pixel(made, 100 + north, 200 + east)[:3]) == colour
        assert pixel(made, 100 + north, 200 + east)[3] == 255


def test_what_is_no_map_is_an_error(tmp_path: Path) -> None:
    pytest.importorskip("rasterio")
    (tmp_path / "map.tif").write_text("nothing")
    with pytest.raises(ValueError, match=r"map.tif: cannot be read as a GeoTIFF or MBTiles file: "):
        map_file(tmp_path / "map.tif")
