"""Faults of sending: what a frame says of itself, whether, how often and when it goes, and what waits to go."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Final, NamedTuple

import firmware_proto
from firmware_proto import Frame

__all__ = ["SENDERS", "Outbox", "QueuedFrame", "Sending"]


class QueuedFrame(NamedTuple):
    """A frame to be handed to the port, or the bytes that faults left of it. `whole`: its frame is in them."""

    frame: Frame
    boot_ms: int
    data: bytes | None = None  # None: the frame's own
    whole: bool = True


@dataclass
class Sending:
    """How one frame is going to be sent. `may_wait`: no other is waiting to be overtaken."""

    frame: Frame
    may_wait: bool
    copies: int = 1
    late_s: float = 0.0
    overtaken: bool = False  # by the next frame


class Outbox:
    """What waits to be sent, first in, first out: a late frame holds up those behind it, as on a line.

    The exception is a frame that is to be overtaken: it waits for the next one, and follows it.
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
        """When there is something to take."""
        return self._line[0][0] if self._line else math.inf

    def put(self, queued: list[QueuedFrame], due: float, overtaken: bool = False) -> None:
        """The copies of one frame, to be sent at `due` or as soon after as those before are gone."""
        if not queued:
            return
        if overtaken:
            self._overtaken += queued
            return
        self._line += ((due, one) for one in [*queued, *self._overtaken])
        self._overtaken.clear()

    def take(self, now: float) -> QueuedFrame | None:
        """The next that is due, None when nothing is."""
        return self._line.popleft()[1] if self.next_due <= now else None


Sender = Callable[[Sending, float, Random], bool]
"""(how a frame is sent, the fault's value, its random numbers): changes the first; whether it did."""


def _withhold(sending: Sending, share: float, random: Random) -> bool:
    if random.random() < share:
        sending.copies = 0
    return not sending.copies


def _self_test(sending: Sending, value: float, random: Random) -> bool:
    frame = sending.frame
    sending.frame = frame._replace(status=frame.status | firmware_proto.SELF_TEST_FAULT)
    return True


def _sequence(sending: Sending, share: float, random: Random) -> bool:
    """Any number but its own."""
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
    """It changes places with the next frame, which therefore cannot with its own next."""
    sending.overtaken = random.random() < share and sending.may_wait
    return sending.overtaken


SENDERS: Final[dict[str, Sender]] = {
    "silence": _withhold,
    "drop": _withhold,
    "self_test": _self_test,
    "sequence": _sequence,
    "duplicate": _duplicate,
    "delay_s": _delay,
    "jitter_s": _jitter,
    "reorder": _reorder,
}
