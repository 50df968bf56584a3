"""The autopilot's link as a search has it: read until it is empty, and no order on what may be old."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from arva_hil.links import Link, LinkError, Sender
from arva_hil.runtime.clock import Clock

_GAP_S: Final = 1.0  # in which nothing was read: who knows who had the vehicle
_AT_ONCE: Final = 1 << 18  # bytes read before other things are done, and
_AT_ONCE_S: Final = 0.2
_HELD_UP_S: Final = 0.04  # after the link was found empty: it has to be looked at again before an order
_LOOKS: Final = 3
_AGAIN_S: Final = 0.02


class AutopilotLink:
    """Remembers when the link was last found empty. Times are seconds on the clock that is handed in.

    `hear(sender, chunk, now, since)` gets what came; `since`: when the link was found empty before. `anew(now, gap_s)`
    is told of a gap before anything is read behind it.
    """

    def __init__(
        self,
        link: Link,
        start: float,
        *,
        hear: Callable[[Sender, bytes, float, float], None],
        anew: Callable[[float, float], None],
    ) -> None:
        self.link = link
        self._hear = hear
        self._anew = anew
        self._empty_s = start
        self._gap = False  # since it is not
        self._losses: int | None = None  # that there were when it was pinned

    def pin(self) -> None:
        """From now on another far end is another vehicle's: `take_in` raises LinkError."""
        self.link.pin()
        self._losses = self.link.losses

    def take_in(self, clock: Clock) -> bool:
        """Read until the link is empty, and say whether it is; a flood is left for the next time."""
        begun = now = clock.now()
        since, read = self._empty_s, 0
        if now - since > _GAP_S and not self._gap:
            self._gap = True
            self._anew(now, now - since)
        while True:
            came = self.link.receive()
            if self._losses is not None and self.link.losses > self._losses:
                raise LinkError(self.link.name, self.link.why.removeprefix(f"{self.link.name}: "))
            for sender, chunk in came:
                self._hear(sender, chunk, now, since)
                read += len(chunk)
            now = clock.now()
            if not self.link.ready():
                self._empty_s, self._gap = now, False
                return True
            if read > _AT_ONCE or now - begun > _AT_ONCE_S:
                return False

    def speak(self, clock: Clock, due: Callable[[float], tuple[bytes, bytes]], sent: Callable[[float], None]) -> float:
        """Send what is due: any bytes, and orders, these only when the link was empty a moment ago; then say `sent`.

        When to be called again, because orders have not left; infinite when there are none.
        """
        for _ in range(_LOOKS):  # where time stands still, it is as empty as a moment ago
            empty = (self._empty_s == clock.now() and not self.link.ready()) or self.take_in(clock)
            out, orders = due(clock.now())
            in_time = empty and clock.now() - self._empty_s <= _HELD_UP_S
            went = self.link.write(out + orders if in_time else out) if out or (orders and in_time) else True
            if in_time and went:
                sent(clock.now())
                return math.inf
            if in_time or not empty:
                break
        return clock.now() + _AGAIN_S if orders else math.inf
