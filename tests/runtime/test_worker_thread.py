"""Work on a thread of its own: in order, its first error kept, and no end that waits for ever."""

from __future__ import annotations

import threading

import pytest

from arva_hil.runtime import worker_thread
from arva_hil.runtime.worker_thread import WorkerThread


def test_jobs_run_in_order_and_the_last_ones_at_the_end() -> None:
    done: list[int] = []
    background = WorkerThread("test")
    for n in range(100):
        background.put(lambda n=n: done.append(n))  # type: ignore[misc]
    assert background.close(lambda: done.append(100), lambda: done.append(101))
    assert done == list(range(102))


def test_after_an_error_nothing_more_is_done_but_the_last_jobs() -> None:
    done: list[str] = []

    def fail() -> None:
        raise OSError("full")

    background = WorkerThread("test")
    background.put(fail)
    background.put(lambda: done.append("more"))
    assert background.close(lambda: done.append("last"))
    assert str(background.error) == "full"
    assert done == ["last"]
    assert not background.put(fail)
    assert background.refused == 1


def full(gate: threading.Event) -> WorkerThread:
    """One that works until the gate is open, and has no room for more."""
    begun = threading.Event()
    background = WorkerThread("test", most_jobs=1)
    background.put(lambda: begun.set() or gate.wait(60))  # type: ignore[func-returns-value]
    assert begun.wait(60)
    assert background.put(lambda: None)
    return background


def test_the_end_does_not_wait_for_ever_for_a_job_that_hangs() -> None:
    gate = threading.Event()
    background = full(gate)
    try:
        assert not background.close(lambda: None, timeout_s=0.05)
    finally:
        gate.set()


def test_who_waits_for_room_behind_a_job_that_hangs_waits_until_he_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker_thread, "_ASK_S", 0.001)
    gate = threading.Event()
    background, asked = full(gate), iter([False, False, True])
    assert not background.put(lambda: None)  # who does not wait
    assert not background.put(lambda: None, lambda: next(asked))
    assert next(asked, "no more") == "no more"
    assert background.refused == 2
    gate.set()
    assert background.put(lambda: None, lambda: False)  # there is room again, in a moment
    assert background.close()
