"""Work on a thread of its own: in order, its first error kept, and no end that waits for ever."""

from __future__ import annotations

import threading

from arva_hil.runtime.worker_thread import Background


def test_jobs_run_in_order_and_the_last_ones_at_the_end() -> None:
    done: list[int] = []
    background = Background("test")
    for n in range(100):
        background.put(lambda n=n: done.append(n))  # type: ignore[misc]
    assert background.close(lambda: done.append(100), lambda: done.append(101))
    assert done == list(range(102))


def test_after_an_error_nothing_more_is_done_but_the_last_jobs() -> None:
    done: list[str] = []

    def fail() -> None:
        raise OSError("full")

    background = Background("test")
    background.put(fail)
    background.put(lambda: done.append("more"))
    assert background.close(lambda: done.append("last"))
    assert str(background.error) == "full"
    assert done == ["last"]
    assert not background.put(fail)
    assert background.refused == 1


def test_the_end_does_not_wait_for_ever_for_a_job_that_hangs() -> None:
    gate = threading.Event()
    background = Background("test", most_jobs=1)
    background.put(lambda: gate.wait(60), wait=True)
    background.put(lambda: None, wait=True)  # the queue is full from here on, or almost
    try:
        assert not background.close(lambda: None, timeout_s=0.05)
    finally:
        gate.set()
