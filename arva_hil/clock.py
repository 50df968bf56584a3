"""The clock: the only module that reads the time or waits.

Times are seconds on a monotonic clock of arbitrary origin. A clock is passed to everything that needs one, so that
tests and replays can step it and do not sleep.
"""

from __future__ import annotations

import select
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Protocol

_POLL_S = 0.001  # between checks of a link without a descriptor
_EARLY_S = 0.0005  # a processor is slow for this time after it wakes up
_SELECT_MAX = 1024  # select accepts only descriptors below this


class Waitable(Protocol):
    """An object that a clock can wait for, such as a `Link`."""

    def fileno(self) -> int | None:
        """Return a descriptor to wait on; None if there is none, and `ready` must be polled."""

    def ready(self) -> bool:
        """Return True if there are bytes to read."""


def any_ready(links: Iterable[Waitable]) -> bool:
    """Return True if one of the links has bytes to read."""
    for link in links:  # noqa: SIM110  # `any` takes longer, and this is asked before and after each wait
        if link.ready():
            return True
    return False


class Clock(Protocol):
    """A source of time that can wait.

    `early_s`: a task that has slept for longer than this is called this many seconds before its instant.
    """

    early_s: float

    def now(self) -> float:
        """Return the time in seconds."""

    def wait(self, deadline: float, links: Iterable[Waitable] = ()) -> None:
        """Return at `deadline`, or earlier when one of `links` has bytes to read."""


def await_descriptors(read: Sequence[int] = (), write: Sequence[int] = (), *, timeout_s: float | None = 0.0) -> bool:
    """Wait until one of `read` can be read or one of `write` can be written. Returns False after `timeout_s`.

    None: wait for ever. A descriptor that is closed or hung up counts as ready: its use raises the error.
    """
    highest = max((*read, *write), default=-1)
    if highest < _SELECT_MAX or not hasattr(select, "poll"):  # select has microseconds, poll only
        readable, writable, _ = select.select(read, write, [], timeout_s)  # milliseconds
        return bool(readable or writable)
    poll = select.poll()
    for fd in {*read, *write}:
        poll.register(fd, (select.POLLIN if fd in read else 0) | (select.POLLOUT if fd in write else 0))
    if timeout_s is None:
        return bool(poll.poll())
    whole_ms = int(timeout_s * 1e3)
    if poll.poll(whole_ms):
        return True
    time.sleep(max(0.0, timeout_s - whole_ms / 1e3))
    return bool(poll.poll(0))


# Monotonic seconds, with the time in which the system was suspended if the system knows it.
_running: Callable[[], float] = (
    partial(time.clock_gettime, time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic
)


@contextmanager
def punctual() -> Iterator[None]:
    """Wake the thread exactly when a wait is over. Without this, Linux adds up to 50 µs, to save energy.

    Without such a setting, or without the permission for it, nothing changes.
    https://man7.org/linux/man-pages/man5/proc_pid_timerslack_ns.5.html
    """
    setting = Path(f"/proc/{threading.get_native_id()}/timerslack_ns")
    try:
        before = setting.read_text()
        setting.write_text("1")
    except OSError:
        yield
        return
    try:
        yield
    finally:
        with suppress(OSError):
            setting.write_text(before)


class RealClock:
    """Real time, `speed` times as fast for a demonstration. It continues while the system is suspended."""

    def __init__(self, speed: float = 1.0) -> None:
        self._speed = speed
        self.early_s = _EARLY_S * speed
        self._start = _running()
        self.epoch_us = time.time_ns() // 1000  # microseconds since 1970 at the time 0 of this clock

    def now(self) -> float:
        return (_running() - self._start) * self._speed

    def wait(self, deadline: float, links: Iterable[Waitable] = ()) -> None:
        fds, polled = list[int](), list[Waitable]()
        for link in links:
            if (fd := link.fileno()) is None:
                polled.append(link)
            else:
                fds.append(fd)
        while (left := (deadline - self.now()) / self._speed) > 0:
            if polled and any_ready(polled):
                return
            pause = min(left, _POLL_S) if polled else left
            if not fds:
                time.sleep(pause)
            elif await_descriptors(fds, timeout_s=pause):
                return


def utc(epoch_us: int) -> str:
    """Return microseconds since 1970 in ISO 8601, e.g. 2026-01-31T15:45:00.000Z."""
    return datetime.fromtimestamp(epoch_us / 1e6, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def from_utc(text: str) -> int:
    """Return microseconds since 1970 from the output of `utc`. Raises ValueError."""
    return round(datetime.strptime(text, "%Y-%m-%dT%H:%M:%S.%f%z").timestamp() * 1e6)


class StepClock:
    """A clock that jumps to the end of each wait: waiting takes no time."""

    early_s = 0.0
    epoch_us = 0

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        return self._now

    def wait(self, deadline: float, links: Iterable[Waitable] = ()) -> None:
        if deadline > self._now and not any_ready(links):
            self._now = deadline
