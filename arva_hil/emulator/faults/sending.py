"""Faults of sending: sequence number and status, loss, copies and delay; and of the bytes on the wire."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from random import Random
from typing import Final, NamedTuple

import firmware_proto
from arva_hil.config import FaultKind
from arva_hil.config.constraints import Number
from arva_hil.config.faults import SECONDS, SHARE
from firmware_proto import Channel, Frame

_IMPULSE_CM: Final = (300, 5000)  # d of impulses
_GHOST: Final = 254  # id of a signal of nobody


def _truncate(data: bytes, share: float, random: Random) -> tuple[bytes, int]:
    """Cut the end off with this probability: at least one byte stays, and at least one is removed."""
    if random.random() >= share or len(data) < 2:
        return data, 0
    kept = random.randrange(1, len(data))
    return data[:kept], len(data) - kept


def _corrupt(data: bytes, share: float, random: Random) -> tuple[bytes, int]:
    """Change one byte at a random place with this probability."""
    if random.random() >= share or not data:
        return data, 0
    at = random.randrange(len(data))
    wrong = data[at] ^ random.randrange(1, 256)
    return data[:at] + bytes([wrong]) + data[at + 1 :], 1


def _drop_bytes(data: bytes, share: float, random: Random) -> tuple[bytes, int]:
    left = bytes(byte for byte in data if random.random() >= share)
    return left, len(data) - len(left)


def _insert_bytes(data: bytes, share: float, random: Random) -> tuple[bytes, int]:
    """Insert a different byte after each byte but the last, with this probability."""
    more = bytearray()
    for byte in data[:-1]:
        more.append(byte)
        if random.random() < share:
            more.append(byte ^ random.randrange(1, 256))
    more += data[-1:]
    return bytes(more), len(more) - len(data)


def _flip_bytes(data: bytes, share: float, random: Random) -> tuple[bytes, int]:
    """Flip one bit of each byte with this probability."""
    flips = [1 << random.randrange(8) if random.random() < share else 0 for _ in data]
    return bytes(byte ^ flip for byte, flip in zip(data, flips, strict=True)), sum(map(bool, flips))


def _baud_ratio(data: bytes, ratio: float, random: Random) -> tuple[bytes, int]:
    heard = resample(data, ratio)
    return heard, len(data) if heard != data else 0


def resample(data: bytes, ratio: float) -> bytes:
    """Return the bytes that a host receives from a receiver with `ratio` times its baud rate. 8N1, sampled mid-bit.

    A byte without a stop bit is accepted too, as serial ports do by default. A mismatch of up to 5 % changes nothing.
    """
    line = [1]  # idle, before, after
    for byte in data:
        line += [0, *((byte >> bit) & 1 for bit in range(8)), 1]

    def level(time: float) -> int:  # in the host's bits; the first edge may be at 1 / ratio
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


class QueuedFrame(NamedTuple):
    """A frame for the port, or its bytes after faults. `whole`: they contain the complete frame."""

    frame: Frame
    boot_ms: int
    data: bytes | None = None  # None: the frame's own
    whole: bool = True


@dataclass
class Sending:
    """The transmission of one frame. `may_wait`: no other frame waits to be overtaken."""

    frame: Frame
    may_wait: bool
    copies: int = 1
    late_s: float = 0.0
    overtaken: bool = False  # the next frame is sent first


class Outbox:
    """Frames that wait to be sent, first in, first out. A late frame delays those after it, as on a serial line.

    A frame that is to be overtaken waits for the next one, and is sent after it.
    """

    def __init__(self) -> None:
        self._line: deque[tuple[float, QueuedFrame]] = deque()
        self._overtaken: list[QueuedFrame] = []

    def __len__(self) -> int:
        return len(self._line) + len(self._overtaken)

    @property
    def holds(self) -> bool:
        """True if a frame waits to be overtaken."""
        return bool(self._overtaken)

    @property
    def next_due(self) -> float:
        """The time at which the first frame is due."""
        return self._line[0][0] if self._line else math.inf

    def put(self, queued: list[QueuedFrame], due: float, overtaken: bool = False) -> None:
        """Add the copies of one frame, to be sent at `due`, or later if earlier frames are late."""
        if not queued:
            return
        if overtaken:
            self._overtaken += queued
            return
        self._line += ((due, one) for one in [*queued, *self._overtaken])
        self._overtaken.clear()

    def take(self, now: float) -> QueuedFrame | None:
        """Remove and return the next frame that is due, None if none is."""
        return self._line.popleft()[1] if self.next_due <= now else None


def _withhold(sending: Sending, share: float, random: Random) -> bool:
    if random.random() < share:
        sending.copies = 0
    return not sending.copies


def _self_test(sending: Sending, value: float, random: Random) -> bool:
    frame = sending.frame
    sending.frame = frame._replace(status=frame.status | firmware_proto.SELF_TEST_FAULT)
    return True


def _impulses(sending: Sending, share: float, random: Random) -> bool:
    """Show impulses of loud electronics: a nearer signal in a channel, or a ghost in the first empty one."""
    frame, channels = sending.frame, list(sending.frame.channels)
    empty = [n for n, one in enumerate(channels) if isinstance(one, Channel) and not one.valid][:1]
    for n, one in enumerate(channels):
        strikes, d, delta = random.random() < share, random.randrange(*_IMPULSE_CM), random.randrange(-89, 90)
        if strikes and isinstance(one, Channel) and (d < one.d or n in empty):
            id_ = _GHOST if one.id is None else one.id
            channels[n] = one._replace(id=id_, zone=firmware_proto.MID, d=d, delta=delta)
    sending.frame = frame._replace(channels=tuple(channels))
    return sending.frame != frame


def _sequence(sending: Sending, share: float, random: Random) -> bool:
    if random.random() >= share:
        return False
    wrong = (sending.frame.sequence + random.randrange(1, 256)) % 256
    sending.frame = sending.frame._replace(sequence=wrong)
    return True


def _duplicate(sending: Sending, share: float, random: Random) -> bool:
    if random.random() >= share:
        return False
    sending.copies += 1
    return True


def _delay(sending: Sending, seconds: float, random: Random) -> bool:
    sending.late_s += seconds
    return True


def _jitter(sending: Sending, seconds: float, random: Random) -> bool:
    sending.late_s += seconds * random.random()
    return True


def _reorder(sending: Sending, share: float, random: Random) -> bool:
    """Exchange the frame with the next one. The next one cannot be exchanged again."""
    sending.overtaken = random.random() < share and sending.may_wait
    return sending.overtaken


SILENCE: Final = FaultKind("sent", None, "no frames", _withhold)
DROP: Final = FaultKind("sent", SHARE, "probability a frame that it is lost", _withhold)
SELF_TEST: Final = FaultKind("sent", None, "the status bit", _self_test)
IMPULSES: Final = FaultKind("sent", SHARE, "probability a channel and frame of an impulse", _impulses)
SEQUENCE: Final = FaultKind("sent", SHARE, "probability a frame that its number is wrong", _sequence)
DUPLICATE: Final = FaultKind("sent", SHARE, "probability a frame that it is sent again", _duplicate)
DELAY: Final = FaultKind("sent", SECONDS, "frames and all later ones are late by this", _delay)
JITTER: Final = FaultKind("sent", SECONDS, "frames are up to this late", _jitter)
REORDER: Final = FaultKind("sent", SHARE, "probability a frame that it is sent after the next one", _reorder)
