"""Requests the height of the ground from an autopilot with terrain data: TERRAIN_CHECK, answered by TERRAIN_REPORT.

https://mavlink.io/en/services/terrain.html
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from arva_hil.autopilot.following.session import Received, Session
from arva_hil.mavlink.codec import dialect

LatLon = tuple[float, float]  # degrees, to 1e-7

_EVERY_S: Final = 0.2  # between two requests
_HEIGHTS_M: Final = (-500.0, 9000.0)


class TerrainRequests:
    """Places whose height is wanted, and the answers in `heights` [m AMSL].

    Each place is requested until the autopilot answers: it may have to fetch its data first.
    """

    def __init__(self, session: Session) -> None:
        self.heights: dict[LatLon, float] = {}
        self._session = session
        self._open: list[LatLon] = []
        self._next_s = -math.inf

    def request(self, places: Sequence[LatLon]) -> None:
        """Request these places from now on."""
        self.heights = {}
        self._open = list(dict.fromkeys(places))

    def on_packets(self, received: Received) -> bool:
        """Use what the session received. Returns True if the last missing answer is among them."""
        if not self._open:
            return False
        low, high = _HEIGHTS_M
        for _, message in received.messages((dialect.MAVLINK_MSG_ID_TERRAIN_REPORT,)):
            place = message.lat / 1e7, message.lon / 1e7
            if message.spacing and low <= message.terrain_height <= high and place in self._open:
                self._open.remove(place)
                self.heights[place] = message.terrain_height
        return not self._open

    def poll(self, now: float) -> bytes:
        """Return the next request, if it is due."""
        if not self._open or now < self._next_s or not self._session.reachable:
            return b""
        self._next_s = now + _EVERY_S
        place = self._open.pop(0)
        self._open.append(place)
        lat, lon = place
        return self._session.encoder.pack(dialect.MAVLink_terrain_check_message(round(lat * 1e7), round(lon * 1e7)))
