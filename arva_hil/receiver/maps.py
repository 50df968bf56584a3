"""The readings of the paper's receiver at many poses: for maps, and for whole flights.

The integers are the same as from a `PaperReceiver` that looks at these poses one after another.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from arva_hil.field import Transmitters
from arva_hil.field.arrays import Array, floats
from arva_hil.field.blocks import replace_by_field
from arva_hil.field.dipole import field_of
from arva_hil.field.medium import AIR
from arva_hil.receiver.noise import noise_bound, noise_of
from arva_hil.receiver.paper import INNER_M, MID_M, Antennas, outputs, receive, rounded
from arva_hil.receiver.reading import Zone

_POSES, _PAIRS = 16384, 65536  # the most poses, and pairs of a pose and a transmitter, of one block
_MARGIN = 1.0001  # of distances: rounding decides nothing

Ints = NDArray[np.int32]
Index = NDArray[np.intp]


class Readings(NamedTuple):
    """The readings at N poses of M transmitters, in their order: `d_cm`, `delta_deg`, `zone` (`Zone`), each (N, M).

    d and δ are −1 if a transmitter is not heard. δ is 0 in the inner zone.
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
    """The readings at `positions` (N, 3) in NED, metres, turned by `rotations` (N, 3, 3) receiver → NED.

    `antennas`: default those of the paper, with its noise. `seed`: of the noise, as in a scenario. `threads`: how many
    calculate; the result is the same.
    Lists are accepted as arrays. Raises ValueError for wrong shapes, and for transmitters in another medium than air.

    >>> east = Transmitters((1,), [[0, 20, 0]], [[[1, 0, 0], [0, 1, 0], [0, 0, 1]]], [1.0])
    >>> there = readings([[0, 0, 0], [0, 10, 0]], [np.eye(3)] * 2, east, Antennas(noise="off"))
    >>> there.d_cm.tolist(), there.delta_deg.tolist(), there.zone.tolist()
    ([[2311], [1155]], [[0], [0]], [[1], [1]])
    """
    positions, rotations = floats("positions", positions, None, 3), floats("rotations", rotations, None, 3, 3)
    n, m = len(positions), len(transmitters.ids)
    if positions.ndim != 2 or rotations.shape != (n, 3, 3):
        raise ValueError(f"rotations: the shape {rotations.shape}, expected {(n, 3, 3)}, one for each position (N, 3)")
    if transmitters.medium is not AIR:
        raise ValueError("transmitters: in another medium than air: ask a receiver for each reading")
    looks = _Looks(positions, rotations, transmitters, antennas or Antennas(), seed)
    blocks = range(0, n, max(1, _PAIRS // max(m, 1)))
    if threads == 1:
        left = list(map(looks.read, blocks))
    else:
        with ThreadPoolExecutor(threads) as pool:
            left = list(pool.map(looks.read, blocks))
    if left:
        looks.read_exactly(*(np.concatenate(of_blocks, axis=-1) for of_blocks in zip(*left, strict=True)))
    return looks.readings


class _Looks:
    """Looks at N poses, and their readings.

    Noise is bounded. So beyond some distance a transmitter cannot be heard, and only random numbers are drawn for it;
    and beyond another one it cannot be in the inner zone, and the third antenna does not matter.
    """

    def __init__(
        self, positions: Array, rotations: Array, transmitters: Transmitters, antennas: Antennas, seed: int
    ) -> None:
        shape = len(positions), len(transmitters.ids)
        self.readings = Readings(*(np.full(shape, silence, np.int32) for silence in (-1, -1, Zone.OUTER)))
        self._positions, self._rotations = positions, rotations
        self._transmitters = transmitters
        self._antennas = antennas
        self._seed = seed
        self._bound = 0.0 if antennas.noise == "off" else noise_bound(antennas.sensitivity, antennas.floor_range_m)
        self._dipoles = np.vstack((transmitters.rotations[:, :, 0].T, transmitters.strengths, self._reach_m2(INNER_M)))

    def _field(self, d: float) -> float:
        """The field that is shown as `d` metres."""
        return self._antennas.kappa_eq / (4 * math.pi) / d**3

    def _reach_m2(self, d: float) -> Array:
        """The squares (M,) of the distances beyond which no transmitter is shown as `d` metres or less."""
        needed = self._field(d) - max(self._antennas.sensitivity) * self._bound
        strongest = np.abs(self._transmitters.strengths) / (2 * math.pi)  # at 1 m
        return np.cbrt(strongest / needed if needed > 0 else np.full(len(strongest), math.inf)) ** 2 * _MARGIN

    def read(self, first: int) -> tuple[Index, Index, Array]:
        """Write the readings of the block of poses from `first` on.

        Returns the poses (K,), transmitters (K,) and noises (3, K) that are left for `read_exactly`.
        """
        m = len(self._transmitters.ids)
        block = slice(first, first + max(1, _PAIRS // max(m, 1)))
        places = np.ascontiguousarray(self._positions[block].T)
        n = places.shape[1]
        away = places[:, None] - self._transmitters.positions.T[:, :, None]  # (3, M, N)
        squared = np.einsum("imn,imn->mn", away, away)
        near = np.flatnonzero(~(squared > self._reach_m2(MID_M)[:, None]))
        transmitter = near // n
        pose = near - transmitter * n
        pair = pose * m + transmitter
        w = self._noise(first * m, n * m, pair)
        dipoles = self._dipoles.take(transmitter, axis=1)
        inner = np.flatnonzero(squared.take(near) <= dipoles[4])
        h = away.reshape(3, -1).take(near, axis=1)
        left = np.concatenate((inner, replace_by_field(h, dipoles[:3], dipoles[3])))
        turns = np.ascontiguousarray(self._rotations[block, :, :2].transpose(1, 2, 0)).reshape(6, n).take(pose, axis=1)
        x, y = (np.einsum("in,in->n", h + q * w, turns[j::2]) for j, q in enumerate(self._antennas.sensitivity[:2]))
        self._write(first * m + pair, x, y)
        return first + pose[left], transmitter[left], w[:, left]

    def _noise(self, first: int, count: int, wanted: Index) -> Array:
        """The noise (3, K), NED, of the `wanted` (K,) of `count` pairs from the number `first` on."""
        if self._antennas.noise == "off":
            return np.zeros((3, len(wanted)))
        rng = np.random.Generator(np.random.PCG64(self._seed).advance(3 * first))
        return noise_of(rng.random((count, 3)).take(wanted, axis=0).T, self._antennas.noise, self._bound)

    def _write(self, pair: Index, x: Array, y: Array) -> None:
        """Write the readings of pairs (K,) outside of the inner zone, from the signals (K,) at the antennas x and y."""
        d_cm, delta_deg, zone = (column.reshape(-1) for column in self.readings)
        squared = x * x + y * y
        heard = np.flatnonzero(squared >= self._field(MID_M) ** 2)
        pair = pair[heard]
        x, y, squared = (one[heard] for one in (x, y, squared))
        d_cm[pair] = rounded(100 * np.cbrt(self._field(1) / np.sqrt(squared)))
        with np.errstate(divide="ignore", over="ignore"):
            delta = rounded(np.degrees(np.arctan(y / (x + 0.0))))  # −0 + 0 is 0: δ has the sign of y there
        delta_deg[pair] = np.minimum(np.maximum(delta, -89), 89)
        zone[pair] = Zone.MID

    def read_exactly(self, pose: Index, transmitter: Index, w: Array) -> None:
        """Write the readings of pairs (K,) as a receiver does it, with the noise w (3, K)."""
        t = self._transmitters
        of_pairs = (one[transmitter][:, None] for one in (t.positions, t.rotations, t.strengths))
        h = field_of(self._positions[pose], *of_pairs)
        signal = receive(h, self._rotations[pose], np.array(self._antennas.sensitivity), w.T[:, None])
        for column, values in zip(self.readings, outputs(signal[:, 0], self._antennas.kappa_eq), strict=True):
            column[pose, transmitter] = values
