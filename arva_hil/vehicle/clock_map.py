"""Converts host time to the autopilot's boot time with a minimum-delay filter."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

_WINDOW_S: Final = 1.0
_STALL_S: Final = 0.5  # a longer silence counts as this long in the window,
_LONGEST_STALL_S: Final = 5.0  # except one of at least this length, in which the clocks may have drifted apart
_LEARN_S: Final = 2.0  # for measuring the rate of a clock
_FASTEST: Final = 20.0


class ClockMap:
    """Remembers the delays of the samples of the last second (`window_s`), and uses the smallest one.

    For a sample with time stamp `boot`, received at `host`: host − boot = offset + delay, with delay ≥ 0. The smallest
    difference is the offset, so a pose at a converted time is never from the future. The window is short because the
    clocks of autopilots run at other rates than the host's (a simulator's was measured 1.5 % slow, in steps of 0.15 s).
    A second with delays makes the pose older, never newer. Samples that come in a burst after a stall of the link were
    late: they are compared with the samples before the stall, otherwise they would look new.
    """

    def __init__(self, window_s: float = _WINDOW_S) -> None:
        self._window_s = window_s
        self._first: tuple[float, float] | None = None
        self._samples: deque[tuple[float, float]] = deque()  # (host, offset), offsets ascending: a sliding minimum
        self._newest = -math.inf

    def add(self, host: float, boot: float) -> None:
        """Add a sample; both times in seconds."""
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
        """Seconds of boot time per second of host time: 1, except for a simulator that runs faster than real time."""
        if not self._samples or self._first is None:
            return 1.0
        (first, boot), (last, offset) = self._first, self._samples[-1]
        return min(max((last - offset - boot) / (last - first), 1.0), _FASTEST) if last - first > _LEARN_S else 1.0
