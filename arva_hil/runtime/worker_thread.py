"""Slow work on a thread, so that a full disk or a stopped terminal never blocks the loop."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Final

Job = Callable[[], object]

_MOST: Final = 10_000  # jobs
_ASK_S: Final = 0.1  # time between calls of `give_up`


class WorkerThread:
    """Runs jobs in order on one thread. Remembers the first error; after it no job is run and every `put` is refused.

    An error of another kind than `expected` is also passed to `threading.excepthook`.
    """

    def __init__(self, name: str, expected: tuple[type[Exception], ...] = (OSError,), most_jobs: int = _MOST) -> None:
        self.error: Exception | None = None
        self.refused = 0
        self._expected = expected
        self._jobs: queue.Queue[Job | None] = queue.Queue(most_jobs)
        self._last: tuple[Job, ...] = ()
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def put(self, job: Job, give_up: Callable[[], bool] = lambda: True) -> bool:
        """Queue a job. Waits for room until `give_up()` is true; then the job is refused and counted: returns False."""
        timeout_s = 0.0
        while self.error is None:
            try:
                self._jobs.put(job, timeout=timeout_s)
                return True
            except queue.Full:
                if give_up():
                    break
                timeout_s = _ASK_S
        self.refused += 1
        return False

    def close(self, *last: Job, timeout_s: float = 5.0) -> bool:
        """Run the queued jobs, then the `last` jobs, also after an error. Returns False if that takes too long."""
        self._last = last
        try:
            self._jobs.put(None, timeout=timeout_s)
        except queue.Full:
            return False
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            if self.error is None:
                self._do(job)
        for job in self._last:
            self._do(job)

    def _do(self, job: Job) -> None:
        try:
            job()
        except Exception as error:
            self.error = self.error or error
            if not isinstance(error, self._expected):
                what = (type(error), error, error.__traceback__, threading.current_thread())
                threading.excepthook(threading.ExceptHookArgs(what))
