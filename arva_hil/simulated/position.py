"""The reported position of the built-in vehicle: its frame at home, and the slow error of a GPS."""

from __future__ import annotations

import math
import random
from math import remainder
from typing import Final

from arva_hil.model.field.geodesy import LocalFrame
from arva_hil.simulated.multirotor import Vector

_NODE_US: Final = 1_000_000
_REMEMBERED: Final = math.exp(-_NODE_US / 30e6)  # of the raw error after a second
_SLOW: Final = math.exp(-_NODE_US / 5e6)  # of the smoothed one
_SMOOTHED: Final = math.sqrt((1 - _SLOW) / (1 + _SLOW) * (1 + _SLOW * _REMEMBERED) / (1 - _SLOW * _REMEMBERED))
# by which smoothing reduces the standard deviation


class Home:
    """The place where the vehicle was switched on (degrees, metres above mean sea level), and the frame there."""

    def __init__(self, lat_deg: float, lon_deg: float, alt_m: float) -> None:
        self.alt_m = alt_m
        self._frame = LocalFrame(lat_deg, lon_deg, alt_m)
        self._cell: tuple[int, ...] = ()
        self._linear: list[list[float]] = []

    def lla(self, ned: Vector) -> Vector:
        """Return latitude and longitude in degrees, altitude in metres above mean sea level."""
        lat, lon, alt = self._frame.lla(ned)
        return float(lat), float(lon), float(alt)

    def lla_fast(self, ned: Vector) -> Vector:
        """Return `lla` within 0.1 mm in a tenth of the time: linear in each cube of 16 m."""
        n, e, d = ned
        cell = round(n / 16), round(e / 16), round(d / 16)
        x, y, z = cell[0] * 16.0, cell[1] * 16.0, cell[2] * 16.0
        if cell != self._cell:
            corners = self._frame.lla([(x, y, z), (x + 1, y, z), (x, y + 1, z), (x, y, z + 1)])
            self._linear = [[float(v[0]), *(remainder(w, 360.0) for w in (v[1:] - v[0]).tolist())] for v in corners]
            self._cell = cell
        n, e, d = n - x, e - y, d - z
        (a, a_n, a_e, a_d), (b, b_n, b_e, b_d), (c, c_n, c_e, c_d) = self._linear
        lon = remainder(b + b_n * n + b_e * e + b_d * d, 360.0)  # from the other side of the date line
        return a + a_n * n + a_e * e + a_d * d, lon, c + c_n * n + c_e * e + c_d * d


class PositionError:
    """The error of an estimated position: a Gauss-Markov process on each axis, smoothed as by an estimator.

    `sigma`: its standard deviation [m]. The correlation time is 30 s, the low-pass filter has 5 s: the error drifts and
    does not jitter. It begins with 0, because the estimator begins at home. A value is drawn each second, and
    interpolated. Remembers the last second; the same seed gives the same error at the same time.
    """

    def __init__(self, sigma: float, seed: int) -> None:
        self._random = random.Random(seed)
        self._node = 0
        self._raw_sigma = sigma / _SMOOTHED
        self._raw = self._from = self._to = (0.0, 0.0, 0.0)

    def at(self, time_us: int) -> Vector:
        """Return the error NED [m], to be added to the true position. Time never goes back."""
        if not self._raw_sigma:
            return self._raw
        while self._node < time_us // _NODE_US:
            self._node += 1
            self._advance()
        share = time_us / _NODE_US - self._node
        (a, b, c), (d, e, f) = self._from, self._to
        return a + (d - a) * share, b + (e - b) * share, c + (f - c) * share

    def _advance(self) -> None:
        fresh = math.sqrt(1 - _REMEMBERED**2)
        self._raw = _mixed(self._raw, _REMEMBERED, self._draw(), fresh)
        self._from, self._to = self._to, _mixed(self._to, _SLOW, self._raw, 1 - _SLOW)

    def _draw(self) -> Vector:
        gauss = self._random.gauss
        return gauss(0, self._raw_sigma), gauss(0, self._raw_sigma), gauss(0, self._raw_sigma)


def _mixed(a: Vector, of_a: float, b: Vector, of_b: float) -> Vector:
    return a[0] * of_a + b[0] * of_b, a[1] * of_a + b[1] * of_b, a[2] * of_a + b[2] * of_b
