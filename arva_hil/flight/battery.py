"""The last reports of the vehicle's batteries: the reasons against flying on, or against arming.

ArduPilot reports a battery that it has not measured yet as UNHEALTHY (for 0.1 s after its start), and a battery whose
failsafe has triggered as LOW or CRITICAL until it is restarted, also if that failsafe only warns.
"""

from __future__ import annotations

from typing import Any, Final

from arva_hil.mavlink.codec import dialect

_LAST_S: Final = 5.0  # that a report is valid: the vehicle may have been restarted, or be another one
_BATTERY: Final = dialect.MAV_SYS_STATUS_SENSOR_BATTERY
_LOW: Final = {
    dialect.MAV_BATTERY_CHARGE_STATE_LOW,
    dialect.MAV_BATTERY_CHARGE_STATE_CRITICAL,
    dialect.MAV_BATTERY_CHARGE_STATE_EMERGENCY,
    dialect.MAV_BATTERY_CHARGE_STATE_FAILED,
}
_LOW_WORD: Final = "low battery"
_ILL_WORD: Final = "the battery is not healthy"

WANTED: Final = {dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0, dialect.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0}
"""The messages to request, and their rates [Hz]."""


class Battery:
    """Remembers the last report of each battery and of all together. Times are seconds on the caller's clock."""

    def __init__(self) -> None:
        self._said: dict[int, tuple[float, str]] = {}  # by battery id; -1: all together

    def hear(self, message: Any, now: float) -> None:
        """Use a SYS_STATUS or a BATTERY_STATUS."""
        if type(message).id == dialect.MAVLINK_MSG_ID_BATTERY_STATUS:  # `message.id` is a field of it
            state = message.charge_state
            ill = state == dialect.MAV_BATTERY_CHARGE_STATE_UNHEALTHY
            self._said[message.id] = now, _LOW_WORD if state in _LOW else _ILL_WORD if ill else ""
        else:
            known = message.onboard_control_sensors_present & message.onboard_control_sensors_enabled & _BATTERY
            ill = bool(known & ~message.onboard_control_sensors_health)
            self._said[-1] = now, _ILL_WORD if ill else ""

    def why(self, now: float) -> str:
        """The reason against flying, for a person; "" if there is none."""
        words = {word for at, word in self._said.values() if now - at < _LAST_S}
        return next((word for word in (_LOW_WORD, _ILL_WORD) if word in words), "")

    def low(self, now: float) -> bool:
        """Whether a battery is known to be low, not only unknown or not healthy."""
        return self.why(now) == _LOW_WORD
