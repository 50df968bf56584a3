"""Faults of sending: sequence number and status, loss, copies and delay; and the frames that wait to be sent."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from random import Random
from typing import Final, NamedTuple

import firmware_proto
from arva_hil.config import FaultKind
from arva_hil.config.faults import SECONDS, SHARE
from firmware_proto import Frame


class QueuedFrame(NamedTuple):
    """A frame for the port, or its bytes after faults. `whole`: whether the whole frame is in them."""

    frame: Frame
    boot_ms: int
    data: bytes | None = None  # None: the frame's own
    whole: bool = True


@dataclass
class Sending:
    """How to send one frame. `may_wait`: no other frame waits to be overtaken."""

    frame: Frame
    may_wait: bool
    copies: int = 1
    late_s: float = 0.0
    overtaken: bool = False  # by the next frame


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
        """Whether a frame waits to be overtaken."""
        return bool(self._overtaken)

    @property
    def next_due(self) -> float:
        """When the first frame is due."""
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


def _sequence(sending: Sending, share: float, random: Random) -> bool:
    """Set another sequence number."""
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
SEQUENCE: Final = FaultKind("sent", SHARE, "probability a frame that its number is wrong", _sequence)
DUPLICATE: Final = FaultKind("sent", SHARE, "probability a frame that it is sent again", _duplicate)
DELAY: Final = FaultKind("sent", SECONDS, "frames are late, those behind them too", _delay)
JITTER: Final = FaultKind("sent", SECONDS, "frames are up to this late", _jitter)
REORDER: Final = FaultKind("sent", SHARE, "probability a frame that it changes places with the next", _reorder)
