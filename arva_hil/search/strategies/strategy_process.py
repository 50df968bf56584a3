"""The process in which a strategy computes while a real vehicle flies.

A strategy may block, never return, or take all memory: the steering loop goes on. The process ends with its parent.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import pickle
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

from arva_hil.search.strategies.analysis import Analysis, AnalysisResult, Order, failed, killed
from arva_hil.search.strategies.strategy import Strategy

_MEMORY: Final = 1 << 31  # bytes that it may add; beyond, a strategy gets a MemoryError
_LONGEST: Final = 1 << 14  # bytes of an answer: a pipe passes these in one piece
_PDEATHSIG: Final = 1  # of prctl(2)


class StrategyProcess:
    """A worker in a process. Make it before any thread begins and before any link is open: both would be copied."""

    def __init__(self, make: Callable[[], Strategy]) -> None:
        context = multiprocessing.get_context("fork")
        self._pipe, far = context.Pipe()
        self._process = context.Process(target=_serve, args=(self._pipe, far, make), name="strategy", daemon=True)
        self._process.start()
        self._schedule = Path(f"/proc/{self._process.pid}/schedstat")
        far.close()

    def send(self, orders: Sequence[Order]) -> None:
        with suppress(OSError):  # if it has ended, as `receive` reports
            self._pipe.send(orders)

    def receive(self) -> AnalysisResult | None:
        try:
            if not self._pipe.poll():
                return None
            answer: AnalysisResult = pickle.loads(self._pipe.recv_bytes())
        except (EOFError, OSError):
            code = self._process.exitcode  # None: it has not ended yet, only its pipe
            return None if code is None else AnalysisResult(failed=killed(code))
        return answer

    @property
    def starved_s(self) -> float:
        try:
            return int(self._schedule.read_text().split()[1]) / 1e9
        except (OSError, IndexError):  # it has ended, or this Linux has no count
            return 0.0

    def close(self) -> None:
        self._process.kill()
        self._process.join()
        self._pipe.close()


def _serve(parent: Connection, pipe: Connection, make: Callable[[], Strategy]) -> None:
    """Follow orders until the parent ends. The parent ends this process: after a signal it still needs answers."""
    parent.close()  # or the pipe would never end
    sys.stdout = sys.stderr  # for what the strategy prints: stdout has the results of the command
    for ignored in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(ignored, signal.SIG_IGN)
    if sys.platform == "linux":  # elsewhere the memory has no limit, and the end of the pipe ends the process
        _limit()
    analysis = Analysis(make, at_once=False)
    while True:
        try:
            orders = pipe.recv()
        except EOFError:
            return
        pipe.send_bytes(_packed(analysis.answer(orders)))


def _limit() -> None:
    """Limit the memory of this process, end it with its parent, and before others if memory is short."""
    import resource  # only Unix has it

    ctypes.CDLL(None).prctl(_PDEATHSIG, signal.SIGKILL)
    Path("/proc/self/oom_score_adj").write_text("1000")
    used = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    soft = used + _MEMORY if hard == resource.RLIM_INFINITY else min(used + _MEMORY, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def _packed(answer: AnalysisResult) -> bytes:
    """Return the bytes of an answer; of a failure if it cannot be sent."""
    try:
        data = pickle.dumps(answer)
        if len(data) > _LONGEST:
            raise ValueError(f"its answer has {len(data)} bytes, at most {_LONGEST} expected")
        return data
    except Exception as error:
        return pickle.dumps(AnalysisResult(failed=failed(error)))
