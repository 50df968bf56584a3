"""WGS-84 against pymap3d."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest

from arva_hil.model.field import LocalFrame
from arva_hil.model.field.geodesy import to_ecef
from tests.every import every

DATUMS = [
    (46.5, 8.0, 2300.0),
    (-43.6, 170.1, 1800.0),
    (0.0, 0.0, 0.0),
    (0.0001, 179.9999, 10.0),  # the date line
    (-33.0, -179.9999, 4500.0),
    (89.9, 45.0, 100.0),
    (-90.0, 0.0, 2800.0),
    (27.99, 86.93, 8848.0),
]


def around(datum: tuple[float, float, float], n: int, seed: int) -> np.ndarray:
    """n points within some kilometres, a few much nearer, (3, n)."""
    rng = np.random.default_rng(seed)
    offset = rng.uniform(-1, 1, (3, n)) * 10 ** rng.uniform(-6, 0, n)
    lat, lon, alt = np.array(datum)[:, None] + offset * [[0.05], [0.05], [3000]]
    return np.array([np.clip(lat, -90, 90), lon, alt])


@every("datum", DATUMS)
def test_north_east_down_agrees_with_pymap3d(datum: tuple[float, float, float]) -> None:
    points = around(datum, 2000, 1)
    expected = np.stack(pymap3d.geodetic2ned(*points, *datum), axis=-1)
    np.testing.assert_allclose(LocalFrame(*datum).ned(*points), expected, rtol=0, atol=1e-8)


@every("datum", DATUMS)
def test_there_and_back(datum: tuple[float, float, float]) -> None:
    frame, points = LocalFrame(*datum), around(datum, 2000, 2)
    ned = frame.ned(*points)
    lat, lon, alt = frame.lla(ned)
    np.testing.assert_allclose(frame.ned(lat, lon, alt), ned, rtol=0, atol=1e-8)
    np.testing.assert_allclose(lat, points[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(alt, points[2], rtol=0, atol=1e-6)
    if abs(datum[0]) < 80:
        np.testing.assert_allclose((lon - points[1] + 180) % 360 - 180, 0, rtol=0, atol=1e-9)


def test_latitude_longitude_agree_with_pymap3d_anywhere_on_earth() -> None:
    rng = np.random.default_rng(3)
    lat0, lon0 = np.degrees(np.arcsin(rng.uniform(-1, 1, 100))), rng.uniform(-180, 180, 100)
    for datum in zip(lat0, lon0, rng.uniform(-400, 9000, 100), strict=True):
        ned = rng.uniform(-20_000, 20_000, (100, 3)) * [1, 1, 0.2]
        expected = pymap3d.ned2geodetic(*ned.T, *datum)
        for got, want, tolerance in zip(LocalFrame(*datum).lla(ned), expected, (1e-9, 1e-9, 1e-6), strict=True):
            np.testing.assert_allclose(got, want, rtol=0, atol=tolerance)


def test_the_axes_of_the_ellipsoid() -> None:
    assert to_ecef(0, 0, 0) == pytest.approx([6378137.0, 0, 0])
    assert to_ecef(0, 90, 10) == pytest.approx([0, 6378147.0, 0], abs=1e-9)
    assert to_ecef(-90, 0, 0) == pytest.approx([0, 0, -6356752.314245], abs=1e-6)


def test_the_datum_is_the_origin_and_down_is_down() -> None:
    frame = LocalFrame(46.5, 8.0, 2300.0)
    assert frame.ned(46.5, 8.0, 2300.0).tolist() == [0, 0, 0]
    assert frame.ned(46.5, 8.0, 2310.0) == pytest.approx([0, 0, -10], abs=1e-8)
    north, east, _ = frame.ned(46.501, 8.002, 2300.0)
    assert north == pytest.approx(111.2, abs=0.5)
    assert east == pytest.approx(153.5, abs=0.5)


def test_the_undulation_of_the_geoid_cancels() -> None:
    """−106 m, the largest there is: what the altitudes leave out moves a point 60 m away by 1 mm."""
    metres = 60 / 111_200
    true = LocalFrame(4.7, 78.8, 500 - 106).ned(4.7 + metres, 78.8, 500 - 106 + 4)
    ours = LocalFrame(4.7, 78.8, 500).ned(4.7 + metres, 78.8, 500 + 4)
    assert 0 < np.linalg.norm(true - ours) < 1.05e-3


def test_shapes() -> None:
    frame = LocalFrame(46.5, 8.0, 2300.0)
    assert frame.ned(46.5, np.full((2, 1), 8.0), np.zeros(5)).shape == (2, 5, 3)
    assert [part.shape for part in frame.lla(np.zeros((2, 5, 3)))] == [(2, 5)] * 3


@every("datum", DATUMS)
def test_one_place_in_plain_floats_is_as_in_arrays(datum: tuple[float, float, float]) -> None:
    frame = LocalFrame(*datum)
    for place in around(datum, 50, seed=4).T.tolist():
        assert frame.ned_of(*place) == pytest.approx(frame.ned(*place).tolist(), abs=1e-8)
