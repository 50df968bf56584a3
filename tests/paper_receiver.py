"""The paper's receiver among transmitters, asked for one reading at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from arva_hil.model.field import Mount, Transmitters
from arva_hil.model.receiver import Antennas, Look, PaperReceiver, Pose, Reading

Array = NDArray[np.float64]


class Receiver:
    """`transmitters` may be set anew. Each call is one look; `more`: arguments of `PaperReceiver`."""

    def __init__(
        self, transmitters: Transmitters, antennas: Antennas, *more: Any, mount: Mount | None = None, **named: Any
    ) -> None:
        self.transmitters = transmitters
        self._mount = mount or Mount()
        self._model = PaperReceiver(antennas, *more, **named)

    def pose(self, position: Any, attitude: Any) -> tuple[Array, Array]:
        """The receiver's own position and rotation from the vehicle's position and attitude."""
        return self._mount.pose(position, attitude)

    def read(self, position: Array, rotation: Array, noise: Array | None = None) -> Reading:
        return self._look(Pose(position, rotation), noise)

    def nothing(self) -> Reading:
        return self._look(None)

    def _look(self, pose: Pose | None, noise: Array | None = None) -> Reading:
        self._model.look(Look(0.0, pose, self.transmitters, noise))
        return self._model.show(0.0)
