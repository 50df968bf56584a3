"""The transmitters of one vehicle's scenario, at their places for the present datum and the known ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from arva_hil.autopilot.following.received import Received
from arva_hil.autopilot.following.session import Session
from arva_hil.autopilot.following.terrain_requests import TerrainRequests
from arva_hil.config import Scenario
from arva_hil.emulator.build import ground_places, moving_transmitters
from arva_hil.events import Event, GroundFound, GroundMissing
from arva_hil.model.field import LocalFrame

_ANSWER_S: Final = 10.0  # without the autopilot's heights, emit an event after this time


class PlacedTransmitters:
    """Remembers the transmitters in `present`. Those below a ground that is not known are silent.

    With `terrain: autopilot` the heights of the ground are requested. `vehicle`: its name for events.
    """

    def __init__(self, vehicle: str, scenario: Scenario, session: Session) -> None:
        self.present = moving_transmitters(scenario, LocalFrame(0.0, 0.0, 0.0))  # until the datum is known
        self._vehicle = vehicle
        self._scenario = scenario
        self._requests = TerrainRequests(session) if scenario.terrain == "autopilot" else None
        self._frame: LocalFrame | None = None
        self._missing_since: float | None = None
        self._reported = False  # that heights are missing, for this datum

    def place(self, frame: LocalFrame) -> None:
        """Move to a new datum, the origin of `frame`."""
        self._frame, self._missing_since, self._reported = frame, None, False
        if self._requests:
            self._requests.request(ground_places(self._scenario, frame))
        self._build(frame)

    def observe(self, received: Received, now: float) -> list[Event]:
        """Use the heights in the packets that the session received."""
        if not self._requests or not self._requests.on_packets(received) or not self._frame:
            return []
        self._build(self._frame)
        return [GroundFound(now, self._vehicle)]

    def poll(self, now: float) -> tuple[bytes, Sequence[Event]]:
        """Return the requests to the autopilot to send now; an event if heights are missing.

        Called only while there are `present.unplaced`.
        """
        if self._frame is None:
            return b"", ()
        if self._missing_since is None:
            self._missing_since = now
        events: list[Event] = []
        if not self._reported and now - self._missing_since >= (_ANSWER_S if self._requests else 0.0):
            self._reported = True
            terrain = getattr(self._scenario.terrain, "source", "autopilot")
            events.append(GroundMissing(now, self._vehicle, sorted(self.present.unplaced), terrain))
        return self._requests.poll(now) if self._requests else b"", events

    def _build(self, frame: LocalFrame) -> None:
        heights = self._requests.heights if self._requests else None
        self.present = moving_transmitters(self._scenario, frame, heights)
