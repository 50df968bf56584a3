"""Readings of a receiver without ids that found transmitters explain; the others are of another transmitter."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.search.strategies import dipole
from arva_hil.search.strategies.strategy import Found, Observation

_DOWNS: Final = (-1.0, 0.5, 2.0, 4.0)  # initial depths below the ground, m
_POSE_M: Final = 0.3  # error of the receiver's place
_ROUNDS: Final = 20
_NEAR: Final = 0.8  # share of the expected d: a nearer reading is of another transmitter
_ALIKE: Final = 1.2  # multiple of the expected d above which δ does not distinguish transmitters
_ASIDE_DEG: Final = 40.0  # largest deviation of δ

Array = NDArray[np.float64]


def dipole_at(found: Found, past: Iterable[Observation]) -> Array:
    """Return the dipole (7,) at a place found that fits its readings best."""
    readings = dipole.DipoleReadings()
    for o in past:
        if o.heard:
            for measured in o.measurements:
                readings.add(o.position, o.rotation, *measured, o.time_s, o.ground)
    moments = dipole.MOMENT * np.array([(1, 0, 0), (0, 1, 0), (0.7, 0.7, 0), (0.7, -0.7, 0), (0, 0, 1)])
    level = float(readings.level(np.array([[found.north, found.east, 0, 0, 0, 0, 0]]))[0])
    x = np.array([[found.north, found.east, level + down, *moment, 0.0] for down in _DOWNS for moment in moments])
    fit, _ = dipole.refine(x, np.full(len(x), 0.01), readings, _POSE_M, _ROUNDS)
    best: Array = fit.x[int(np.argmin(fit.cost))]
    return best


def explains(x: Array, o: Observation) -> bool:
    """Return True if a reading is of a dipole (7,): a frame has the nearest, so another would be nearer."""
    away = np.array(o.position) - x[:3]
    rho = max(float(np.linalg.norm(away)), 0.1)
    n, moment = away / rho, x[3:6]
    h_x, h_y, h_z = ((3 * (moment @ n) * n - moment) @ o.rotation).tolist()
    strength = math.hypot(h_x, h_y, h_z) if o.inner else math.hypot(h_x, h_y)
    expected_m = rho * max(strength, 1e-9) ** (-1 / 3)
    if o.d_m < _NEAR * expected_m:
        return False
    if o.inner or o.d_m > _ALIKE * expected_m:
        return True
    aside = math.degrees(math.atan2(h_y, h_x) - x[6]) - o.delta_deg
    return abs((aside + 90) % 180 - 90) < _ASIDE_DEG
