"""The check before a search takes over a vehicle in the air: it hovers, in a mode that no pilot steers."""

from __future__ import annotations

import math
from typing import Final

from arva_hil.autopilot.following.modes import modes_of
from arva_hil.autopilot.following.received import Received
from arva_hil.autopilot.following.session import Session
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.mavlink.codec import dialect

_STILL_M_S: Final = 0.5
_STILL_S: Final = 1.0
_LOWEST_M: Final = 1.0  # above home
_ARDUPILOT: Final = frozenset(
    (dialect.COPTER_MODE_AUTO, dialect.COPTER_MODE_GUIDED, dialect.COPTER_MODE_LOITER, dialect.COPTER_MODE_BRAKE)
)
_PX4: Final = frozenset((4 << 16 | 3 << 24, 4 << 16 | 4 << 24))  # hold, mission


class Hover:
    """Remembers the mode of the session's vehicle, and since when it hovers."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._mode = -1
        self._since = math.inf

    def hear(self, received: Received) -> None:
        """Use what the session received."""
        for _, heartbeat in received.messages((dialect.MAVLINK_MSG_ID_HEARTBEAT,)):
            self._mode = heartbeat.custom_mode

    def why_not(self, now: float) -> Reason | None:
        """Return the reason why it cannot be taken over now, None if it can. Call it a few times a second."""
        why = self._why_not()
        self._since = math.inf if why else min(self._since, now)
        if not why and now - self._since < _STILL_S:
            return because(Why.JUST_STOPPED)
        return why

    def _why_not(self) -> Reason | None:
        vehicle, place, home = self._session.vehicle, self._session.track.last_position, self._session.home
        if vehicle is None or place is None or home is None:
            return because(Why.HOME_UNKNOWN)
        if not vehicle.armed:
            return because(Why.NOT_ARMED)
        try:
            modes = modes_of(vehicle)
        except ValueError as error:
            return because(Why.ERROR, text=str(error))
        if self._mode not in (_PX4 if modes.px4 else _ARDUPILOT):
            return because(Why.IN_MODE, mode=modes.name(self._mode))
        height, speed = place.alt - home[2], math.hypot(*place.velocity)
        if height < _LOWEST_M:
            return because(Why.NEAR_HOME, height_m=height, least_m=_LOWEST_M)
        return because(Why.MOVES, speed=speed) if speed >= _STILL_M_S else None
