"""A vehicle's complaints against an order: refusals, texts, unhealthy sensors, low batteries.

ArduPilot reports a battery that it has not measured yet as UNHEALTHY (for 0.1 s after its start), and a battery whose
failsafe has triggered as LOW or CRITICAL until it is restarted, also if that failsafe only warns.
"""

from __future__ import annotations

from typing import Any, Final

from arva_hil.events.reasons import Reason, Why, because
from arva_hil.mavlink.codec import RESULTS, dialect

_CHUNK: Final = 50  # characters; a shorter chunk is the last one
_MOST_OPEN: Final = 8
_MOST_RECENT: Final = 4


def unwell(message: Any) -> list[str]:
    """Return the enabled sensors that are not healthy. Without a ground station PX4 gives no other reason to refuse."""
    bits = message.onboard_control_sensors_enabled & ~message.onboard_control_sensors_health
    sensors = dialect.enums["MAV_SYS_STATUS_SENSOR"]
    names = [sensors[1 << n].name for n in range(32) if bits >> n & 1 and 1 << n in sensors]
    return [name.removeprefix("MAV_SYS_STATUS_").removeprefix("SENSOR_").replace("_", " ").lower() for name in names]


_ORDERS: Final = {
    dialect.MAV_CMD_COMPONENT_ARM_DISARM: "arming",
    dialect.MAV_CMD_DO_SET_MODE: "setting the mode",
    dialect.MAV_CMD_NAV_TAKEOFF: "take-off",
    dialect.MAV_CMD_NAV_LAND: "landing",
}


class Complaints:
    """Remembers the refusal of the last order, the last few different texts, and the sensors that are not healthy.

    The chunks of several texts may be mixed; "…" stands for a lost chunk.
    """

    def __init__(self) -> None:
        self.refused_order = self.refused_result = ""
        self.recent: list[str] = []
        self._open: dict[int, tuple[int, str]] = {}  # by the text's id: the number of the next chunk, and those before
        self._unwell: list[str] = []

    def on_ack(self, message: Any) -> bool:
        """Use an acknowledgement for us. Returns whether an order was accepted."""
        if message.command not in _ORDERS:
            return False
        if message.result in (dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_IN_PROGRESS):
            return True
        self.refused_order = _ORDERS[message.command]
        self.refused_result = RESULTS.get(message.result, f"result {message.result}").removeprefix("MAV_RESULT_")
        return False

    def on_text(self, message: Any) -> str:
        """Use a STATUSTEXT. Returns the text that it completes if it is a new warning, otherwise ""."""
        if message.severity > dialect.MAV_SEVERITY_WARNING:
            return ""
        due, text = self._open.get(message.id, (0, ""))
        if 0 < message.chunk_seq < due:  # it comes twice
            return ""
        self._open.pop(message.id, None)
        if message.chunk_seq == 0:
            text = ""
        elif message.chunk_seq > due:
            text += "…"
        text = f"{text}{message.text}"
        if message.id and len(message.text) == _CHUNK:
            if len(self._open) >= _MOST_OPEN:
                self._open.clear()
            self._open[message.id] = message.chunk_seq + 1, text
            return ""
        text = text.strip()
        if not text or text in self.recent:
            return ""
        self.recent = [*self.recent[1 - _MOST_RECENT :], text]
        return text

    def on_status(self, message: Any) -> None:
        self._unwell = unwell(message)

    def begin(self, *, keep_texts: bool) -> None:
        """Begin a new order. `keep_texts`: earlier texts may explain why it is refused."""
        self.refused_order = self.refused_result = ""
        if not keep_texts:
            self.recent.clear()

    def why(self, *, status: bool = False) -> list[Reason]:
        """Return all reasons. `status`: with the sensors that are not healthy."""
        reasons = [because(Why.AUTOPILOT_SAID, text=text) for text in self.recent]
        if self.refused_order:
            reasons.insert(0, because(Why.ORDER_REFUSED, order=self.refused_order, result=self.refused_result))
        if status and self._unwell:
            reasons.append(because(Why.SENSORS_ILL, sensors=self._unwell))
        return reasons


_LAST_S: Final = 5.0  # a report is valid for this time: the vehicle may have been restarted, or be another one
_BATTERY: Final = dialect.MAV_SYS_STATUS_SENSOR_BATTERY
_LOW: Final = {
    dialect.MAV_BATTERY_CHARGE_STATE_LOW,
    dialect.MAV_BATTERY_CHARGE_STATE_CRITICAL,
    dialect.MAV_BATTERY_CHARGE_STATE_EMERGENCY,
    dialect.MAV_BATTERY_CHARGE_STATE_FAILED,
}

BATTERY_WANTED: Final = {dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0, dialect.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0}
"""The messages to request, and their rates [Hz]."""


class Battery:
    """Remembers the last report of each battery and of all together. Times are seconds on the caller's clock."""

    def __init__(self) -> None:
        self._said: dict[int, tuple[float, Why | None]] = {}  # by battery id; -1: all together

    def on_message(self, message: Any, now: float) -> None:
        """Use a SYS_STATUS or a BATTERY_STATUS."""
        if type(message).id == dialect.MAVLINK_MSG_ID_BATTERY_STATUS:  # `message.id` is a field of it
            state = message.charge_state
            ill = state == dialect.MAV_BATTERY_CHARGE_STATE_UNHEALTHY
            unless_low = Why.BATTERY_ILL if ill else None
            self._said[message.id] = now, Why.BATTERY_LOW if state in _LOW else unless_low
        else:
            known = message.onboard_control_sensors_present & message.onboard_control_sensors_enabled & _BATTERY
            ill = bool(known & ~message.onboard_control_sensors_health)
            self._said[-1] = now, Why.BATTERY_ILL if ill else None

    def why(self, now: float) -> Why | None:
        """Return the reason against flying, None if there is none: BATTERY_LOW or BATTERY_ILL."""
        reasons = {why for at, why in self._said.values() if now - at < _LAST_S}
        return next((why for why in (Why.BATTERY_LOW, Why.BATTERY_ILL) if why in reasons), None)
