"""Where transmitters are at a time: at rest, on a path of timed waypoints, or with a vehicle that is heard."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from .field import Transmitters

__all__ = ["Follows", "MovingTransmitters", "Path"]

Array = NDArray[np.float64]
PoseOf = Callable[[int], tuple[Array, Array] | None]
"""System id → position (3,) NED, metres, and body → NED (3, 3) of that vehicle now; None: it is not heard."""

_SILENT: Final = 0.0


@dataclass(frozen=True, eq=False)
class Path:
    """Straight lines between waypoints. Raises ValueError unless the times rise and there are two or more.

    `times` (n,): seconds from the start of the run; `points` (n, 3): NED, metres. Before the first time it stays at
    the first point; behind the last it stays at the last, or begins anew there (`loop`).
    """

    times: Array
    points: Array
    end: Literal["stay", "loop"] = "stay"

    def __post_init__(self) -> None:
        n = len(self.times)
        if n < 2 or self.points.shape != (n, 3) or not (np.diff(self.times) > 0).all():
            raise ValueError("a path needs two or more points, each later than the one before")

    def at(self, time_s: float) -> Array:
        """The position (3,) at a time, NED, metres."""
        first, last = self.times[0], self.times[-1]
        if self.end == "loop" and time_s > last:
            time_s = first + (time_s - first) % (last - first)
        return np.array([np.interp(time_s, self.times, axis) for axis in self.points.T])


@dataclass(frozen=True, eq=False)
class Follows:
    """With the vehicle of a system id: `offset` (3,) in its body frame FRD, metres. It turns as that vehicle turns."""

    system: int
    offset: Array


class MovingTransmitters:
    """Remembers transmitters, some of which move: `motions` by index, a `Path` or `Follows` each."""

    def __init__(self, rest: Transmitters, motions: Mapping[int, Path | Follows]) -> None:
        self._rest = rest
        self._motions = motions

    @property
    def follows(self) -> Sequence[int]:
        """The system ids that some of them follow."""
        return [motion.system for motion in self._motions.values() if isinstance(motion, Follows)]

    def at(self, time_s: float, pose_of: PoseOf = lambda system: None) -> Transmitters:
        """All of them at `time_s`, seconds from the start of the run. One whose vehicle is not heard is silent."""
        if not self._motions:
            return self._rest
        rest = self._rest
        now = replace(
            rest, positions=rest.positions.copy(), rotations=rest.rotations.copy(), strengths=rest.strengths.copy()
        )
        for index, motion in self._motions.items():
            if isinstance(motion, Path):
                now.positions[index] = motion.at(time_s)
            elif (pose := pose_of(motion.system)) is None:
                now.strengths[index] = _SILENT
            else:
                position, rotation = pose
                now.positions[index] = position + rotation @ motion.offset
                now.rotations[index] = rotation @ rest.rotations[index]
        return now
