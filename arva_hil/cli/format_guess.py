"""Guesses the format of bytes that have no frame of the expected format."""

from __future__ import annotations

import math
from typing import Final

from arva_hil.mavlink.codec import Parser
from arva_hil.registry import FORMATS, MEASURED_FORMATS

SAMPLE_BYTES: Final = 1 << 14  # enough of any format for several frames


def guess_format(sample: bytes, expected: str) -> str:
    """What a stream without a frame of the `expected` format probably is, for a person. `sample`: its first bytes."""
    frames = {name: _frames(sample, name) for name in FORMATS if name != expected}
    best = max(reversed(frames), key=lambda name: frames[name])  # tunnel before the binary frames that are in it
    if frames[best]:
        return f"it looks like {best}: --format {best}"
    if packets := len(Parser().feed(sample)):
        return f"it looks like MAVLink ({packets} packets) without frames of a receiver in it"
    return "it does not look like another format either: is it the right port, and the right baud rate?"


def _frames(sample: bytes, name: str) -> int:
    decoder = FORMATS[name].decoder()
    frames = decoder.feed(sample, 0.0) + decoder.feed(b"", math.inf)
    return sum(name not in MEASURED_FORMATS or frame.measured is not None for frame in frames)
