"""Waiting with a deadline, and limits of a process, for tests."""

from __future__ import annotations

import resource
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from arva_hil.clock import RealClock

DEADLINE_S = 90.0  # none is reached but by a mistake, however slow the machine


def until(condition: Callable[[], object]) -> None:
    """Wait, with a deadline, until a condition holds; what takes long is looked at less often."""
    clock, pause_s = RealClock(), 0.005
    while not condition():
        assert clock.now() < DEADLINE_S, "the deadline passed"
        clock.wait(clock.now() + pause_s)
        pause_s = min(0.1, 1.2 * pause_s)


@contextmanager
def limited(what: int, most: int) -> Iterator[None]:
    """As where a process may have no more of something."""
    limits = resource.getrlimit(what)
    resource.setrlimit(what, (most, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(what, limits)


def no_file_beyond(size: int) -> AbstractContextManager[None]:
    """As a disk that is full."""
    return limited(resource.RLIMIT_FSIZE, size)
