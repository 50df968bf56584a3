"""Pairs of frames of two records: of one instant of the same flight, or of one place in two flights."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.errors import ArvaError
from arva_hil.records.reading import RecordedReceiver, Recording

Floats = NDArray[np.float64]
Index = NDArray[np.intp]

_APART_S: Final = 0.6  # between two frames of one instant
_APART_M: Final = 2.0  # in the median: the same flight
_NEAR_M: Final = 1.0  # between two poses of one place
_NEAR_DEG: Final = 20.0
_FEW: Final = 10
_BLOCK: Final = 1 << 22  # pairs of poses compared at a time


class NotComparable(ArvaError):
    """Two records have too little in common."""


class Paired(NamedTuple):
    """Frames of two receivers that belong together.

    `how`: "time" or "place". `offset_s`: clock of the second record minus that of the first; None if it is not known.
    """

    first: Index
    second: Index
    how: str
    offset_s: float | None


def paired_frames(a: Recording, b: Recording) -> Paired:
    """Pair the frames of two records. Raises NotComparable.

    Records of one flight have the same boot times of the autopilot, so that different clocks of the computers do not
    matter: their offset follows. Frames of two flights are paired if their poses are the same.
    """
    one, two = a.receivers[0], b.receivers[0]
    for record, receiver in ((a, one), (b, two)):
        if not np.isfinite(receiver.position).all(axis=1).any():
            raise NotComparable(f"{record.folder}: frames without poses: nothing can be paired")
    by_time = _by_time(one, two)
    if by_time is not None:
        first, second = by_time
        offset = None
        if a.log_start_s is not None and b.log_start_s is not None:
            boot_s = (one.boot_ms[first] - two.boot_ms[second]) / 1e3
            clocks = b.log_start_s + two.time_s[second] - a.log_start_s - one.time_s[first]
            offset = float(np.median(clocks + boot_s))
        return Paired(first, second, "time", offset)
    first, second = _by_place(one, two)
    if len(first) < _FEW:
        raise NotComparable(
            f"{a.folder} and {b.folder} are of two flights, and only {len(first)} frames are at common places "
            f"(within {_NEAR_M:g} m and {_NEAR_DEG:g}° of heading): compare each with --scenario"
        )
    return Paired(first, second, "place", None)


def _by_time(one: RecordedReceiver, two: RecordedReceiver) -> tuple[Index, Index] | None:
    there_1 = np.flatnonzero(np.isfinite(one.boot_ms) & np.isfinite(one.position).all(axis=1))
    there_2 = np.flatnonzero(np.isfinite(two.boot_ms) & np.isfinite(two.position).all(axis=1))
    if not len(there_1) or not len(there_2):
        return None
    boot_1, boot_2 = one.boot_ms[there_1] / 1e3, two.boot_ms[there_2] / 1e3
    after = np.clip(np.searchsorted(boot_2, boot_1), 1, max(len(boot_2) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(boot_2) - 1)
    nearest = np.where(np.abs(boot_2[after] - boot_1) < np.abs(boot_2[before] - boot_1), after, before)
    close = np.abs(boot_2[nearest] - boot_1) <= _APART_S
    first, second = there_1[close], there_2[nearest[close]]
    if len(first) < _FEW:
        return None
    apart = np.linalg.norm(one.position[first] - two.position[second], axis=1)
    return (first, second) if np.median(apart) <= _APART_M else None


def _by_place(one: RecordedReceiver, two: RecordedReceiver) -> tuple[Index, Index]:
    there_1 = np.flatnonzero(np.isfinite(one.position).all(axis=1))
    there_2 = np.flatnonzero(np.isfinite(two.position).all(axis=1))
    first, second = [], []
    step = max(1, _BLOCK // max(len(there_2), 1))
    for begin in range(0, len(there_1), step):
        some = there_1[begin : begin + step]
        apart = np.linalg.norm(one.position[some][:, None] - two.position[there_2][None], axis=2)
        turn = one.attitude_deg[some, 2][:, None] - two.attitude_deg[there_2, 2][None]
        apart[np.abs((turn + 180) % 360 - 180) > _NEAR_DEG] = np.inf
        nearest = apart.argmin(axis=1)
        close = apart[np.arange(len(some)), nearest] <= _NEAR_M
        first.append(some[close])
        second.append(there_2[nearest[close]])
    return np.concatenate(first), np.concatenate(second)
