"""Places the transmitters of one vehicle, with its datum and the known heights of the ground."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from arva_hil.config import Scenario
from arva_hil.emulator.build import moving_transmitters
from arva_hil.emulator.ground import ground_places
from arva_hil.emulator.virtual_receiver import VirtualReceiver
from arva_hil.events import GroundFound, GroundMissing
from arva_hil.field import LocalFrame
from arva_hil.vehicle.session import Session
from arva_hil.vehicle.terrain_requests import TerrainRequests

_ANSWER_S: Final = 10.0  # for the autopilot's heights, until there is an event


class PlacedTransmitters:
    """Remembers which transmitters are silent because the ground above them is not known. With
    `terrain: autopilot` it requests the heights. All `receivers` hear the same transmitters.
    """

    def __init__(self, scenario: Scenario, session: Session, receivers: Sequence[VirtualReceiver]) -> None:
        self._scenario = scenario
        self._news = session.news
        self._receivers = receivers
        self._requests = TerrainRequests(session) if scenario.terrain == "autopilot" else None
        self._frame: LocalFrame | None = None
        self._unplaced: frozenset[int] = frozenset()
        self._tell_at: float | None = None

    def place(self, frame: LocalFrame) -> None:
        """The datum has changed to the origin of `frame`."""
        self._frame, self._tell_at = frame, None
        if self._requests:
            self._requests.request(ground_places(self._scenario, frame))
        self._put(frame)

    def hear(self, now: float) -> None:
        """The session has been fed."""
        if self._requests and self._requests.hear() and self._frame:
            self._put(self._frame)
            self._news.emit(GroundFound(now, self._news.name))

    def poll(self, now: float) -> bytes:
        """The requests to the autopilot to send now."""
        if not self._unplaced:
            return b""
        if self._tell_at is None:
            self._tell_at = now + (_ANSWER_S if self._requests else 0.0)
        if now >= self._tell_at:
            self._tell_at = math.inf  # once for each datum
            terrain = getattr(self._scenario.terrain, "source", "autopilot")
            self._news.emit(GroundMissing(now, self._news.name, sorted(self._unplaced), terrain))
        return self._requests.poll(now) if self._requests else b""

    def _put(self, frame: LocalFrame) -> None:
        there = moving_transmitters(self._scenario, frame, self._requests.heights if self._requests else None)
        self._unplaced = there.unplaced
        for receiver in self._receivers:
            receiver.place(there)
