"""The transmitters: their motion and their magnetic field (eq. 1, 2)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from arva_hil.model.field.arrays import Array, floats, vector
from arva_hil.model.field.keying import Keying
from arva_hil.model.field.medium import AIR, Medium

NEAREST_M: Final = 0.01  # nearer than this the field is that at this distance: it stays finite
_FAR_M2: Final = 1e200  # squares of longer distances overflow
_PAIRS: Final = 32_000  # of a point and a dipole, calculated at a time: their arrays fit into the processor's cache

Dipole = Sequence[float]  # position NED [m], moment NED: six numbers


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
        moments = _moments(self.rotations, self.strengths)
        numbers: list[Dipole] = np.column_stack((self.positions, moments)).tolist()
        return numbers

    def field_at(self, point: Array) -> Array:
        """Return the field (M, 3) of each transmitter at a point (3,), NED, as from `dipole_field`, in the medium."""
        air = self.medium is AIR
        strengths = self.strengths if air else self.strengths * self.medium.loss(self.positions)
        moments = _columns(_moments(self.rotations, strengths))
        h = field_of(point[:, None, None], _columns(self.positions), moments)[:, :, 0].T
        return h if air else self.medium.applied(h, point - self.positions)

    def ranges(self, point: ArrayLike) -> dict[int, float]:
        """Return the distance [m] of each transmitter from a point (3,) in NED, by id."""
        at = vector("point", point, 3).tolist()
        every = zip(self.ids, self.positions.tolist(), strict=True)
        return {id_: math.dist(at, place) for id_, place in every if id_ not in self.unplaced}


Carriers = Mapping[int, tuple[Array, Array]]
"""System id → position (3,) NED, metres, and body → NED (3, 3) of that vehicle now; without the silent ones."""

_NOBODY: Final[Carriers] = {}


@dataclass(frozen=True, eq=False)
class Waypoints:
    """Straight lines between points. Raises ValueError if there is no point, or if the times do not increase.

    `times` (n,): seconds from the start of the run; `points` (n, 3): NED, metres. Before the first time the position
    is the first point. After the last time it stays at the last point, or begins again (`loop`).
    """

    times: Array
    points: Array
    end: Literal["stay", "loop"] = "stay"

    def __post_init__(self) -> None:
        n = len(self.times)
        if n < 1 or self.points.shape != (n, 3) or not (np.diff(self.times) > 0).all():
            raise ValueError("waypoints need one point or more, each later than the one before")

    def at(self, time_s: float) -> Array:
        """Return the position (3,) at a time, NED, metres."""
        first, last = self.times[0], self.times[-1]
        if self.end == "loop" and time_s > last > first:
            time_s = first + (time_s - first) % (last - first)
        return np.array([np.interp(time_s, self.times, axis) for axis in self.points.T])


@dataclass(frozen=True, eq=False)
class Following:
    """Carried by the vehicle with a system id. `offset` (3,): in its body frame FRD, metres; turns with the vehicle."""

    system: int
    offset: Array


class MovingTransmitters:
    """Transmitters of which some move: `motions` by index. The others are never copied.

    `systems`: the vehicles that carry some.
    """

    def __init__(self, rest: Transmitters, motions: Mapping[int, Waypoints | Following]) -> None:
        self.systems = frozenset(one.system for one in motions.values() if isinstance(one, Following))
        self.unplaced = rest.unplaced  # the ids of those at rest whose place is not known
        self._rest = rest
        self._motions = motions

    def at(self, time_s: float, carriers: Carriers = _NOBODY) -> Transmitters:
        """Return the transmitters at `time_s`, seconds from the start of the run. Without a carrier they are silent."""
        rest = self._rest
        if not self._motions:
            return rest
        positions, rotations, strengths = rest.positions.copy(), rest.rotations.copy(), rest.strengths.copy()
        unplaced = set(rest.unplaced)
        for index, motion in self._motions.items():
            if isinstance(motion, Waypoints):
                positions[index] = motion.at(time_s)
            elif (pose := carriers.get(motion.system)) is None:
                strengths[index] = 0.0  # silent
                unplaced.add(rest.ids[index])
            else:
                position, rotation = pose
                positions[index] = position + rotation @ motion.offset
                rotations[index] = rotation @ rest.rotations[index]
        return replace(
            rest, positions=positions, rotations=rotations, strengths=strengths, unplaced=frozenset(unplaced)
        )


def dipole_field(points: ArrayLike, positions: ArrayLike, rotations: ArrayLike, strengths: ArrayLike) -> Array:
    """Return the field (..., M, 3) in NED of each of M dipoles at each of the points (..., 3) in NED, metres.

    `positions` (M, 3) in NED, metres; `rotations` (M, 3, 3) transmitter → NED, the dipole along the transmitter's x;
    `strengths` (M,) κ‖m‖, 1 for the reference transmitter, whose field is 1 / (2π) on the axis at 1 m.
    Eq. 1 and 2: h = κ‖m‖ / (4π‖r‖³) · (3(a·n)n − a), with the dipole's axis a and n = r/‖r‖. Within 1 cm the field is
    that at 1 cm. Lists are accepted as arrays. Raises ValueError for wrong shapes.

    >>> field = dipole_field([[1, 0, 0], [0, 2, 0]], [[0, 0, 0]], [[[1, 0, 0], [0, 1, 0], [0, 0, 1]]], [1])
    >>> field.shape
    (2, 1, 3)
    >>> round(float(field[0, 0, 0]) * 2 * math.pi, 12)
    1.0
    """
    points, positions = floats("points", points, 3), floats("positions", positions, None, 3)
    m = len(positions)
    positions = vector("positions", positions, m, 3)
    rotations, strengths = vector("rotations", rotations, m, 3, 3), vector("strengths", strengths, m)
    every, h = points.reshape(-1, 3), np.empty((points.size // 3, m, 3))
    dipoles = _columns(positions), _columns(_moments(rotations, strengths))
    step = max(1, _PAIRS // max(m, 1))
    for first in range(0, len(every), step):
        block = slice(first, first + step)
        h[block] = field_of(np.ascontiguousarray(every[block].T)[:, None], *dipoles).T
    return h.reshape(*points.shape[:-1], m, 3)


@np.errstate(all="ignore")  # `one_field` is used where the formula fails
def field_of(places: Array, positions: Array, moments: Array) -> Array:
    """Return the field (3, M, N) of dipoles at places, NED. Arguments: (3, M, N), with 1 for a constant M or N.

    `moments`: axis times strength / 4π.
    """
    h = places - positions
    squared, along = _dot(h, h), _dot(h, 3 * moments)
    along /= squared
    h *= along
    h -= moments
    h /= squared * np.sqrt(squared)
    if not (squared.min(initial=1.0) > NEAREST_M**2 and squared.max(initial=1.0) < _FAR_M2):
        all_r, all_moments = np.broadcast_arrays(places - positions, moments)
        for m, n in np.argwhere(~((squared > NEAREST_M**2) & (squared < _FAR_M2))).tolist():
            h[:, m, n] = one_field(*all_r[:, m, n].tolist(), *all_moments[:, m, n].tolist())[1:]
    return h


def _dot(a: Array, b: Array) -> Array:
    """Return the scalar products (M, N). `einsum` would round differently for other shapes."""
    product: Array = a[0] * b[0]
    product += a[1] * b[1]
    product += a[2] * b[2]
    return product


def one_field(
    north: float, east: float, down: float, mn: float, me: float, md: float
) -> tuple[float, float, float, float]:
    """Return the distance [m], and the field in NED, of one dipole at one place.

    The formula of `field_of` in plain numbers: one reading takes a third of the time. `north`, `east`, `down`: from the
    dipole to the place; `mn`, `me`, `md`: its moment.
    """
    distance = math.hypot(north, east, down)
    inverse = 1 / (distance if distance > NEAREST_M else NEAREST_M)
    size = inverse * inverse * inverse
    if distance == 0:  # as along the axis
        return 0.0, 2 * size * mn, 2 * size * me, 2 * size * md
    north, east, down = north / distance, east / distance, down / distance
    along = 3 * (north * mn + east * me + down * md)
    return distance, size * (along * north - mn), size * (along * east - me), size * (along * down - md)


def _moments(rotations: Array, strengths: Array) -> Array:
    """Return the moments (M, 3): axis times strength / 4π."""
    moments: Array = (strengths / (4 * np.pi))[:, None] * rotations[:, :, 0]
    return moments


def _columns(rows: Array) -> Array:
    """Return vectors (M, 3) as (3, M, 1), for `dipole_field`."""
    return np.ascontiguousarray(rows.T)[:, :, None]
