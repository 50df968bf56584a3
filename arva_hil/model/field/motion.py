"""The motion of transmitters: at rest, on timed waypoints, or with another vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from arva_hil.model.field.arrays import Array
from arva_hil.model.field.dipole import Transmitters

Carriers = Mapping[int, tuple[Array, Array]]
"""System id → position (3,) NED, metres, and body → NED (3, 3) of that vehicle now; without the silent ones."""

_NOBODY: Final[Carriers] = {}
_SILENT: Final = 0.0


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
        """The position (3,) at a time, NED, metres."""
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
    """Transmitters of which some move: `motions` by index. Those at rest are never copied.

    `systems`: the vehicles that carry some.
    """

    def __init__(self, rest: Transmitters, motions: Mapping[int, Waypoints | Following]) -> None:
        self.systems = frozenset(one.system for one in motions.values() if isinstance(one, Following))
        self._rest = rest
        self._motions = motions

    @property
    def unplaced(self) -> frozenset[int]:
        """The ids of those at rest whose place is not known."""
        return self._rest.unplaced

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
                strengths[index] = _SILENT
                unplaced.add(rest.ids[index])
            else:
                position, rotation = pose
                positions[index] = position + rotation @ motion.offset
                rotations[index] = rotation @ rest.rotations[index]
        return replace(
            rest, positions=positions, rotations=rotations, strengths=strengths, unplaced=frozenset(unplaced)
        )
