"""The paper's receiver at one pose with few transmitters: the calculations of `paper` in plain floats.

An array operation takes as long as some twenty numbers, so with few transmitters this needs a quarter of the
time. The field is that of `field.dipole_field`; `paper.receive` and `paper.outputs` explain the formulas.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from math import atan2, cbrt, hypot
from typing import Final

from arva_hil.model.field.dipole import NEAREST_M, Dipole

FEW: Final = 24  # transmitters: arrays are faster for more

_SMALLEST: Final = 1e-200  # of a field: d stays finite without a field
_DEGREES: Final = 180 / math.pi

Vector = tuple[float, float, float]
Heard = tuple[int, int, int]  # d in cm, δ in degrees, zone


def signals(
    point: Sequence[float],
    turn: Sequence[Sequence[float]],
    sensitivity: Sequence[float],
    dipoles: Sequence[Dipole],
    noise: Sequence[Sequence[float]],
) -> list[tuple[float, Vector]]:
    """The distance [m] of each dipole from `point` (3,) in NED, and its signal at the antennas x, y, z.

    `turn` (3, 3): receiver → NED; `sensitivity` (3,) of the antennas; `noise` (M, 3) in NED.
    """
    north, east, down = point
    (nx, ny, nz), (ex, ey, ez), (dx, dy, dz) = turn
    qx, qy, qz = sensitivity
    heard = []
    for (pn, pe, pd, an, ae, ad, strength), (wn, we, wd) in zip(dipoles, noise, strict=True):
        rn, re, rd = north - pn, east - pe, down - pd
        distance = hypot(rn, re, rd)
        if distance > 0:
            rn, re, rd = rn / distance, re / distance, rd / distance
        else:
            rn, re, rd = an, ae, ad
        inverse = 1 / (distance if distance > NEAREST_M else NEAREST_M)
        size = strength * inverse * inverse * inverse
        along = 3 * (rn * an + re * ae + rd * ad)
        hn, he, hd = size * (along * rn - an), size * (along * re - ae), size * (along * rd - ad)
        x = hn * nx + he * ex + hd * dx + qx * (wn * nx + we * ex + wd * dx)
        y = hn * ny + he * ey + hd * dy + qy * (wn * ny + we * ey + wd * dy)
        z = hn * nz + he * ez + hd * dz + qz * (wn * nz + we * ez + wd * dz)
        heard.append((distance, (x, y, z)))
    return heard


def near(kappa_eq: float, inner_m: float) -> float:
    """A field that is weaker is not in the inner zone."""
    return 0.9999 / inner_m**3 * kappa_eq / (4 * math.pi)


def output(signal: Vector, scale: float, near: float, inner_m: float, mid_m: float) -> Heard | None:
    """The output for a signal at the antennas; None: it is not heard.

    `scale`: d [m] of a field of 1; `near`: a weaker field is not in the inner zone; `inner_m`, `mid_m`: see
    `paper.outputs`.
    """
    x, y, z = signal
    flat = hypot(x, y)
    if (field := hypot(flat, z)) >= near and (d := scale / cbrt(field)) <= inner_m:
        d *= 100
        d_cm = int(d)
        return d_cm + int(2 * (d - d_cm)), 0, 2
    d = scale / cbrt(flat if flat > _SMALLEST else _SMALLEST)
    if d > mid_m:
        return None
    d *= 100
    d_cm = int(d)
    turn = atan2(-y if x < 0 else y, abs(x)) * _DEGREES
    delta = int(turn)
    delta += int(2 * (turn - delta))  # half away from zero, as d
    delta = delta if delta > -89 else -89
    return d_cm + int(2 * (d - d_cm)), delta if delta < 89 else 89, 1
