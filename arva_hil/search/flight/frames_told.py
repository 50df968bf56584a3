"""Reports the frames that a search receives and their places to its observers."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.autopilot.following.pose_track import VehicleState
from arva_hil.events import Event
from arva_hil.events.searches import FrameHeard, TakeOffPoint
from arva_hil.model.field.geodesy import LocalFrame
from arva_hil.model.field.rotation import Mount
from arva_hil.search.mission.outcome import lla
from arva_hil.search.strategies.strategy import Position
from firmware_proto import Frame

_EVERY_S: Final = 0.1


class FramesTold:
    """Emits a `FrameHeard` at most ten times a second. Remembers when it is due next. `mount`: the receiver's."""

    def __init__(self, mount: Mount, emit: Callable[[Event], None]) -> None:
        self._mount = mount
        self._emit = emit
        self._due_s = -math.inf

    def tell(self, frame: Frame, now: float, state: VehicleState | None) -> None:
        """A frame was heard. `state`: the vehicle's, NED from the take-off point, None if it is not known."""
        if now < self._due_s:
            return
        self._due_s = now + _EVERY_S
        if state is None:
            self._emit(FrameHeard(now, frame, None, None))
            return
        place, rotation = self._mount.pose(state.position, state.attitude)
        heading_deg = math.degrees(math.atan2(rotation[1, 0], rotation[0, 0]))
        self._emit(FrameHeard(now, frame, as_position(place), heading_deg))


def take_off_point(now: float, origin: LocalFrame) -> TakeOffPoint:
    """The event of a take-off point that is known from now on."""
    return TakeOffPoint(now, *lla(origin, 0.0, 0.0, 0.0))


def as_position(place: NDArray[np.float64]) -> Position:
    """As numbers of Python."""
    north, east, down = place.tolist()
    return north, east, down
