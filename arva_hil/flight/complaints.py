"""Why the vehicle does not carry out an order: its refusals, its texts, and its sensors that are not healthy."""

from __future__ import annotations

from typing import Any, Final

from arva_hil.flight.status_text import StatusTexts, unwell
from arva_hil.mavlink.codec import RESULTS, dialect

_ORDERS: Final = {
    dialect.MAV_CMD_COMPONENT_ARM_DISARM: "arming",
    dialect.MAV_CMD_DO_SET_MODE: "setting the mode",
    dialect.MAV_CMD_NAV_TAKEOFF: "take-off",
    dialect.MAV_CMD_NAV_LAND: "landing",
}


class Complaints:
    """Remembers the refusal of the last order, the last texts, and the sensors that are not healthy."""

    def __init__(self) -> None:
        self.refused_order = self.refused_result = ""
        self._texts = StatusTexts()
        self._unwell: list[str] = []

    def hear_ack(self, message: Any) -> bool:
        """Use an acknowledgement for us. Returns whether an order was accepted."""
        if message.command not in _ORDERS:
            return False
        if message.result in (dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_IN_PROGRESS):
            return True
        self.refused_order = _ORDERS[message.command]
        self.refused_result = RESULTS.get(message.result, f"result {message.result}").removeprefix("MAV_RESULT_")
        return False

    def hear_text(self, message: Any) -> None:
        if message.severity <= dialect.MAV_SEVERITY_WARNING:
            self._texts.add(message)

    def hear_status(self, message: Any) -> None:
        self._unwell = unwell(message)

    def begin(self, *, keep_texts: bool) -> None:
        """A new order begins. `keep_texts`: earlier texts may explain why it is refused."""
        self.refused_order = self.refused_result = ""
        if not keep_texts:
            self._texts.recent.clear()

    def why(self, *, status: bool = False) -> str:
        """All reasons, for a person. `status`: with the sensors that are not healthy."""
        said = f"not healthy: {', '.join(self._unwell)}" if status and self._unwell else ""
        answer = f"{self.refused_order}: {self.refused_result}" if self.refused_order else ""
        return "; ".join(filter(None, [answer, *self._texts.recent, said]))

    def take_texts(self) -> list[str]:
        """The texts since the last call, each once."""
        return self._texts.take()
