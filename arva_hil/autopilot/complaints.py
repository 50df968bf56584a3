"""Why the vehicle does not do as it is told, in its own words: refusals, texts, what it calls not healthy."""

from __future__ import annotations

from typing import Any, Final

from arva_hil.autopilot.mavlink import RESULTS, dialect
from arva_hil.autopilot.status_text import StatusTexts, unwell
from arva_hil.notice import Notice

_ORDERS: Final = {
    dialect.MAV_CMD_COMPONENT_ARM_DISARM: "arming",
    dialect.MAV_CMD_DO_SET_MODE: "setting the mode",
    dialect.MAV_CMD_NAV_TAKEOFF: "take-off",
    dialect.MAV_CMD_NAV_LAND: "landing",
}


class Complaints:
    """Remembers the answer to the last order when it was a refusal, the last texts, and what is not healthy."""

    def __init__(self) -> None:
        self.answer = ""
        self._texts = StatusTexts()
        self._unwell: list[str] = []

    def hear_ack(self, message: Any) -> bool:
        """An acknowledgement for us; whether it is of an order that was taken."""
        if message.command not in _ORDERS:
            return False
        if message.result in (dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_IN_PROGRESS):
            return True
        result = RESULTS.get(message.result, f"result {message.result}").removeprefix("MAV_RESULT_")
        self.answer = f"{_ORDERS[message.command]}: {result}"
        return False

    def hear_text(self, message: Any) -> None:
        if message.severity <= dialect.MAV_SEVERITY_WARNING:
            self._texts.add(message)

    def hear_status(self, message: Any) -> None:
        self._unwell = unwell(message)

    def begin(self, *, keep_texts: bool) -> None:
        """Another order. `keep_texts`: it is perhaps refused for what was said before."""
        self.answer = ""
        if not keep_texts:
            self._texts.recent.clear()

    def why(self, *, status: bool = False) -> str:
        """All of it, for a person; `status`: with what is not healthy."""
        said = f"not healthy: {', '.join(self._unwell)}" if status and self._unwell else ""
        return "; ".join(filter(None, [self.answer, *self._texts.recent, said]))

    def take_notices(self) -> list[Notice]:
        return [Notice("warning", f"the autopilot says: {text}") for text in self._texts.take()]
