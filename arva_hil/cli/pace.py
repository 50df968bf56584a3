"""A program's pace against its clock: the computer may be too slow for real time or a faster run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from arva_hil.clock import Clock, Waitable

_EVERY_S: Final = 0.1
_BEHIND_S: Final = 0.5  # less changes nothing in a flight


class Pace:
    """A task of the loop that remembers `worst_s`, the largest delay of the loop against its clock.

    `start`: of the loop, s on its clock.
    """

    links: Sequence[Waitable] = ()

    def __init__(self, start: float) -> None:
        self.worst_s = 0.0
        self._due = start

    def service(self, clock: Clock) -> float:
        now = clock.now()
        self.worst_s = max(self.worst_s, now - self._due)
        self._due = now + _EVERY_S
        return self._due

    def complaint(self, speed: float) -> str:
        """Return a warning for a flight at `speed` times real time; "" if there is none."""
        if self.worst_s < _BEHIND_S:
            return ""
        what = "real time" if speed == 1 else f"--speed {speed:g}"
        cure = "a lower --speed, or --speed max, which waits for nothing" if speed > 1 else "--speed max"
        return (
            f"this computer was too slow for {what}: up to {self.worst_s:.1f} s of the flight behind, which may be why "
            f"the search failed: choose {cure}"
        )
