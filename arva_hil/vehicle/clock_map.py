"""The autopilot's clock seen from here: boot time ↔ host time by a minimum-delay filter."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

_WINDOW_S: Final = 1.0
_STALL_S: Final = 0.5  # a silence counts for no more than this in the window,
_LONGEST_STALL_S: Final = 5.0  # unless it was so long that the clocks may have drifted apart meanwhile
_LEARN_S: Final = 2.0  # to tell how fast a clock runs
_FASTEST: Final = 20.0


class ClockMap:
    """Remembers how late the last second (`window_s`) of samples arrived, and trusts the one that came quickest.

    A sample stamped `boot` and received at `host` was at least as old as its stamp says: host − boot = offset +
    delay, delay ≥ 0. The least of them is the offset, and a pose asked for by it is never from the future. The
    window is short because autopilots' clocks do not keep the host's time (a simulator's was measured 1.5 % slow,
    in steps of 0.15 s); a late second makes the pose older, never newer. What comes in a burst behind a stall of the
    link was late: it is judged by what came quickest before, or else it would pass for fresh.
    """

    def __init__(self, window_s: float = _WINDOW_S) -> None:
        self._window_s = window_s
        self._first: tuple[float, float] | None = None
        self._samples: deque[tuple[float, float]] = deque()  # (host, offset), offsets ascending: a sliding minimum
        self._newest = -math.inf

    def add(self, host: float, boot: float) -> None:
        """One sample received; both in seconds."""
        offset = host - boot
        if self._first is None:
            self._first = host, boot
        samples = self._samples
        if _STALL_S < (silence := host - self._newest) <= _LONGEST_STALL_S:
            samples = self._samples = deque((at + silence - _STALL_S, least) for at, least in samples)
        if host > self._newest:
            self._newest = host
        while samples and samples[-1][1] >= offset:
            samples.pop()
        samples.append((host, offset))
        while len(samples) > 1 and samples[0][0] < host - self._window_s:
            samples.popleft()

    def boot(self, host: float) -> float | None:
        """The autopilot's boot time [s] at host time `host`; None before the first sample."""
        return host - self._samples[0][1] if self._samples else None

    @property
    def rate(self) -> float:
        """How many seconds of boot time pass in one of host time: 1, but for a simulator that is told to be quick."""
        if not self._samples or self._first is None:
            return 1.0
        (first, boot), (last, offset) = self._first, self._samples[-1]
        return min(max((last - offset - boot) / (last - first), 1.0), _FASTEST) if last - first > _LEARN_S else 1.0
