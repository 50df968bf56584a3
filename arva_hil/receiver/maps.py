"""The readings of the paper's receiver at many poses: for maps, and for whole flights.

The integers are the same as from a `PaperReceiver` that looks at these poses one after another.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from arva_hil.field import Transmitters
from arva_hil.field.arrays import Array, floats
from arva_hil.field.blocks import BLOCK, field_parts
from arva_hil.field.medium import AIR
from arva_hil.receiver.noise import NoiseSource, noise_bound
from arva_hil.receiver.paper import INNER_M, MID_M, Antennas, outputs, receive, rounded

_NEAR = 1.0001  # fields this much weaker than at the edge of the inner zone are calculated exactly too

Ints = NDArray[np.int64]


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
) -> Readings:
    """The readings at `positions` (N, 3) in NED, metres, turned by `rotations` (N, 3, 3) receiver → NED.

    `antennas`: default those of the paper, with its noise. `seed`: of the noise, as in a scenario.
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
    antennas = antennas or Antennas()
    noise = NoiseSource(antennas.noise, noise_bound(antennas.sensitivity, antennas.floor_range_m), seed)
    there = Readings(*(np.empty((n, m), np.int64) for _ in Readings._fields))
    each = max(1, BLOCK // max(m, 1))
    for start in range(0, n, each):
        block = slice(start, start + each)
        w = None if antennas.noise == "off" else noise.draw(len(positions[block]) * m)
        _read(Readings(*(a[block] for a in there)), positions[block], rotations[block], transmitters, antennas, w)
    return there


def _read(
    there: Readings, positions: Array, rotations: Array, transmitters: Transmitters, antennas: Antennas, w: Array | None
) -> None:
    """One block. `w` (N · M, 3): the noise, NED."""
    n, m = there.d_cm.shape
    h = np.empty((3, m, n))  # parts apart, poses side by side
    x, y, z = np.ascontiguousarray(positions.T)
    odd = []
    for k in range(m):
        *parts, bad = field_parts(
            x, y, z, transmitters.positions[k], transmitters.rotations[k, :, 0], transmitters.strengths[k]
        )
        h[:, k] = parts
        odd += [(i, k) for i in bad.tolist()]
    turn = np.ascontiguousarray(rotations.transpose(1, 2, 0))  # (3, 3, N)
    if w is None:
        signal = [h[0] * turn[0, j] + h[1] * turn[1, j] + h[2] * turn[2, j] for j in range(3)]
    else:
        u = np.ascontiguousarray(w.reshape(n, m, 3).transpose(2, 1, 0))
        parts = [h + q * u for q in antennas.sensitivity]
        signal = [p[0] * turn[0, j] + p[1] * turn[1, j] + p[2] * turn[2, j] for j, p in enumerate(parts)]
    d_cm, delta, zone = _outputs(signal, antennas.kappa_eq)
    there.d_cm[:], there.delta_deg[:], there.zone[:] = d_cm.T, delta.T, zone.T
    for i, k in odd:  # too near or too far for the fast calculation
        noise = np.zeros(3) if w is None else w.reshape(n, m, 3)[i, k]
        q = np.array(antennas.sensitivity)
        one = outputs(receive(transmitters.field_at(positions[i])[k], rotations[i], q, noise), antennas.kappa_eq)
        there.d_cm[i, k], there.delta_deg[i, k], there.zone[i, k] = one


def _outputs(signal: Sequence[Array], kappa_eq: float) -> tuple[Array, Array, Array]:
    """As `outputs`, for x, y and z, each (M, N). The inner zone is checked only where it is possible."""
    x, y, z = signal
    flat = x * x
    flat += y * y
    at_inner = kappa_eq / (4 * math.pi) / INNER_M**3
    near = np.flatnonzero((flat + z * z).ravel() >= (at_inner / _NEAR) ** 2)
    np.sqrt(flat, out=flat)
    d = np.cbrt(np.maximum(flat, 1e-200, out=flat), out=flat)
    np.divide(math.cbrt(kappa_eq / (4 * math.pi)), d, out=d)
    heard = d <= MID_M
    d_cm = np.where(heard, rounded(100 * d), -1.0)
    delta = rounded(np.degrees(np.arctan2(np.where(x < 0, -y, y), np.abs(x))))
    delta = np.where(heard, np.clip(delta, -89, 89, out=delta), -1.0)
    zone = heard.astype(float)
    if len(near):
        exact = outputs(np.stack([x.ravel()[near], y.ravel()[near], z.ravel()[near]], axis=1), kappa_eq)
        for all_of_them, some in zip((d_cm, delta, zone), exact, strict=True):
            all_of_them.ravel()[near] = some
    return d_cm, delta, zone
