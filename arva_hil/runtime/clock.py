"""The one clock: the only module that asks what time it is or waits.

Times are seconds on a monotonic clock of arbitrary origin. A clock is handed to whoever needs one, so tests and
replays step it and nothing sleeps.
"""

from __future__ import annotations

import select
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol

_POLL_S = 0.001  # how often a link that the system cannot wait on is looked at
_SELECT_MAX = 1024  # descriptors from here on are not for select


class Waitable(Protocol):
    """What a clock can wait for; a `Link` is one."""

    def fileno(self) -> int | None: ...
    def ready(self) -> bool: ...


class Clock(Protocol):
    def now(self) -> float:
        """Seconds."""

    def wait(self, deadline: float, links: Iterable[Waitable] = ()) -> None:
        """Return at `deadline`, or earlier as soon as one of `links` has something to read."""


def await_descriptors(read: Sequence[int] = (), write: Sequence[int] = (), *, timeout_s: float | None = 0.0) -> bool:
    """Wait until one of `read` has something to read or one of `write` takes something: True; False after `timeout_s`.

    None waits for ever. One that is closed or hung up counts as ready: using it tells.
    """
    highest = max((*read, *write), default=-1)
    if highest < _SELECT_MAX or not hasattr(select, "poll"):  # select keeps time to the microsecond, poll to the next
        return any(select.select(read, write, [], timeout_s)[:2])  # millisecond
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


def _running() -> float:
    """Monotonic seconds; where the system can tell, those in which it was suspended are among them."""
    if hasattr(time, "CLOCK_BOOTTIME"):
        return time.clock_gettime(time.CLOCK_BOOTTIME)
    return time.monotonic()


@contextmanager
def punctual() -> Iterator[None]:
    """Within it this thread wakes when a wait is over. Linux adds up to 50 µs, to save energy; where the system has
    no such setting, or does not let us, nothing changes.
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
    """Real time; `speed` > 1 makes it run faster than the wall's, for a demonstration. It goes on in a suspend."""

    def __init__(self, speed: float = 1.0) -> None:
        self._speed = speed
        self._start = _running()
        self.epoch_us = time.time_ns() // 1000  # microseconds since 1970 when this clock read 0

    def now(self) -> float:
        return (_running() - self._start) * self._speed

    def wait(self, deadline: float, links: Iterable[Waitable] = ()) -> None:
        links = list(links)
        fds = [fd for fd in (link.fileno() for link in links) if fd is not None]
        polled = [link for link in links if link.fileno() is None]
        while (left := (deadline - self.now()) / self._speed) > 0:
            if any(link.ready() for link in polled):
                return
            pause = min(left, _POLL_S) if polled else left
            if not fds:
                time.sleep(pause)
            elif await_descriptors(fds, timeout_s=pause):
                return


def utc(epoch_us: int) -> str:
    """Microseconds since 1970 in ISO 8601, e.g. 2026-01-31T15:45:00.000Z."""
    return datetime.fromtimestamp(epoch_us / 1e6, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def from_utc(text: str) -> int:
    """Microseconds since 1970 of a time as `utc` writes it. Raises ValueError."""
    return round(datetime.strptime(text, "%Y-%m-%dT%H:%M:%S.%f%z").timestamp() * 1e6)


class StepClock:
    """A clock that jumps: waiting takes no time at all."""

    def __init__(self, start: float = 0.0, epoch_us: int = 0) -> None:
        self._now = start
        self.epoch_us = epoch_us

    def now(self) -> float:
        return self._now

    def wait(self, deadline: float, links: Iterable[Waitable] = ()) -> None:
        if not any(link.ready() for link in links):
            self._now = max(self._now, deadline)
