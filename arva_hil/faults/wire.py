"""Faults on the wire: functions of bytes that return the changed bytes and the number of changes."""

from __future__ import annotations

from random import Random
from typing import Final

from arva_hil.config import FaultKind
from arva_hil.config.constraints import Number
from arva_hil.config.faults import SHARE


def _truncate(data: bytes, share: float, random: Random) -> tuple[bytes, int]:
    """With this probability, cut the end off: at least one byte stays, and at least one is removed."""
    if random.random() >= share or len(data) < 2:
        return data, 0
    kept = random.randrange(1, len(data))
    return data[:kept], len(data) - kept


def _corrupt(data: bytes, share: float, random: Random) -> tuple[bytes, int]:
    """With this probability, change one byte at a random place."""
    if random.random() >= share or not data:
        return data, 0
    at = random.randrange(len(data))
    wrong = data[at] ^ random.randrange(1, 256)
    return data[:at] + bytes([wrong]) + data[at + 1 :], 1


def _drop_bytes(data: bytes, share: float, random: Random) -> tuple[bytes, int]:
    left = bytes(byte for byte in data if random.random() >= share)
    return left, len(data) - len(left)


def _insert_bytes(data: bytes, share: float, random: Random) -> tuple[bytes, int]:
    """With this probability, insert a different byte after each byte but the last."""
    more = bytearray()
    for byte in data[:-1]:
        more.append(byte)
        if random.random() < share:
            more.append(byte ^ random.randrange(1, 256))
    more += data[-1:]
    return bytes(more), len(more) - len(data)


def _flip_bytes(data: bytes, share: float, random: Random) -> tuple[bytes, int]:
    """With this probability, flip one bit of each byte."""
    flips = [1 << random.randrange(8) if random.random() < share else 0 for _ in data]
    return bytes(byte ^ flip for byte, flip in zip(data, flips, strict=True)), sum(map(bool, flips))


def _baud_ratio(data: bytes, ratio: float, random: Random) -> tuple[bytes, int]:
    heard = resample(data, ratio)
    return heard, len(data) if heard != data else 0


def resample(data: bytes, ratio: float) -> bytes:
    """The bytes that a host receives if the receiver's baud rate is `ratio` times the host's. 8N1, sampled mid-bit.

    A byte without a stop bit is accepted too, as serial ports do by default. A mismatch of up to 5 % changes nothing.
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


TRUNCATE: Final = FaultKind("wire", SHARE, "probability a frame that only its beginning is sent", _truncate)
CORRUPT: Final = FaultKind("wire", SHARE, "probability a frame that one byte is another", _corrupt)
DROP_BYTES: Final = FaultKind("wire", SHARE, "probability a byte that it is lost", _drop_bytes)
INSERT_BYTES: Final = FaultKind("wire", SHARE, "probability a byte that another one comes before it", _insert_bytes)
FLIP_BYTES: Final = FaultKind("wire", SHARE, "probability a byte that one bit is another", _flip_bytes)
BAUD_RATIO: Final = FaultKind(
    "wire", Number(0.1, 10, above=True), "the receiver's baud rate to the host's: garble", _baud_ratio
)
