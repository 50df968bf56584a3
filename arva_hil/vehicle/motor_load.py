"""How hard a vehicle's motors work, as it says itself: what a receiver next to them hears depends on it."""

from __future__ import annotations

from typing import Final

from arva_hil.mavlink.codec import dialect
from arva_hil.vehicle.session import Session

__all__ = ["MotorLoad"]

_VFR_HUD: Final = dialect.MAVLINK_MSG_ID_VFR_HUD
_SERVO_OUTPUT_RAW: Final = dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW
_ASKED_HZ: Final = 4.0
_LOWEST_US, _HIGHEST_US = 1000, 2000


class MotorLoad:
    """Remembers the load of a session's vehicle, 0…1: its throttle in VFR_HUD, or else the mean of the first four
    outputs in SERVO_OUTPUT_RAW. Asks for VFR_HUD; 0 before either comes.
    """

    def __init__(self, session: Session) -> None:
        self.load = 0.0
        self._session = session
        self._has_throttle = False
        session.want({_VFR_HUD: _ASKED_HZ})

    def hear(self) -> None:
        """The session has been fed."""
        for packet in self._session.own:
            if packet.msgid == _VFR_HUD and (message := self._session.parser.decode(packet)) is not None:
                self._has_throttle = True
                self.load = min(1.0, message.throttle / 100)
            elif packet.msgid == _SERVO_OUTPUT_RAW and not self._has_throttle:
                self._take_outputs(self._session.parser.decode(packet))

    def _take_outputs(self, message: object) -> None:
        if message is None or getattr(message, "port", 0) != 0:
            return
        pulses = [getattr(message, f"servo{n}_raw") for n in range(1, 5)]
        shares = [(us - _LOWEST_US) / (_HIGHEST_US - _LOWEST_US) for us in pulses if us]
        if shares:
            self.load = max(0.0, min(1.0, sum(shares) / len(shares)))
