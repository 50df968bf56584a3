"""Driving emulators: live, by a clock and whatever arrives; or from a log, as fast as wanted."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Protocol

from arva_hil.clock import Clock, Waitable
from arva_hil.emulator import Emulator, NoHeartbeatError
from arva_hil.links.tlog import Record

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


def replay(
    emulator: Emulator,
    records: Iterable[Record],
    *,
    clock: Clock | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Feed a log to an emulator and make its frames at the instants of the log's own clock, from 0 at its start.

    With a `clock`, frames go out no earlier than it reads their instant. Each frame waits for the records that
    surround it, at most a second of them, and so interpolates where a live one must extrapolate.
    """
    schedule = emulator.schedule
    start_us: int | None = None
    heard = tend_at = 0.0

    def emit(everything: bool) -> None:
        while (t := schedule.deadline) <= heard and (everything or emulator.ready_for(t, heard)) and not stopped():
            while clock is not None and (now := clock.now()) < t and not stopped():
                emulator.release(now)
                clock.wait(min(t, emulator.next_release, now + _LONGEST_WAIT_S))
            emulator.emit(t, t)

    for record in records:
        if start_us is None:
            start_us = record.time_us
        heard = max(heard, (record.time_us - start_us) / 1e6)
        if schedule.deadline <= heard:
            emit(False)
            if stopped():
                return
        emulator.hear(record.raw, heard, whole=True)
        if heard >= tend_at:
            emulator.tend(heard)
            tend_at = heard + _LONGEST_WAIT_S
    emulator.tend(heard)
    emit(True)
    emulator.release(heard)
    if emulator.session.vehicle is None:
        raise NoHeartbeatError(emulator.session.heard())
