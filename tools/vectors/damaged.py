"""Streams of noise and of damaged frames, the same each time."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from tools.vectors.frames import BYTES, DECODE_ONLY, FRAMES
from tools.vectors.stream import Stream

JUNK = bytes(k for k in range(256) if k != 0xA4)


class Numbers:
    """The same random numbers in every Python, 0 … limit − 1."""

    def __init__(self, seed: int) -> None:
        self.state = seed

    def below(self, limit: int) -> int:
        self.state = (self.state * 6364136223846793005 + 1442695040888963407) % 2**64
        return (self.state >> 33) % limit

    def data(self, size: int) -> bytes:
        return bytes(self.below(256) for _ in range(size))


def damaged(raw: bytes, numbers: Numbers) -> bytes:
    """Return the bytes with 2 % of them dropped, changed, or with another one before them."""
    out = bytearray()
    for byte in raw:
        fate = numbers.below(150)
        if fate == 0:
            continue
        if fate == 1:
            out += numbers.data(1)
        out.append(byte ^ (1 + numbers.below(255)) if fate == 2 else byte)
    return bytes(out)


def missing(before: int, sequence: int) -> int:
    """Return the frames lost between two numbers, counted one at a time."""
    count, number = 0, (before + 1) % 256
    while sequence not in (before, number):
        count, number = count + 1, (number + 1) % 256
    return 0 if count > 16 and sequence < 16 else count


def at_once(name: str, why: str, pieces: list[tuple[bytes, str]]) -> dict[str, Any]:
    """Return a stream of pieces in one chunk: bytes, and the name of the complete frame in them or "".

    JUNK behind them settles every candidate. Each byte in no frame begins one, so those that are whole there are the
    failed CRCs, and nothing else is.
    """
    data, free, delivered = b"", [], []
    for raw, whole in [*pieces, (JUNK, "")]:
        at = raw.index(BYTES[whole]) if whole else len(raw)
        behind = at + len(BYTES[whole]) if whole else at
        free += [len(data) + k for k in range(len(raw)) if not at <= k < behind]
        data += raw
        delivered += [whole] if whole else []
    heads = [bytes([0xA4, 0x57, 1, 3 + 6 * n]) for n in range(1, 17)]
    failed = [k for k in free if data[k : k + 4] in heads and 6 * data[k + 6] + 3 == data[k + 3]]
    sequences = [FRAMES[name]["sequence"] for name in delivered]
    lost = sum(missing(a, b) for a, b in pairwise(sequences))
    return Stream(name, why).step(0, data, *delivered).end(bad_crc=len(failed), lost=lost)


def random_streams() -> list[dict[str, Any]]:
    numbers = Numbers(457)
    names = [name for name in FRAMES if name not in DECODE_ONLY]
    noise = [(numbers.data(numbers.below(60)) + BYTES[name], name) for name in names]
    made = [at_once("noise", "random bytes before each frame", noise)]
    for title, some in (("corrupt_1", ["one", "two", "three", "seven"] * 25), ("corrupt", names * 2)):
        pieces = []
        for name in some:
            raw = damaged(BYTES[name], numbers)
            pieces.append((raw, name if BYTES[name] in raw else ""))
        made.append(at_once(title, "2 % of the bytes dropped, inserted or changed: what is whole comes out", pieces))
    return made
