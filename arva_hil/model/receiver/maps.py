"""The readings of the paper's receiver at many poses: for maps, and for whole flights.

The integers are the same as from a `PaperReceiver` that takes samples at these poses one after another.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from arva_hil.model.field import Transmitters
from arva_hil.model.field.arrays import Array, floats, require
from arva_hil.model.field.dipole import dipole_field
from arva_hil.model.field.medium import AIR
from arva_hil.model.receiver.paper import Antennas, draw_noise, noise_bound, outputs, receive

_PAIRS: Final = 40_000  # of a pose and a transmitter, at most, in one block

Ints = NDArray[np.int32]


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
    one_each = positions.ndim == 2 and rotations.shape == (n, 3, 3)
    require(
        (one_each, f"rotations: the shape {rotations.shape}, expected {(n, 3, 3)}, one for each position (N, 3)"),
        (transmitters.medium is AIR, "transmitters: in another medium than air: ask a receiver for each reading"),
    )
    receiver, columns = antennas or Antennas(), np.empty((3, n, len(transmitters.ids)), np.int32)
    step = max(1, _PAIRS // max(len(transmitters.ids), 1))

    def read(first: int) -> None:
        block = slice(first, first + step)
        columns[:, block] = _read(positions[block], rotations[block], transmitters, receiver, seed, first)

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(read, range(0, n, step)))
    return Readings(*columns)


def _read(places: Array, turns: Array, there: Transmitters, antennas: Antennas, seed: int, first: int) -> Array:
    """Return d, δ and zone (3, N, M) of a block of N poses. `first`: the number of its first pose, for the noise."""
    n, m = len(places), len(there.ids)
    rng = np.random.Generator(np.random.PCG64(seed).advance(3 * m * first))
    bound = noise_bound(antennas.sensitivity, antennas.floor_range_m)
    w = draw_noise(rng, n * m, antennas.noise, bound).reshape(n, m, 3)
    h = dipole_field(places, there.positions, there.rotations, there.strengths)
    return np.array(outputs(receive(h, turns, np.array(antennas.sensitivity), w), antennas.kappa_eq))
