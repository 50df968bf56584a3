"""When a program need not wake up for each packet of a busy stream."""

from __future__ import annotations

import math
from typing import Final

_WATCH_S: Final = 0.2  # for so long packets are read when they come,
_REST_S: Final = 0.6  # and then for so long when something is due
_BUSY: Final = 6  # reads in the first of these times; a slower stream is always watched
_MOST_BYTES: Final = 2048  # read at once: a terminal holds 4 kB


class Rests:
    """Remembers how often and how much was read, and decides when the links `rest`: nobody waits for their bytes then.

    What comes during a rest waits in the system until something is due. It is stamped late, so that a pose's time would
    be late too; but the clock map takes the soonest packet of a second, and one of these was watched. A rest ends at
    once if much was waiting.
    """

    def __init__(self) -> None:
        self._until = -math.inf  # the end of the last rest, or of the present one
        self._since = -math.inf  # the start of the watch
        self._reads = 0

    def read(self, size: int, now: float) -> None:
        """So many bytes were read."""
        if size > _MOST_BYTES:
            self._until = self._since = now
            self._reads = 0
        elif now >= self._until:
            self._reads += 1
            if now >= self._since + _WATCH_S:
                if self._reads >= _BUSY:
                    self._until = now + _REST_S
                self._since, self._reads = max(now, self._until), 0

    def rest(self, now: float) -> bool:
        """Whether the links rest now."""
        return now < self._until
