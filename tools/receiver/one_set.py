"""The field of one transmitter, and its display."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from arva_hil.model.field import dipole_field
from arva_hil.model.field.medium import Medium
from arva_hil.model.receiver.display import Display
from arva_hil.model.receiver.listening import NoiseDraws
from arva_hil.model.receiver.pulsed_options import PulsedOptions

Array = NDArray[np.float64]

KAPPA_EQ: Final = 1.542
AXIS: Final = (1.0, 0.0, 0.0)
EQUATOR: Final = (0.0, 1.0, 0.0)


def options(**more: object) -> PulsedOptions:
    return PulsedOptions(**{"steps": "cm", "start_s": 0.0, **more})  # type: ignore[arg-type]


def field(points: ArrayLike, strength: float = 1.0, medium: Medium | None = None) -> Array:
    """The field (..., 3) at points (..., 3) of a dipole at the origin along x."""
    points = np.asarray(points, float)
    h: Array = dipole_field(points, [[0, 0, 0]], [np.eye(3)], [strength])
    return (medium.applied(h, points[..., None, :]) if medium else h)[..., 0, :]


def highest(tilt_deg: float, antennas: int) -> float:
    """Return the distance beside a tilted dipole at which the signal is strongest, in depths."""
    tilt = math.radians(tilt_deg)
    axis = np.array([math.cos(tilt), 0.0, math.sin(tilt)])
    x = np.linspace(-1, 1, 20_001)
    r = np.stack([x, 0 * x, -np.ones_like(x)], -1)
    distance = np.linalg.norm(r, axis=-1, keepdims=True)
    n = r / distance
    h = (3 * n * (n @ axis)[:, None] - axis) / distance**3
    return abs(float(x[np.argmax(np.linalg.norm(h[:, :antennas], axis=-1))]))


def reach(threshold_na_m: float, h10: float, way: ArrayLike) -> float:
    """Return the largest true distance [m] with a reading."""
    display = Display(options(threshold_na_m=threshold_na_m), KAPPA_EQ)
    near, far = 1.0, 500.0
    while far - near > 1e-3:
        middle = (near + far) / 2
        x, y, z = field(middle * np.asarray(way, float), h10).tolist()
        if display.shown(0, (x, y, z)):
            near = middle
        else:
            far = middle
    return near


class Spread(NamedTuple):
    mean_m: float
    sigma_m: float
    blank: float
    direction_deg: float


def shown_at(signal: Sequence[float], sigma_na_m: float, threshold_na_m: float, pulses: int, seed: int = 1) -> Spread:
    """Return the displayed values of pulses with noise. `signal`: at the antennas, in reference transmitters."""
    chosen = options(noise_na_m=sigma_na_m, threshold_na_m=threshold_na_m)
    display, draws = Display(chosen, KAPPA_EQ), NoiseDraws(seed)
    sigma = sigma_na_m / chosen.scale_na_m
    every = []
    for _ in range(pulses):
        x, y, z = (value + noise for value, noise in zip(signal, draws.draw(sigma), strict=True))
        every.append(display.shown(0, (x, y, z)))
    d = np.array([one.d_cm / 100 for one in every if one])
    directions = np.array([one.delta_deg for one in every if one], float)
    return Spread(float(d.mean()), float(d.std()), 1 - len(d) / pulses, float(directions.std()))
