"""The loop, which serves tasks with deadlines or links: emulators, searches, simulated vehicles."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, Protocol

from arva_hil.clock import Clock, Waitable, any_ready, punctual

_LONGEST_WAIT_S: Final = 0.1  # the longest time without a check for signals and without serving a task
_AT_ONCE_S: Final = 1e-6  # closer deadlines are equal but for rounding


class Task(Protocol):
    """A task, to call when it is due or when it can read bytes."""

    @property
    def links(self) -> Sequence[Waitable]:
        """The links to wait for."""

    def service(self, clock: Clock) -> float:
        """Do all work that is due. Returns the latest time for the next call [s]."""


def run(
    tasks: Sequence[Task], clock: Clock, *, until: float = math.inf, stopped: Callable[[], bool] = lambda: False
) -> None:
    """Serve the tasks until the time `until`, or until `stopped()` is true.

    A task is served when it is due or can read bytes; at the start and at the end all tasks are served, in this order.
    """
    dues = [-math.inf] * len(tasks)
    alone = len(tasks) == 1
    with punctual():
        while not stopped():
            now = clock.now()
            nobody, every = True, alone or now >= until
            for number, task in enumerate(tasks):
                if every or dues[number] <= now or any_ready(task.links):
                    dues[number] = min(task.service(clock), now + _LONGEST_WAIT_S)
                    nobody = False
            if now >= until:
                return
            if nobody:  # a link woke the clock, but cannot be read: its task must find out why
                dues = [-math.inf] * len(tasks)
                continue
            due, links = dues[0], tasks[0].links
            if not alone:
                first = min(dues)
                due = max([due for due in dues if due <= first + _AT_ONCE_S])
                links = [link for task in tasks for link in task.links]
            due = max(due, round(due, 6))  # a rounding error must not put it before the instant at which a task is due
            clock.wait(min(due, until), links)
