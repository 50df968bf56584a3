"""CPU time of functions and of commands: the least of several, because others use the machine too."""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence

COMMAND = [sys.executable, "-m", "arva_hil"]


def cpu_of(work: Callable[[], object], times: int = 3) -> float:
    """Return the CPU seconds of a function in this process."""
    return min(_once(work, time.process_time) for _ in range(times))


def wall_of(work: Callable[[], object], times: int = 3) -> float:
    """Return the wall time [s] of work on several cores."""
    return min(_once(work, time.perf_counter) for _ in range(times))


def _once(work: Callable[[], object], clock: Callable[[], float]) -> float:
    start = clock()
    work()
    return clock() - start


def cpu_of_command(command: Sequence[str], times: int = 5) -> float:
    """Return the CPU seconds of a command, with its start-up. Raises CalledProcessError if it fails."""
    return min(_once_command(command) for _ in range(times))


def _once_command(command: Sequence[str]) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def wall_of_command(command: Sequence[str]) -> float:
    """Return the wall time [s] of one run of a command. Raises CalledProcessError if it fails."""
    return _once(lambda: subprocess.run(command, check=True, capture_output=True), time.perf_counter)


def figure_of(*arguments: str) -> float:
    """Return the number in the last line of a Python program's output. Raises CalledProcessError if it fails."""
    done = subprocess.run([sys.executable, *arguments], check=True, capture_output=True, text=True)
    return float(done.stdout.splitlines()[-1])
