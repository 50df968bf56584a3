"""When a program need not wake up for each packet of a busy stream."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

_WATCH_S: Final = 0.2  # for so long packets are read when they come,
_REST_S: Final = 0.6  # and then for so long when something is due
_BUSY: Final = 4  # samples in the first of these times; a slower stream is always watched
_MOST_BYTES: Final = 2048  # read at once: a terminal holds 4 kB


class Rests:
    """Decides when the links `rest`: nobody waits for their bytes then, they are read when something is due.

    What comes during a rest is stamped late, so that a pose's time would be late too. But a clock map takes the soonest
    sample of a second, and for a part of each second the links are watched. `samples`: how many samples each clock map
    has taken until now; there is no rest if one of them takes few. A rest ends at once if much was waiting.
    """

    def __init__(self, samples: Callable[[], Sequence[int]]) -> None:
        self._samples = samples
        self._until = -math.inf  # the end of the last rest, or of the present one
        self._since = -math.inf  # the start of the watch,
        self._before: Sequence[int] = ()  # and the samples until then

    def read(self, size: int, now: float) -> None:
        """So many bytes were read."""
        if size > _MOST_BYTES:
            self._until, self._before = now, ()
        elif now < self._until:
            self._before = ()
        elif not self._before:
            self._since, self._before = now, self._samples()
        elif now >= self._since + _WATCH_S:
            taken = [after - before for before, after in zip(self._before, self._samples(), strict=True)]
            if min(taken) >= _BUSY:
                self._until = now + _REST_S
            self._before = ()

    def rest(self, now: float) -> bool:
        """Whether the links rest now."""
        return now < self._until
