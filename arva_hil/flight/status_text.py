"""The texts of an autopilot: STATUSTEXT, joined from its chunks, and SYS_STATUS in words."""

from __future__ import annotations

from typing import Any, Final

from arva_hil.mavlink.codec import dialect

_CHUNK: Final = 50  # characters; a shorter chunk is the last one
_MOST_OPEN: Final = 8
_MOST_RECENT: Final = 4


class StatusTexts:
    """Remembers the last few different texts in `recent`, and those that were not taken yet.

    The chunks of several texts may be mixed; "…" stands for a lost chunk.
    """

    def __init__(self) -> None:
        self.recent: list[str] = []
        self._new: list[str] = []
        self._open: dict[int, list[str]] = {}  # chunks by the text's id

    def add(self, message: Any) -> None:
        parts = self._open.pop(message.id, [])
        if message.chunk_seq == 0:
            parts = []
        elif message.chunk_seq > len(parts):
            parts.append("…")
        parts.append(message.text)
        if message.id and len(message.text) == _CHUNK:
            if len(self._open) >= _MOST_OPEN:
                self._open.clear()
            self._open[message.id] = parts
            return
        text = "".join(parts).strip()
        if text and text not in self.recent:
            self.recent = [*self.recent[1 - _MOST_RECENT :], text]
            self._new.append(text)

    def take(self) -> list[str]:
        """The texts since the last call."""
        new, self._new = self._new, []
        return new


def unwell(message: Any) -> list[str]:
    """The sensors that are enabled and not healthy; on a link without a ground station PX4 gives no other reason."""
    bits = message.onboard_control_sensors_enabled & ~message.onboard_control_sensors_health
    sensors = dialect.enums["MAV_SYS_STATUS_SENSOR"]
    names = [sensors[1 << n].name for n in range(32) if bits >> n & 1 and 1 << n in sensors]
    return [name.removeprefix("MAV_SYS_STATUS_").removeprefix("SENSOR_").replace("_", " ").lower() for name in names]
