"""One fault while it runs."""

from __future__ import annotations

from random import Random

from arva_hil.config import Fault


class Switch:
    """A fault of the scenario. Remembers since when it is on.

    Its effect on a frame depends only on `key` and the frame's number, not on other faults.
    """

    def __init__(self, fault: Fault, key: str) -> None:
        self.fault = fault
        self.since_s: float | None = None  # how long it has been on, None when it is off
        self._key = key

    def turn(self, time_us: int) -> bool:
        """Switch on or off for this time of the run [µs]. Returns whether it is on."""
        since = self.fault.since(time_us)
        self.since_s = None if since is None else since / 1e6
        return since is not None

    def random(self, number: int) -> Random:
        """The random numbers for one frame."""
        return Random(f"{self._key} {number}")
