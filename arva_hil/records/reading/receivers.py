"""The readings of one receiver as columns of numbers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.signedinteger[Any]]

NO_ID: Final = -1


@dataclass(frozen=True, eq=False)
class RecordedReceiver:
    """The readings of one receiver: N frames, and R slots in the order of the frames, one or more for each frame.

    An empty cell is NaN, or NO_ID for an id. The slots of frame n are those at `rows(n)`.

    `vehicle`, `receiver`: its names in the scenario, "" in a record of one receiver. Times count from the start of the
    run. The pose is the receiver's true one, NED from the datum. Slots are nearest first, empty ones last. Empty slots
    have zone 0 and the true range of a transmitter without a slot. A slot whose transmitter is not received at the
    moment has its id and zone 0.
    """

    vehicle: str
    receiver: str
    sequence: Ints  # (N,)
    time_s: Floats  # (N,)
    boot_ms: Floats  # (N,)
    position: Floats  # (N, 3) m, NED
    attitude_deg: Floats  # (N, 3) roll, pitch, yaw
    pose_age_ms: Floats  # (N,)
    reported: Floats  # (N, 3) m, NED: the receiver's place by the vehicle's report
    late_ms: Floats  # (N,) delay of the frame after its instant
    begins: Ints  # (N + 1,) the first slot of each frame, and R
    id: Ints  # (R,)
    zone: Ints  # (R,)
    d_cm: Ints  # (R,)
    delta_deg: Ints  # (R,)
    true_range_m: Floats  # (R,)
    fault_sets: tuple[tuple[str, ...], ...]
    fault_set: Ints  # (N,) index into `fault_sets`, the faults that changed the frame

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def name(self) -> str:
        """For a person, "" in a record of one receiver."""
        return f"{self.vehicle}/{self.receiver}" if self.receiver else ""

    def rows(self, frame: int) -> slice:
        """Return the slots of a frame."""
        return slice(*self.begins[frame : frame + 2].tolist())

    @cached_property
    def ids(self) -> tuple[int, ...]:
        """The transmitters received, by number."""
        return tuple(int(one) for one in np.unique(self.id[self.zone > 0]) if one != NO_ID)

    @property
    def nearest_zone(self) -> Ints:
        """(N,) the innermost zone of all slots; 0 without a signal."""
        return np.maximum.reduceat(self.zone, self.begins[:-1]) if len(self) else self.zone

    @property
    def faults(self) -> tuple[str, ...]:
        """The names of the faults that changed a frame."""
        return tuple(dict.fromkeys(name for names in self.fault_sets for name in names))

    def with_fault(self, name: str) -> NDArray[np.bool_]:
        """Return True (N,) for each frame that the fault changed."""
        has: NDArray[np.bool_] = np.array([name in names for names in self.fault_sets], bool)
        return has[self.fault_set]

    def of_transmitter(self, id_: int) -> tuple[Floats, Floats, Ints, Floats]:
        """Return the readings of one transmitter: d in metres, δ in degrees, zone, true range in metres, each (N,).

        Without a slot of it, d, δ and range are NaN and the zone is 0. δ is NaN in the inner zone.
        """
        rows = np.flatnonzero((self.id == id_) & (self.zone > 0))
        frames, first = np.unique(np.searchsorted(self.begins, rows, side="right") - 1, return_index=True)
        rows = rows[first]
        d_m, delta, range_m = np.full((3, len(self)), np.nan)
        zone = np.zeros(len(self), self.zone.dtype)
        d_m[frames], zone[frames], range_m[frames] = self.d_cm[rows] / 100, self.zone[rows], self.true_range_m[rows]
        delta[frames] = np.where(self.zone[rows] == 1, self.delta_deg[rows], np.nan)
        return d_m, delta, zone, range_m
