"""The loop that serves everything that has a time or a link: emulators, searches, simulated vehicles."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

from arva_hil.runtime.clock import Clock, Waitable

_LONGEST_WAIT_S = 0.1  # a signal is noticed within it


class Task(Protocol):
    """Something that is called when it is due or has bytes to read."""

    @property
    def links(self) -> Sequence[Waitable]:
        """Where bytes may come from."""

    def service(self, clock: Clock) -> float:
        """Do what is due; gives back when to be called again at the latest [s]."""


def run(
    tasks: Sequence[Task],
    clock: Clock,
    *,
    until: float = math.inf,
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Serve all tasks until the clock reads `until`, or until `stopped` says so."""
    while not stopped():
        now = clock.now()
        due = min(task.service(clock) for task in tasks)
        if now >= until:
            return
        clock.wait(min(due, until, now + _LONGEST_WAIT_S), [link for task in tasks for link in task.links])
