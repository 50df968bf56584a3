"""A fault on the wire: with some probability the bytes of a frame are sent in reverse."""

from __future__ import annotations

from random import Random

from arva_hil import FaultKind, Number


def _reversed(data: bytes, share: float, random: Random) -> tuple[bytes, int]:
    return (data[::-1], len(data)) if random.random() < share else (data, 0)


REVERSED = FaultKind("wire", Number(0, 1, "a probability", above=True), "probability a frame: backwards", _reversed)
