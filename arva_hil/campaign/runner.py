"""Runs trials in processes of this machine or on a Dask cluster, and yields their results as they end."""

from __future__ import annotations

import gc
import logging
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from multiprocessing.connection import Connection
from typing import Any, Final

from arva_hil.campaign.plan import Planned
from arva_hil.campaign.results import FAILED
from arva_hil.campaign.trial import Result, Trial
from arva_hil.errors import ArvaError

Fly = Callable[[Trial], Result]

_DIED: Final = "a worker process died, killed or out of memory"
_POLL_S: Final = 0.1  # between calls of `stopped`
_CONNECT_S: Final = 10
_AHEAD: Final = 1000  # shards that are submitted to a cluster at a time; workers may join it later
_SHARD: Final = 50  # most trials in one task of a cluster; they are flown again if the worker dies
_ONE_THREAD: Final = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class WorkerPoolError(ArvaError):
    """No more trials can be run. `str()` says why."""


class MissingExtra(WorkerPoolError):
    """A package is not installed. `str()` says how to install it."""


class Unreachable(WorkerPoolError):
    """The scheduler does not answer."""


@dataclass(frozen=True)
class WorkerPool:
    """Runs trials in shards: `shard` of them are one task, and at most `width` tasks are submitted at a time.

    `lost` returns the error if no more results will come.
    """

    name: str
    executor: Executor
    width: int
    lost: Callable[[], WorkerPoolError | None] = lambda: None
    shard: int = 1

    def fly(
        self, planned: Iterable[Planned], fly: Fly, *, stopped: Callable[[], bool]
    ) -> Iterator[list[tuple[Planned, Result]]]:
        """Yield the trials of a shard and their results, in the order in which they end. `fly`: a function of a module.

        An error of a trial is its outcome. Raises WorkerPoolError if a worker dies or the cluster is lost.
        """
        queue = iter(planned)
        shards = iter(lambda: list(islice(queue, self.shard)), [])
        waiting: dict[Future[list[Result]], list[Planned]] = {}
        lost: WorkerPoolError | None = None
        while not stopped() and not lost:
            try:
                for some in islice(shards, self.width - len(waiting)):
                    waiting[self.executor.submit(attempt, fly, packed([one.trial for one in some]))] = some
            except BrokenExecutor:
                lost = WorkerPoolError(_DIED)
            if not waiting and not lost:
                return
            done, _ = wait(waiting, _POLL_S, FIRST_COMPLETED)
            for future in [future for future in waiting if future in done]:
                some = waiting.pop(future)
                if results := _results(future, len(some)):
                    yield list(zip(some, results, strict=True))
                else:
                    lost = WorkerPoolError(_DIED)
            lost = self.lost() or lost
        if lost:
            raise lost


def packed(trials: Sequence[Trial]) -> bytes:
    """Return trials in a small form, because Dask's scheduler keeps its last 1000 messages to each worker."""
    return zlib.compress(pickle.dumps(trials))


def attempt(fly: Fly, shard: bytes) -> list[Result]:
    """Return the results of the trials in a shard, also of those that raise an error. Runs in the worker."""
    results = []
    for trial in pickle.loads(zlib.decompress(shard)):
        try:
            results.append(fly(trial))
        except Exception as error:
            results.append(_failure(error))
    return results


@contextmanager
def processes(count: int) -> Iterator[WorkerPool]:
    """Run `count` processes on this machine, each with one thread for numpy; at the end stop them, even if busy."""
    context = multiprocessing.get_context("spawn")
    held, lifeline = context.Pipe(duplex=False)
    before = {name: os.environ[name] for name in _ONE_THREAD if name in os.environ}
    os.environ.update(_ONE_THREAD)
    executor = _Processes(count, context, _hold, (held,))
    try:
        yield WorkerPool(f"processes: {count}", executor, 2 * count)
    finally:
        lifeline.close()
        executor.shutdown(cancel_futures=True)
        held.close()
        for name in _ONE_THREAD:
            del os.environ[name]
        os.environ.update(before)


@contextmanager
def cluster(address: str, trials: int, *, within_s: float | None = None) -> Iterator[WorkerPool]:
    """Connect to the Dask cluster whose scheduler is at an address, e.g. tcp://127.0.0.1:8786, for so many trials.

    `within_s`: longest wait for it; None: 10 s. Raises MissingExtra without Dask, Unreachable without an answer.
    """
    try:
        from distributed import Client
    except ImportError:
        raise MissingExtra("--scheduler needs Dask: pip install 'arva-hil[dask]'") from None
    for name in ("distributed", "distributed.client", "tornado.application"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # errors are reported here
    try:
        client = Client(address, timeout=within_s or _CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise Unreachable(f"no Dask scheduler answers at {address}: {error}") from None

    def lost() -> WorkerPoolError | None:
        return None if client.status == "running" else Unreachable(f"the scheduler at {address} is gone")

    workers = client.nthreads()
    with client:
        executor = client.get_executor(pure=False)
        try:
            name = f"Dask workers: {len(workers)}, threads: {sum(workers.values())}"
            yield WorkerPool(name, executor, _AHEAD, lost, min(_SHARD, trials // _AHEAD + 1))
        finally:
            executor.shutdown(wait=False)


class _Processes(ProcessPoolExecutor):
    """Processes that ignore the signals of a terminal to the whole program. The parent process ends them."""

    def submit(self, *args: Any, **kwargs: Any) -> Future[Any]:
        if sys.platform == "win32":  # has neither such masks nor SIGHUP
            return super().submit(*args, **kwargs)
        # a new process inherits the mask
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
        try:
            return super().submit(*args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _hold(lifeline: Connection) -> None:
    """Run in a new process, and end it when the other end of the lifeline is closed, also by a kill.

    The garbage collector does not visit imported objects, as in a command.
    """

    def watch() -> None:
        lifeline.poll(None)
        os._exit(0)

    threading.Thread(target=watch, name="lifeline", daemon=True).start()
    sys.stdout = sys.stderr  # for what a strategy prints: stdout has the results
    gc.freeze()


def _results(future: Future[list[Result]], count: int) -> list[Result] | None:
    """Return the results of `count` trials, each None if their worker was lost."""
    if future.cancelled() or isinstance(error := future.exception(), BrokenExecutor):
        return None
    return [_failure(error)] * count if error else future.result()


def _failure(error: BaseException) -> Result:
    return Result(f"{FAILED}{type(error).__name__}: {error}", None, None, 0.0, 0.0, 0)
