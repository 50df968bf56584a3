"""The readings of the paper's receiver at many poses: for maps, and for whole flights.

The integers are the same as from a `PaperReceiver` that takes samples at these poses one after another.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from arva_hil.model.field import Transmitters
from arva_hil.model.field.arrays import Array, floats
from arva_hil.model.field.dipole import field_of, field_times_cube
from arva_hil.model.field.medium import AIR
from arva_hil.model.receiver.noise import noise_bound, noise_of
from arva_hil.model.receiver.paper import INNER_M, MID_M, Antennas, outputs, receive

_PAIRS = 40000  # of a pose and a transmitter, at most, in one block
_MARGIN = 1.0001  # factor of bounds, so that rounding decides nothing
_HALF_DEGREES = 360 / math.pi
_FAR_M = 1e50  # a transmitter farther away has no signal; squares of distances stay finite

Ints = NDArray[np.int32]
Index = NDArray[np.intp]


class Readings(NamedTuple):
    """The readings at N poses of M transmitters, in their order: `d_cm`, `delta_deg`, `zone` (`Zone`), each (N, M).

    d and δ are −1 if a transmitter is not received. δ is 0 in the inner zone.
    """

    d_cm: Ints
    delta_deg: Ints
    zone: Ints


def readings(
    positions: ArrayLike,
    rotations: ArrayLike,
    transmitters: Transmitters,
    antennas: Antennas | None = None,
    *,
    seed: int = 0,
    threads: int = 1,
) -> Readings:
    """Return the readings at `positions` (N, 3) in NED, metres, turned by `rotations` (N, 3, 3) receiver → NED.

    `antennas`: by default the paper's, with its noise. `seed`: of the noise, as in a scenario. `threads`: do not change
    the result. Lists are accepted as arrays. Raises ValueError for wrong shapes, and for a medium other than air.

    >>> import numpy as np
    >>> east = Transmitters((1,), [[0, 20, 0]], [[[1, 0, 0], [0, 1, 0], [0, 0, 1]]], [1.0])
    >>> there = readings([[0, 0, 0], [0, 10, 0]], [np.eye(3)] * 2, east, Antennas(noise="off"))
    >>> there.d_cm.tolist(), there.delta_deg.tolist(), there.zone.tolist()
    ([[2311], [1155]], [[0], [0]], [[1], [1]])
    """
    positions, rotations = floats("positions", positions, None, 3), floats("rotations", rotations, None, 3, 3)
    n = len(positions)
    if positions.ndim != 2 or rotations.shape != (n, 3, 3):
        raise ValueError(f"rotations: the shape {rotations.shape}, expected {(n, 3, 3)}, one for each position (N, 3)")
    if transmitters.medium is not AIR:
        raise ValueError("transmitters: in another medium than air: ask a receiver for each reading")
    looks = _Looks(positions, rotations, transmitters, antennas or Antennas(), seed)
    blocks = range(0, n, looks.poses)
    if threads == 1:
        left = list(map(looks.read, blocks))
    else:
        with ThreadPoolExecutor(threads) as pool:
            left = list(pool.map(looks.read, blocks))
    if left:
        looks.read_exactly(*(np.concatenate(of_blocks) for of_blocks in zip(*left, strict=True)))
    return looks.readings


class _Looks:
    """Samples at N poses, and their readings, in blocks of `poses`.

    Noise is bounded. So a transmitter whose field in the plane of the antennas x and y is too weak is never received,
    and only its random numbers are drawn. Beyond some distance a transmitter cannot be in the inner zone, and the third
    antenna does not matter. The few pairs within that distance are computed at the end.
    """

    def __init__(
        self, positions: Array, rotations: Array, transmitters: Transmitters, antennas: Antennas, seed: int
    ) -> None:
        t = transmitters
        self.poses = max(1, _PAIRS // max(len(t.ids), 1))
        self.readings = Readings(*(np.empty((len(positions), len(t.ids)), np.int32) for _ in Readings._fields))
        self._positions, self._rotations = positions, rotations
        self._transmitters = t
        self._antennas = antennas
        self._q = np.array(antennas.sensitivity)
        self._seed = np.random.SeedSequence(seed)
        self._bound = 0.0 if antennas.noise == "off" else noise_bound(antennas.sensitivity, antennas.floor_range_m)
        self._from = np.ascontiguousarray(t.positions.T)
        self._dipoles = np.ascontiguousarray(t.strengths / (4 * math.pi) * t.rotations[:, :, 0].T)
        noise = max(antennas.sensitivity) * self._bound
        self._weakest = max(self._field(MID_M) - noise, 0.0) ** 2 / _MARGIN
        needed = self._field(INNER_M) - noise
        strongest = 2 * np.linalg.norm(self._dipoles, axis=0)  # at 1 m
        inner_m = np.cbrt(strongest / needed if needed > 0 else np.full(len(strongest), math.inf))
        self._inner_m2 = (inner_m**2 * _MARGIN)[:, None]

    def _field(self, d: float) -> float:
        """Return the field for a reading of `d` metres."""
        return self._antennas.kappa_eq / (4 * math.pi) / d**3

    @np.errstate(all="ignore")  # at a transmitter's place: left for `read_exactly`
    def read(self, first: int) -> tuple[Index, Array]:
        """Write the readings of the block of poses from `first` on.

        Returns the numbers (K,) of the pairs that are left for `read_exactly`, and their random numbers (K, 3).
        """
        m = len(self._transmitters.ids)
        block = slice(first, first + self.poses)
        places = self._positions[block].T.clip(-_FAR_M, _FAR_M, order="C")
        n = places.shape[1]
        turns = np.ascontiguousarray(self._rotations[block, :, :2].transpose(2, 1, 0))
        h, squared = self._fields(places, turns)
        x, y = h
        weakest = squared * squared
        weakest *= squared
        weakest *= self._weakest
        heard = np.flatnonzero(x * x + y * y >= weakest)
        transmitter = heard // n
        pose = heard - transmitter * n
        pair = pose * m + transmitter
        inner = np.flatnonzero(squared <= self._inner_m2)
        inner = inner % n * m + inner // n
        draws = self._draws(first * m, n * m if len(heard) + len(inner) else 0)
        cubed = squared.take(heard)
        cubed *= np.sqrt(cubed)
        signal = h.reshape(2, -1).take(heard, axis=1)
        signal /= cubed
        w = np.einsum("ik,jik->jk", self._noise(draws.take(pair, axis=0)), turns.take(pose, axis=2))
        w *= self._q[:2, None]
        signal += w
        self._write(block, pair, *signal)
        return first * m + inner, draws.take(inner, axis=0)

    def _fields(self, places: Array, turns: Array) -> tuple[Array, Array]:
        """Return the field at the antennas x and y times the cube of the distance, (2, M, N), and its square (M, N)."""
        h, squared = field_times_cube(places[:, None] - self._from[:, :, None], self._dipoles[:, :, None])
        return np.einsum("imn,jin->jmn", h, turns), squared

    def _draws(self, first: int, count: int) -> Array:
        """Return the random numbers (`count`, 3) of the pairs from the number `first` on."""
        if self._antennas.noise == "off":
            return np.zeros((count, 3))
        return np.random.Generator(np.random.PCG64(self._seed).advance(3 * first)).random((count, 3))

    def _noise(self, draws: Array) -> Array:
        """Return the noise (3, K), NED, from random numbers (K, 3)."""
        if self._antennas.noise == "off":
            return np.zeros((3, len(draws)))
        return noise_of(draws.T, self._antennas.noise, self._bound)

    def _write(self, block: slice, pair: Index, x: Array, y: Array) -> None:
        """Write the readings of a block, from the signals (K,) of pairs (K,) at the antennas x and y."""
        d_cm, delta_deg, zone = (column[block] for column in self.readings)
        d_cm.fill(-1)
        delta_deg.fill(-1)
        squared = x * x + y * y
        silent = -(squared < self._field(MID_M) ** 2).astype(np.int32)  # 0, or −1: all bits
        d_cm.reshape(-1)[pair] = _rounded(np.cbrt(self._field(0.005) / np.sqrt(squared))) | silent
        delta = _rounded(_HALF_DEGREES * np.arctan(y / (x + 0.0)))  # −0 + 0 is 0: δ has the sign of y there
        delta_deg.reshape(-1)[pair] = delta.clip(-89, 89) | silent
        zone[:] = d_cm >= 0

    def read_exactly(self, pair: Index, draws: Array) -> None:
        """Write the readings of pairs (K,) exactly as a receiver, from their random numbers (K, 3)."""
        pose, transmitter = np.divmod(pair, len(self._transmitters.ids))
        dipoles = (one[:, None, transmitter] for one in (self._from, self._dipoles))
        h = field_of(self._positions[pose].T[:, None], *dipoles)
        signal = receive(h.T, self._rotations[pose], self._q, self._noise(draws).T[:, None])
        for column, values in zip(self.readings, outputs(signal[:, 0], self._antennas.kappa_eq), strict=True):
            column[pose, transmitter] = values


def _rounded(halves: Array) -> Ints:
    """Round as `paper.rounded`, half away from zero, from the number of halves."""
    whole = halves.astype(np.int32)
    return (whole + (whole > 0)) >> 1
