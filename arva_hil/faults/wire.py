"""Faults on the wire: bytes in, bytes out, and how many of them were hit."""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import Final

__all__ = ["GARBLERS", "Garbler", "resample"]

Garbler = Callable[[bytes, float, Random], tuple[bytes, int]]
"""(the bytes of one frame, the fault's value, its random numbers) → (what is left of them, how many were hit)."""


def _truncate(data: bytes, share: float, random: Random) -> tuple[bytes, int]:
    """With this probability only the beginning: at least one byte, and at least one is missing."""
    if random.random() >= share or len(data) < 2:
        return data, 0
    kept = random.randrange(1, len(data))
    return data[:kept], len(data) - kept


def _corrupt(data: bytes, share: float, random: Random) -> tuple[bytes, int]:
    """With this probability one byte, anywhere, is another."""
    if random.random() >= share or not data:
        return data, 0
    at = random.randrange(len(data))
    wrong = data[at] ^ random.randrange(1, 256)
    return data[:at] + bytes([wrong]) + data[at + 1 :], 1


def _drop_bytes(data: bytes, share: float, random: Random) -> tuple[bytes, int]:
    left = bytes(byte for byte in data if random.random() >= share)
    return left, len(data) - len(left)


def _insert_bytes(data: bytes, share: float, random: Random) -> tuple[bytes, int]:
    """Behind each byte but the last, with this probability, one that is not the same."""
    more = bytearray()
    for byte in data[:-1]:
        more.append(byte)
        if random.random() < share:
            more.append(byte ^ random.randrange(1, 256))
    more += data[-1:]
    return bytes(more), len(more) - len(data)


def _flip_bytes(data: bytes, share: float, random: Random) -> tuple[bytes, int]:
    """One bit of a byte, each with this probability."""
    flips = [1 << random.randrange(8) if random.random() < share else 0 for _ in data]
    return bytes(byte ^ flip for byte, flip in zip(data, flips, strict=True)), sum(map(bool, flips))


def _baud_ratio(data: bytes, ratio: float, random: Random) -> tuple[bytes, int]:
    heard = resample(data, ratio)
    return heard, len(data) if heard != data else 0


def resample(data: bytes, ratio: float) -> bytes:
    """What a host hears when the receiver's baud rate is `ratio` times its own: 8N1, each bit looked at once, amid.

    A byte without a stop bit is taken all the same, as a serial port does that was not told to mind. Up to 5 % of
    mismatch changes nothing.
    """
    line = [1]  # idle, before, after
    for byte in data:
        line += [0, *((byte >> bit) & 1 for bit in range(8)), 1]

    def level(time: float) -> int:  # in bits of the host's; the first edge may be at 1 / ratio
        at = int(time * ratio)
        return line[at] if at < len(line) else 1

    heard = bytearray()
    at = 1
    while at < len(line):
        if (line[at - 1], line[at]) != (1, 0):
            at += 1
            continue
        start = at / ratio
        if level(start + 0.5):  # a spike, shorter than half a bit
            at += 1
            continue
        heard.append(sum(level(start + 1.5 + bit) << bit for bit in range(8)))
        at = max(at + 1, int((start + 9.5) * ratio) + 1)
    return bytes(heard)


GARBLERS: Final[dict[str, Garbler]] = {
    "truncate": _truncate,
    "corrupt": _corrupt,
    "drop_bytes": _drop_bytes,
    "insert_bytes": _insert_bytes,
    "flip_bytes": _flip_bytes,
    "baud_ratio": _baud_ratio,
}
