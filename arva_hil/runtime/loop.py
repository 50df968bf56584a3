"""The loop that serves everything that has a time or a link: emulators, searches, simulated vehicles."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, Protocol

from arva_hil.runtime.clock import Clock, Waitable, punctual

_LONGEST_WAIT_S: Final = 0.1  # a signal is noticed within it, and no task is left alone for longer
_AT_ONCE_S: Final = 1e-6  # deadlines so close together are one: they were reckoned in different ways


class Task(Protocol):
    """Something that is called when it is due or has bytes to read."""

    @property
    def links(self) -> Sequence[Waitable]:
        """Where bytes may come from."""

    def service(self, clock: Clock) -> float:
        """Do what is due; gives back when to be called again at the latest [s]."""


def run(
    tasks: Sequence[Task], clock: Clock, *, until: float = math.inf, stopped: Callable[[], bool] = lambda: False
) -> None:
    """Serve all tasks until the clock reads `until`, or until `stopped` says so.

    Of several tasks those are served that are due or have bytes to read, in this order; all of them first and last.
    """
    dues = [-math.inf] * len(tasks)
    alone = len(tasks) == 1
    with punctual():
        while not stopped():
            now = clock.now()
            nobody, every = True, alone or now >= until
            for number, task in enumerate(tasks):
                if every or dues[number] <= now or any(link.ready() for link in task.links):
                    dues[number] = min(task.service(clock), now + _LONGEST_WAIT_S)
                    nobody = False
            if now >= until:
                return
            if nobody:  # a link woke the clock and has nothing to read: its task has to find out why
                dues = [-math.inf] * len(tasks)
                continue
            first = min(dues)
            due = max(due for due in dues if due <= first + _AT_ONCE_S)
            due = max(due, round(due, 6))  # a task may have more to do at the instant of which this is a hair short
            clock.wait(min(due, until), [link for task in tasks for link in task.links])
