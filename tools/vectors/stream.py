"""How a stream of frames is written down in vectors.json."""

from __future__ import annotations

from typing import Any

from tools.vectors.frames import BYTES


class Stream:
    """One stream as it is written down: steps with what comes out, then the final counters."""

    def __init__(self, name: str, why: str) -> None:
        self.value: dict[str, Any] = {"name": name, "why": why, "steps": []}
        self.fed = 0
        self.delivered: list[str] = []

    def step(self, t: float, data: bytes = b"", *frames: str) -> Stream:
        self.value["steps"].append({"t": t, "hex": data.hex(), "frames": list(frames)})
        self.fed += len(data)
        self.delivered += frames
        return self

    def end(self, bad_crc: int = 0, lost: int = 0, awaited: int = 0) -> dict[str, Any]:
        """`awaited`: bytes that the decoder still holds."""
        inside = sum(len(BYTES[name]) for name in self.delivered)
        self.value["counters"] = {
            "good": len(self.delivered),
            "bad_crc": bad_crc,
            "dropped": self.fed - inside - awaited,
            "lost": lost,
        }
        return self.value
