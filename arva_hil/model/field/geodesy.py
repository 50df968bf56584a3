"""Converts WGS-84 latitude, longitude and altitude to local north, east, down and back, exactly.

Degrees and metres; any leading shape (...). Altitudes are above mean sea level for the datum and the vehicle
alike. WGS-84 needs them above its ellipsoid, but the geoid's undulation cancels in their difference to second order
(at most 1 mm in 60 m).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from arva_hil.model.field.arrays import Array, floats, require, vector

_A = 6378137.0  # semi-major axis
_F = 1 / 298.257223563  # flattening
_B = _A * (1 - _F)
_E2 = _F * (2 - _F)  # first eccentricity squared; the second is _E2 / (1 − _F)²


def to_ecef(lat_deg: ArrayLike, lon_deg: ArrayLike, alt_m: ArrayLike) -> Array:
    """Return earth-centred, Earth-fixed position (..., 3), metres."""
    lat, lon, alt = np.radians(lat_deg), np.radians(lon_deg), np.asarray(alt_m, float)
    normal = _A / np.sqrt(1 - _E2 * np.sin(lat) ** 2)
    across = (normal + alt) * np.cos(lat)
    up = (normal * (1 - _E2) + alt) * np.sin(lat)
    return np.stack(np.broadcast_arrays(across * np.cos(lon), across * np.sin(lon), up), axis=-1)


def _from_ecef(ecef: Array) -> tuple[Array, Array, Array]:
    """Return (lat_deg, lon_deg, alt_m), each (...), by Bowring's iteration: two rounds are enough near the ground."""
    x, y, z = ecef[..., 0], ecef[..., 1], ecef[..., 2]
    p = np.hypot(x, y)
    sin, cos = z, p * (1 - _F)  # of the reduced latitude, not yet to scale
    for _ in range(2):
        scale = np.hypot(sin, cos)
        up = z + _E2 / (1 - _F) ** 2 * _B * (sin / scale) ** 3
        out = p - _E2 * _A * (cos / scale) ** 3
        sin, cos = (1 - _F) * up, out
    lat = np.arctan2(up, out)
    alt = p * np.cos(lat) + z * np.sin(lat) - _A * np.sqrt(1 - _E2 * np.sin(lat) ** 2)
    return np.degrees(lat), np.degrees(np.arctan2(y, x)), alt


class LocalFrame:
    """A frame with north, east, down in metres, tangent to the ellipsoid at the datum.

    The datum is WGS-84 latitude and longitude in degrees, altitude in metres above mean sea level. Lists are accepted
    as arrays. Raises ValueError for values that are not numbers, are out of range, or have a wrong shape.

    >>> frame = LocalFrame(46.0, 7.0, 1650.0)
    >>> frame.ned(46.001, 7.0, 1640.0).round(1)  # north, east, down
    array([111.2,   0. ,  10. ])
    >>> [round(float(value), 6) for value in frame.lla([0, 0, 10])]
    [46.0, 7.0, 1640.0]
    """

    def __init__(self, lat_deg: float, lon_deg: float, alt_m: float) -> None:
        lat_deg, lon_deg = float(vector("lat_deg", lat_deg)), float(vector("lon_deg", lon_deg))
        require(
            (-90 <= lat_deg <= 90, f"lat_deg: {lat_deg:g} is out of range (-90…90)"),
            (-180 <= lon_deg <= 180, f"lon_deg: {lon_deg:g} is out of range (-180…180)"),
        )
        self._origin = to_ecef(lat_deg, lon_deg, vector("alt_m", alt_m))
        lat, lon = np.radians(lat_deg), np.radians(lon_deg)
        sin_lat, cos_lat, sin_lon, cos_lon = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
        self._ned_to_ecef = np.array(
            [
                [-sin_lat * cos_lon, -sin_lon, -cos_lat * cos_lon],
                [-sin_lat * sin_lon, cos_lon, -cos_lat * sin_lon],
                [cos_lat, 0.0, -sin_lat],
            ]
        )
        self._origin_floats: tuple[float, ...] = tuple(self._origin.tolist())
        self._axes = tuple(map(tuple, self._ned_to_ecef.T.tolist()))

    def ned(self, lat_deg: ArrayLike, lon_deg: ArrayLike, alt_m: ArrayLike) -> Array:
        """Return position (..., 3) in this frame of latitudes, longitudes and altitudes, each (...)."""
        lat_deg, lon_deg, alt_m = floats("lat_deg", lat_deg), floats("lon_deg", lon_deg), floats("alt_m", alt_m)
        ned: Array = (to_ecef(lat_deg, lon_deg, alt_m) - self._origin) @ self._ned_to_ecef
        return ned

    def ned_of(self, lat_deg: float, lon_deg: float, alt_m: float) -> tuple[float, float, float]:
        """Return `ned` of one place in plain floats, in a sixth of the time."""
        lat, lon = math.radians(lat_deg), math.radians(lon_deg)
        sin, cos = math.sin(lat), math.cos(lat)
        normal = _A / math.sqrt(1 - _E2 * sin * sin)
        across = (normal + alt_m) * cos
        x0, y0, z0 = self._origin_floats
        x, y = across * math.cos(lon) - x0, across * math.sin(lon) - y0
        z = (normal * (1 - _E2) + alt_m) * sin - z0
        (nx, ny, nz), (ex, ey, ez), (dx, dy, dz) = self._axes
        return x * nx + y * ny + z * nz, x * ex + y * ey + z * ez, x * dx + y * dy + z * dz

    def lla(self, ned: ArrayLike) -> tuple[Array, Array, Array]:
        """Return (lat_deg, lon_deg, alt_m), each (...), of positions (..., 3); to 1e-9 degrees and 1 µm."""
        return _from_ecef(self._origin + floats("ned", ned, 3) @ self._ned_to_ecef.T)
