"""The autopilot's clock seen from here: boot time ↔ host time by a minimum-delay filter."""

from __future__ import annotations

from collections import deque
from typing import Final

_WINDOW_S: Final = 1.0


class ClockMap:
    """Remembers how late the last second of samples arrived, and trusts the one that came quickest.

    A sample stamped `boot` and received at `host` was at least as old as its stamp says: host − boot = offset +
    delay, delay ≥ 0. The least of them is the offset, and a pose asked for by it is never from the future. The
    window is short because autopilots' clocks do not keep the host's time (a simulator's was measured 1.5 % slow,
    in steps of 0.15 s); a late second makes the pose older, never newer.
    """

    def __init__(self) -> None:
        self._samples: deque[tuple[float, float]] = deque()  # (host, offset), offsets ascending: a sliding minimum

    def add(self, host: float, boot: float) -> None:
        """One sample received; both in seconds."""
        offset = host - boot
        samples = self._samples
        while samples and samples[-1][1] >= offset:
            samples.pop()
        samples.append((host, offset))
        while len(samples) > 1 and samples[0][0] < host - _WINDOW_S:
            samples.popleft()

    def boot(self, host: float) -> float | None:
        """The autopilot's boot time [s] at host time `host`; None before the first sample."""
        return host - self._samples[0][1] if self._samples else None
