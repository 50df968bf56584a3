"""Whether a vehicle is a simulator: only a simulator can send its true pose on request."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from arva_hil.field import LocalFrame
from arva_hil.mavlink.codec import Packet, command, dialect
from arva_hil.vehicle.session import Session

_ASK_S: Final = 1.0
_NEAR_M: Final = 200.0  # horizontally, from the estimate to the truth; farther away it belongs to another vehicle
_ASKED: Final = {  # by MAV_AUTOPILOT
    dialect.MAV_AUTOPILOT_ARDUPILOTMEGA: dialect.MAVLINK_MSG_ID_SIMSTATE,
    dialect.MAV_AUTOPILOT_PX4: dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION,
}
_PLACES: Final = {  # the fields of latitude and longitude, degrees · 1e7
    dialect.MAVLINK_MSG_ID_SIMSTATE: ("lat", "lng"),
    dialect.MAVLINK_MSG_ID_SIM_STATE: ("lat_int", "lon_int"),
    dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: ("lat", "lon"),
}


class SimulatorCheck:
    """Requests the true pose of the session's vehicle once a second. `answer`: the message that it answered with.

    ArduPilot's simulator has SIMSTATE, PX4's HIL_STATE_QUATERNION. On a flight controller ArduPilot denies the request,
    and PX4 has nothing to send. Only the vehicle's own packets count, and only a place near its reported position.
    """

    def __init__(self, session: Session) -> None:
        self.answer = ""  # the name of the message
        self._session = session
        self._next = 0.0

    def forget(self) -> None:
        """Forget the answer: it may be another vehicle now."""
        self.answer = ""

    def hear(self, packets: Sequence[Packet]) -> None:
        """Use packets of the vehicle."""
        if self.answer:
            return
        for packet in packets:
            if packet.msgid in _PLACES and (message := self._session.parser.decode(packet)) is not None:
                lat, lon = (getattr(message, name) * 1e-7 for name in _PLACES[packet.msgid])
                if self._is_near(lat, lon):
                    self.answer = message.get_type()

    def poll(self, now: float) -> bytes:
        """The request, if it is due."""
        vehicle = self._session.vehicle
        if vehicle is None or self.answer or now < self._next or vehicle.autopilot not in _ASKED:
            return b""
        self._next = now + _ASK_S
        ask = command(vehicle.system, vehicle.component, dialect.MAV_CMD_REQUEST_MESSAGE, _ASKED[vehicle.autopilot])
        return self._session.encoder.pack(ask)

    def _is_near(self, lat: float, lon: float) -> bool:
        place = self._session.track.last_position
        if place is None:
            return False
        north, east, _ = LocalFrame(place.lat, place.lon, place.alt).ned(lat, lon, place.alt)
        return math.hypot(north, east) < _NEAR_M
