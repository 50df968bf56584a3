"""The magnetic field of the transmitters (eq. 1, 2)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from arva_hil.model.field.arrays import Array, floats, vector
from arva_hil.model.field.blocks import fill_field
from arva_hil.model.field.keying import Keying
from arva_hil.model.field.medium import AIR, Medium

NEAREST_M: Final = 0.01  # nearer than this the field is that at this distance: it stays finite

_MANY: Final = 300  # numbers: blocks are faster from here on

Dipole = Sequence[float]  # position NED [m], axis NED, strength / 4π: seven numbers


@dataclass(frozen=True, eq=False)
class Transmitters:
    """M transmitters at one instant. Lists are accepted as arrays. Raises ValueError if the shapes do not agree.

    `positions`: (M, 3) NED, metres. `rotations`: (M, 3, 3), transmitter to NED; the dipole lies along its x.
    `strengths`: (M,), a ratio: 1 is the reference transmitter.
    `unplaced`: ids of transmitters whose position is not known. They are silent, and have no true range.

    >>> Transmitters((1,), [[20, 5, 0]], [[[1, 0, 0], [0, 1, 0], [0, 0, 1]]], [1.0]).ranges([20, 0, 0])
    {1: 5.0}
    """

    ids: tuple[int, ...]
    positions: Array  # (M, 3) NED, metres
    rotations: Array  # (M, 3, 3) R_t, transmitter → NED; the dipole lies along the transmitter's x
    strengths: Array  # (M,) κ‖m‖; 1 is the reference transmitter
    unplaced: frozenset[int] = frozenset()
    keyings: tuple[Keying, ...] = ()  # of each; empty: it is not known when they send
    medium: Medium = AIR

    def __post_init__(self) -> None:
        m = len(self.ids)
        for name, shape in ("positions", (m, 3)), ("rotations", (m, 3, 3)), ("strengths", (m,)):
            object.__setattr__(self, name, vector(name, getattr(self, name), *shape))
        if len(self.keyings) not in (0, m):
            raise ValueError(f"{len(self.keyings)} keyings: expected {m}, one for each transmitter, or none")

    @cached_property
    def dipoles(self) -> list[Dipole]:
        """All transmitters as plain numbers."""
        axes = self.rotations[:, :, 0]
        numbers: list[Dipole] = np.column_stack((self.positions, axes, self.strengths / (4 * np.pi))).tolist()
        return numbers

    def field_at(self, point: Array) -> Array:
        """The field (M, 3) of each transmitter at a point (3,), NED, as from `dipole_field`, in the medium."""
        strengths, medium = self.strengths, self.medium
        if medium is AIR:
            return field_of(point, self.positions, self.rotations, strengths)
        h = field_of(point, self.positions, self.rotations, strengths * medium.loss(self.positions))
        return medium.applied(h, point - self.positions)

    def ranges(self, point: ArrayLike) -> dict[int, float]:
        """The distance [m] of each transmitter from a point (3,) in NED, by id."""
        at = vector("point", point, 3).tolist()
        every = zip(self.ids, self.positions.tolist(), strict=True)
        return {id_: math.dist(at, place) for id_, place in every if id_ not in self.unplaced}


def dipole_field(points: ArrayLike, positions: ArrayLike, rotations: ArrayLike, strengths: ArrayLike) -> Array:
    """The field (..., M, 3) in NED of each of M dipoles at each of the points (..., 3) in NED, metres.

    `positions` (M, 3) in NED, metres; `rotations` (M, 3, 3) transmitter → NED, the dipole along the transmitter's x;
    `strengths` (M,) κ‖m‖, 1 for the reference transmitter. The field is in units of that: 1 / (2π) on the axis at 1 m.
    Eq. 1 and 2 with A(r) and R_t multiplied out: h = κ‖m‖ / (4π‖r‖³) · (3(a·n)n − a), where a is the dipole's
    axis and n = r/‖r‖, both in NED. Finite everywhere: nearer than 1 cm it is the same as at 1 cm.
    Lists are accepted as arrays. Raises ValueError for wrong shapes.

    >>> field = dipole_field([[1, 0, 0], [0, 2, 0]], [[0, 0, 0]], [[[1, 0, 0], [0, 1, 0], [0, 0, 1]]], [1])
    >>> field.shape
    (2, 1, 3)
    >>> float(field[0, 0, 0]) == 1 / (2 * math.pi)
    True
    """
    points, positions = floats("points", points, 3), floats("positions", positions, None, 3)
    m = len(positions)
    positions = vector("positions", positions, m, 3)
    rotations, strengths = vector("rotations", rotations, m, 3, 3), vector("strengths", strengths, m)
    if points.size < _MANY:
        return field_of(points, positions, rotations, strengths)
    h = np.empty((*points.shape[:-1], m, 3))
    every, all_h = points.reshape(-1, 3), h.reshape(-1, m, 3)
    odd = fill_field(all_h, every, positions, np.ascontiguousarray(rotations[..., 0]), strengths)
    for point, dipole in odd.T:
        of = slice(dipole, dipole + 1)
        all_h[point, of] = field_of(every[point], positions[of], rotations[of], strengths[of])
    return h


def field_of(points: Array, positions: Array, rotations: Array, strengths: Array) -> Array:
    """As `dipole_field`, without checking the arrays."""
    r = points[..., None, :] - positions
    axis = rotations[..., 0]
    distance = np.hypot(np.hypot(r[..., 0], r[..., 1]), r[..., 2])[..., None]
    n = np.empty_like(r)
    n[:] = axis  # remains where r is 0
    np.divide(r, distance, out=n, where=distance > 0)
    inverse = 1 / np.maximum(distance, NEAREST_M)
    along = np.add.reduce(n * axis, axis=-1, keepdims=True)
    h: Array = (strengths / (4 * np.pi))[:, None] * inverse * inverse * inverse * (3 * along * n - axis)
    return h
