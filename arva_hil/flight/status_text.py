"""What an autopilot says of itself to a person: STATUSTEXT, put together from its chunks, and SYS_STATUS in words."""

from __future__ import annotations

from typing import Any, Final

from arva_hil.mavlink.codec import dialect

_CHUNK: Final = 50  # characters; a chunk of fewer is the last
_MOST_OPEN: Final = 8
_MOST_RECENT: Final = 4


class StatusTexts:
    """Remembers the last few texts that differ, in `recent`, and those that nobody has taken yet.

    Chunks of several texts may come mixed; "…" stands for those that were lost.
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
        """What is new since the last call."""
        new, self._new = self._new, []
        return new


def unwell(message: Any) -> list[str]:
    """What a SYS_STATUS calls enabled and not healthy; PX4's only reason on a link without a ground station."""
    bits = message.onboard_control_sensors_enabled & ~message.onboard_control_sensors_health
    sensors = dialect.enums["MAV_SYS_STATUS_SENSOR"]
    names = [sensors[1 << n].name for n in range(32) if bits >> n & 1 and 1 << n in sensors]
    return [name.removeprefix("MAV_SYS_STATUS_").removeprefix("SENSOR_").replace("_", " ").lower() for name in names]
