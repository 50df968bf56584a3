"""Which format bytes look like that are none of the expected one."""

from __future__ import annotations

import math
from typing import Final

from arva_hil.mavlink.codec import Parser
from arva_hil.registry import FORMATS

SAMPLE_BYTES: Final = 1 << 14  # enough of any format for several frames


def looks_like(sample: bytes, expected: str) -> str:
    """What the beginning of a stream that has no frame of the `expected` format is, for a person."""
    frames = {name: _frames(sample, name) for name in FORMATS if name != expected}
    best = max(reversed(frames), key=lambda name: frames[name])  # tunnel before the binary frames that are in it
    if frames[best]:
        return f"it looks like {best}: --format {best}"
    if packets := len(Parser().feed(sample)):
        return f"it looks like MAVLink ({packets} packets) without frames of a receiver in it"
    return "nor does it look like another format: is it the right port, and the right baud rate?"


def _frames(sample: bytes, name: str) -> int:
    decoder = FORMATS[name].decoder()
    return len(decoder.feed(sample, 0.0)) + len(decoder.feed(b"", math.inf))
