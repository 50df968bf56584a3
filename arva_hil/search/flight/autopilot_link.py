"""The autopilot's link of a search: it is read until it is empty, so that no order follows from old messages."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from arva_hil.clock import Clock
from arva_hil.links import Link, LinkError, Sender

_GAP_S: Final = 1.0  # after this time without reading, another person may have controlled the vehicle
_AT_ONCE: Final = 1 << 18  # the most bytes to read at a time
_AT_ONCE_S: Final = 0.2
_HELD_UP_S: Final = 0.04  # an order is sent within this time after the link was empty
_LOOKS: Final = 3
_AGAIN_S: Final = 0.02


class AutopilotLink:
    """Remembers when the link was last empty. Times are seconds on the caller's clock.

    `on_bytes(sender, chunk, now, since)` gets the bytes; `since`: when the link was empty before. `on_gap(now, gap_s)`
    is called after a gap, before anything is read.
    """

    def __init__(
        self,
        link: Link,
        start: float,
        *,
        on_bytes: Callable[[Sender, bytes, float, float], None],
        on_gap: Callable[[float, float], None],
    ) -> None:
        self.link = link
        self._on_bytes = on_bytes
        self._on_gap = on_gap
        self._empty_s = start
        self._gap = False  # whether there was a gap
        self._losses: int | None = None  # of the link, when it was pinned

    def pin(self) -> None:
        """Accept no new far end from now on: `take_in` raises LinkError."""
        self.link.pin()
        self._losses = self.link.losses

    def take_in(self, clock: Clock) -> bool:
        """Read until the link is empty. Return True if it is; the rest of a flood is read the next time."""
        begun = now = clock.now()
        since, read = self._empty_s, 0
        if now - since > _GAP_S and not self._gap:
            self._gap = True
            self._on_gap(now, now - since)
        while True:
            came = self.link.receive()
            if self._losses is not None and self.link.losses > self._losses:
                raise LinkError(self.link.name, self.link.why.removeprefix(f"{self.link.name}: "))
            for sender, chunk in came:
                self._on_bytes(sender, chunk, now, since)
                read += len(chunk)
            now = clock.now()
            if not self.link.ready():
                self._empty_s, self._gap = now, False
                return True
            if read > _AT_ONCE or now - begun > _AT_ONCE_S:
                return False

    def speak(self, clock: Clock, due: Callable[[float], tuple[bytes, bytes]], sent: Callable[[float], None]) -> float:
        """Send bytes, and orders only if the link was empty a moment ago; then call `sent`.

        Returns when to call it again because orders were not sent; infinite if there are none.
        """
        for _ in range(_LOOKS):  # with a stepped clock the link stays as empty as before
            empty = (self._empty_s == clock.now() and not self.link.ready()) or self.take_in(clock)
            out, orders = due(clock.now())
            in_time = empty and clock.now() - self._empty_s <= _HELD_UP_S
            data = out + orders if in_time else out
            went = self.link.write(data) if data else True
            if in_time and went:
                sent(clock.now())
                return math.inf
            if in_time or not empty:
                break
        return clock.now() + _AGAIN_S if orders else math.inf
