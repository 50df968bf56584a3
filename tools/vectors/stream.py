"""The form of a stream in vectors.json."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tools.vectors import frames


class Stream:
    """Steps with their output, then the final counters. `kind`: of the output; `units`: its bytes, by name."""

    def __init__(self, name: str, why: str, kind: str = "frames", units: Mapping[str, bytes] = frames.BYTES) -> None:
        self.value: dict[str, Any] = {"name": name, "why": why, "steps": []}
        self.kind = kind
        self.units = units
        self.fed = 0
        self.delivered: list[str] = []

    def step(self, t: float, data: bytes = b"", *names: str) -> Stream:
        self.value["steps"].append({"t": t, "hex": data.hex(), self.kind: list(names)})
        self.fed += len(data)
        self.delivered += names
        return self

    def end(self, bad_crc: int = 0, lost: int = 0, awaited: int = 0) -> dict[str, Any]:
        """`lost`: of frames alone; `awaited`: bytes that the decoder still holds."""
        dropped = self.fed - sum(len(self.units[name]) for name in self.delivered) - awaited
        counters = {"good": len(self.delivered), "bad_crc": bad_crc, "dropped": dropped}
        self.value["counters"] = counters | ({"lost": lost} if self.kind == "frames" else {})
        return self.value
