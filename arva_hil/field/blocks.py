"""The field of dipoles at many points, for maps, calculated in blocks that fit into the processor's cache.

The components are separate arrays, so that each operation runs along memory, and no intermediate array is larger than a
block. `dipole.field_of` is faster for few points; receivers use it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from arva_hil.field.arrays import Array

BLOCK: Final = 4096  # points
_NEAREST_M: Final = 0.01  # as in `dipole.field_of`
_SQUARES: Final = (1e-200, 1e200)  # of distances: others lose digits or overflow


def fill_field(out: Array, points: Array, positions: Array, axes: Array, strengths: Array) -> Array:
    """Write the field (N, M, 3) at points (N, 3) of dipoles at `positions` (M, 3) along `axes` (M, 3) to `out`.

    Returns the indices (2, K) of points and dipoles that are too near to each other or too far apart for it.
    """
    odd = []
    for start in range(0, len(points), BLOCK):
        block = slice(start, start + BLOCK)
        x, y, z = np.ascontiguousarray(points[block].T)
        for m, (position, axis, strength) in enumerate(zip(positions, axes, strengths, strict=True)):
            *h, bad = field_parts(x, y, z, position, axis, strength)
            out[block, m, 0], out[block, m, 1], out[block, m, 2] = h
            if len(bad):
                odd.append([bad + start, np.full(len(bad), m)])
    return np.concatenate(odd, axis=1) if odd else np.empty((2, 0), int)


@np.errstate(over="ignore", under="ignore")
def field_parts(
    x: Array, y: Array, z: Array, position: Array, axis: Array, strength: float
) -> tuple[Array, Array, Array, Array]:
    """North, east and down (N,) of the field of one dipole at points (N,), and the indices of the points for which they
    are wrong.
    """
    ax, ay, az = axis.tolist()
    x, y, z = x - position[0], y - position[1], z - position[2]
    squared = x * x
    part = y * y
    squared += part
    np.multiply(z, z, out=part)
    squared += part
    low, high = squared.min(), squared.max()
    bad = np.empty(0, int)
    if not (_SQUARES[0] < low and high < _SQUARES[1]):
        bad = np.flatnonzero(~((squared > _SQUARES[0]) & (squared < _SQUARES[1])))
        x[bad] = y[bad] = z[bad] = 0.0
        squared[bad] = 1.0
    along = x * ax
    np.multiply(y, ay, out=part)
    along += part
    np.multiply(z, az, out=part)
    along += part
    along *= 3.0
    along /= squared
    scale = np.sqrt(squared, out=squared)
    if low < _NEAREST_M**2:
        np.maximum(scale, _NEAREST_M, out=scale)
    np.multiply(scale, scale, out=part)
    scale *= part
    np.divide(strength / (4 * np.pi), scale, out=scale)
    for r, a in (x, ax), (y, ay), (z, az):
        r *= along
        r -= a
        r *= scale
    return x, y, z, bad
