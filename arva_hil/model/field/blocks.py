"""The field of dipoles at many points, for maps, calculated in blocks that fit into the processor's cache.

The components are separate arrays, so that each operation runs along memory, and no intermediate array is larger than a
block. `dipole.field_of` is faster for few points; receivers use it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from arva_hil.model.field.arrays import Array

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
            h = x - position[0], y - position[1], z - position[2]
            bad = _replace_by_field(h, axis, strength)
            out[block, m, 0], out[block, m, 1], out[block, m, 2] = h
            if len(bad):
                odd.append([bad + start, np.full(len(bad), m)])
    return np.concatenate(odd, axis=1) if odd else np.empty((2, 0), int)


@np.errstate(over="ignore", under="ignore")
def _replace_by_field(r: tuple[Array, Array, Array], axis: Array, strength: float) -> Array:
    """Replace places `r`, seen from a dipole along `axis` (3,), by its field there: north, east and down, each (N,).

    Returns the indices of the places for which the field is wrong: they are too near or too far.
    """
    x, y, z = r
    squared = x * x
    squared += y * y
    squared += z * z
    low, high = squared.min(initial=1.0), squared.max(initial=1.0)
    bad = np.empty(0, int)
    if not (_SQUARES[0] < low and high < _SQUARES[1]):
        bad = np.flatnonzero(~((squared > _SQUARES[0]) & (squared < _SQUARES[1])))
        x[bad] = y[bad] = z[bad] = 0.0
        squared[bad] = 1.0
    along = x * axis[0]
    along += y * axis[1]
    along += z * axis[2]
    along *= 3.0
    along /= squared
    cubed = np.sqrt(squared)
    if low < _NEAREST_M**2:
        np.maximum(cubed, _NEAREST_M, out=cubed)
        np.square(cubed, out=squared)
    cubed *= squared
    scale = np.divide(strength / (4 * np.pi), cubed, out=cubed)
    for part, a in zip(r, axis, strict=True):
        part *= along
        part -= a
        part *= scale
    return bad
