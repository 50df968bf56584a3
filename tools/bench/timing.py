"""CPU time of functions: the least of several, because others use the machine too."""

from __future__ import annotations

import time
from collections.abc import Callable


def cpu_of(work: Callable[[], object], times: int = 3) -> float:
    """Return the CPU seconds of a function in this process."""
    return min(once(work, time.process_time) for _ in range(times))


def wall_of(work: Callable[[], object], times: int = 3) -> float:
    """Return the wall time [s] of work on several cores."""
    return min(once(work, time.perf_counter) for _ in range(times))


def once(work: Callable[[], object], clock: Callable[[], float]) -> float:
    start = clock()
    work()
    return clock() - start
