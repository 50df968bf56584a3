"""The process of a strategy: whatever a strategy does in it, the steering loop gets its turn and a clear answer."""

from __future__ import annotations

import ctypes
import itertools
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from typing import Any

import numpy as np
import pytest

from arva_hil.clock import RealClock
from arva_hil.events import Event
from arva_hil.events.searches import StrategySlow
from arva_hil.events.words.reasons import in_words
from arva_hil.search.mission.mission import Mission
from arva_hil.search.strategies.analysis import Analysis, AnalysisResult
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import Belief, Found, Observation, Position, Velocity
from arva_hil.search.strategies.strategy_process import StrategyProcess
from firmware_proto import MID, Channel, Frame

AT: Position = (3.0, 4.0, -1.0)
CURE = "; fix the error, and fly it in arva-hil demo first"
WITHIN_S = 20.0  # for an answer, on a computer that is busy


class Does:
    """A strategy whose velocity is what a function returns."""

    found: Found | None = None

    def __init__(self, does: Callable[[], Any], speed: float) -> None:
        self._does = does

    def observe(self, observation: Observation) -> None: ...

    def velocity(self, time_s: float, position: Position) -> Velocity:
        said: Velocity = self._does()
        return said


class Thinks(Does):
    """A strategy whose belief is far too long."""

    belief = Belief(((1.0, 2.0, 0.5),) * 1000, None, (10**99999, 0.0))


def observation(time_s: float = 1.0) -> Observation:
    return Observation(time_s, AT, np.eye(3), 900, 20, False)


def answer(worker: StrategyProcess) -> AnalysisResult:
    clock = RealClock()
    while (come := worker.receive()) is None:
        assert clock.now() < WITHIN_S
        clock.wait(clock.now() + 0.005)
    return come


@contextmanager
def process(does: Callable[[], Any], strategy: type[Does] = Does) -> Iterator[StrategyProcess]:
    """The process of a strategy that has a transmitter to fly to."""
    with closing(StrategyProcess(partial(strategy, does, 1.0))) as worker:
        worker.send([(Analysis.add, 7, observation()), (Analysis.begin, 3, 7, True)])
        assert answer(worker) == AnalysisResult(3)
        yield worker


def steered(worker: StrategyProcess) -> AnalysisResult:
    worker.send([(Analysis.observe, observation(), 1.0), (Analysis.steer, 1.0, AT)])
    return answer(worker)


def fails() -> None:
    raise ZeroDivisionError("by zero")


def allocates() -> bytearray:
    return bytearray(1 << 34)


def blocks() -> None:
    """Hold Python's lock, as a library in C may do, and never return."""
    ctypes.PyDLL(None).sleep(10**6)


@pytest.mark.parametrize(
    ("does", "said"),
    [
        (fails, "ZeroDivisionError('by zero') (test_strategy_process.py:"),
        (allocates, "MemoryError() (test_strategy_process.py:"),
        (lambda: None, "velocity returned None, expected two finite numbers"),
        (lambda: os._exit(3), "its process has ended (exit code 3)"),
        (lambda: os.kill(os.getpid(), signal.SIGKILL), "its process has ended (signal 9)"),
    ],
)
def test_one_that_fails_is_named_with_its_error(does: Callable[[], Any], said: str) -> None:
    with process(does) as worker:
        failed = steered(worker).failed
    assert failed.startswith(f"the strategy has failed: {said}")
    assert failed.endswith(CURE)


def test_it_counts_the_time_without_a_processor() -> None:
    with process(lambda: (0.5, 0.0)) as worker:
        before = worker.starved_s
        steered(worker)
        assert 0 <= before <= worker.starved_s < WITHIN_S


def test_it_answers_although_the_terminal_interrupts_the_whole_group() -> None:
    with process(lambda: (0.5, 0.0)) as worker:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            os.kill(worker._process.pid or 0, number)
        assert steered(worker).velocity == (0.5, 0.0)


def test_an_answer_that_would_hold_the_loop_up_is_refused() -> None:
    with process(lambda: (0.5, 0.0), Thinks) as worker:
        failed = steered(worker).failed
    assert failed.startswith("the strategy has failed: ValueError(")
    assert "bytes" in failed


@pytest.mark.parametrize("does", [blocks, lambda: next(iter(int, 1)) or sum(itertools.count())])
def test_one_that_never_returns_ends_with_the_search(does: Callable[[], Any]) -> None:
    with process(does) as worker:
        worker.send([(Analysis.steer, 1.0, AT)])
        assert worker.receive() is None
        child = worker._process
    assert not child.is_alive()


def test_it_ends_with_a_parent_that_is_killed_also_where_the_system_does_not_end_it() -> None:
    """As between the fork and the order to end with the parent. The pipe ends once nobody holds it."""
    code = (
        "import os, signal, sys; from arva_hil.search.strategies.strategy_process import StrategyProcess; "
        "sys.platform = 'other'; "
        "worker = StrategyProcess(object); os.kill(os.getpid(), signal.SIGKILL)"
    )
    reader, writer = os.pipe()
    process = subprocess.Popen([sys.executable, "-c", code], stdout=writer)
    os.close(writer)
    assert process.wait(3 * WITHIN_S) == -signal.SIGKILL
    assert select.select([reader], [], [], WITHIN_S)[0], "the worker has not ended"
    os.close(reader)


def test_in_real_time_velocities_come_every_fifth_of_a_second_from_one_that_blocks() -> None:
    clock, events = RealClock(), list[Event]()
    heard = Frame(0, 1, (Channel(7, MID, 900, 20),))
    with closing(StrategyProcess(partial(Does, blocks, 1.0))) as worker:
        plan = SearchPlan(partial(Does, blocks), height=1.0, patience_s=2.0)
        mission = Mission(plan, clock.now(), AT, emit=events.append, worker=worker)
        times = []
        while not mission.ended:
            times.append(clock.now())
            mission.on_frame(heard, clock.now(), AT, np.eye(3))
            assert mission.fly(clock.now(), AT)[:2] == (0.0, 0.0)
            clock.wait(times[-1] + 0.2)
            assert clock.now() < WITHIN_S
    gaps = [b - a for a, b in itertools.pairwise(times)]
    assert len(gaps) > 9
    assert sorted(gaps)[-2] < 0.25  # one may be late where other programs compete for the processors
    assert in_words(mission.ended).startswith("the strategy has failed: it has not answered for 2.")
    assert [event for event in events if isinstance(event, StrategySlow)]


class Finds(Does):
    """A strategy that has found a place at the first reading."""

    def observe(self, observation: Observation) -> None:
        self.found = Found(3.0, 4.0)


def test_a_place_is_judged_after_the_answer_that_finds_it() -> None:
    """The fit of the strategy and that of the check take about as long: one answer has one of them."""
    with process(lambda: (0.5, 0.0), Finds) as worker:
        first = steered(worker)
        assert (first.found, first.velocity) == (None, None)
        assert steered(worker).found == Found(3.0, 4.0)


def test_a_new_strategy_gets_the_past_in_several_answers_and_then_gives_velocities() -> None:
    with process(lambda: (0.5, 0.0)) as worker:
        worker.send([(Analysis.add, 7, observation(n)) for n in range(200)])
        answer(worker)
        worker.send([(Analysis.begin, 4, 7, True)])
        answer(worker)
        velocities = [steered(worker).velocity for _ in range(8)]
    assert velocities == [None] * 6 + [(0.5, 0.0)] * 2
