"""Write firmware_proto/vectors.json, the test data for a codec in any language.

Its contents are made without a codec: python -m tools vectors
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tools.vectors import frames, messages, streams
from tools.vectors.frames import crc

FILE = Path(__file__).parents[2] / "firmware_proto" / "vectors.json"
ABOUT = [
    "Made by `python -m tools vectors`; do not edit. The protocol is PROTOCOL.md.",
    "crc: CRC-16/MCRF4XX of `hex`.",
    "frames: encode gives `hex`, `nmea` and `text`; decoding `hex` gives the frame back. `named`: name and value of",
    "each message, NAMED_VALUE_INT in the form named, NAMED_VALUE_FLOAT in named_float. An id of null is 255",
    "on the wire. decode_only: no encoder sends it, every decoder delivers it.",
    "streams: a fresh binary decoder is fed each step's `hex` at time `t`, in seconds; `frames` names those it",
    "delivers in that call. A decoder that takes one byte a call gets the bytes of a step at the same t.",
    "An empty hex only tells the time. counters: after the last step. dropped: bytes that are in no frame and",
    "no longer awaited; lost: frames missing from the sequence, none where the receiver has restarted.",
]


def vectors() -> str:
    """The file as text, one value a line."""
    checks = [{"hex": data.hex(), "crc": crc(data)} for data in (b"123456789", b"", b"\x00", b"\xff", bytes(103))]
    parts: dict[str, Any] = {
        "about": ABOUT + messages.ABOUT,
        "crc": checks,
        "frames": frames.parts(),
        "streams": streams.streams(),
    }
    parts |= messages.parts(frames.BYTES["one"])
    lists = (
        f'"{key}": [\n' + ",\n".join(json.dumps(value, ensure_ascii=False) for value in values) + "\n]"
        for key, values in parts.items()
    )
    return '{\n"version": 1,\n' + ",\n".join(lists) + "\n}\n"


def main() -> None:
    FILE.write_text(vectors(), encoding="utf-8")
