"""Whatever a strategy does wrong, also in its process, the search ends clearly and the vehicle comes down."""

from __future__ import annotations

import ctypes
import itertools
import math
import os
import select
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from typing import Any

import numpy as np
import pytest

from arva_hil.clock import RealClock, StepClock
from arva_hil.events import Event
from arva_hil.events.searches import SearchBegun, SearchEnded, SearchHeldUp, StrategySlow
from arva_hil.events.words.reasons import in_words
from arva_hil.safe_text import shown
from arva_hil.search.mission.choice import Guidance
from arva_hil.search.mission.mission import Mission
from arva_hil.search.strategies.analysis import Analysis, AnalysisResult, Inline, Order, checked_found
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import Belief, Found, Observation, Position, Velocity
from arva_hil.search.strategies.strategy_process import StrategyProcess
from firmware_proto import MID, Channel, Frame
from tests.every import every
from tests.search.test_client import VICTIM, GoTo, World, ardupilot, px4, set_points, widest_gap

CURE = "; fix the error, and fly it in arva-hil demo first"
EXPECTED = "expected two finite numbers, m/s north and east"


async def nothing() -> tuple[float, float]:
    return 0.0, 0.0


class Untold:
    """Raises when it is shown."""

    def __repr__(self) -> str:
        raise ValueError


class UntoldError(Exception):
    """Raises when it is shown."""

    def __repr__(self) -> str:
        raise ValueError


def saying(said: Callable[[], Any]) -> type[GoTo]:
    """A strategy whose velocity is this."""

    class Bad(GoTo):
        def velocity(self, time_s: float, position: Position) -> Any:
            return said()

    return Bad


def finding(said: Callable[[], Any]) -> type[GoTo]:
    """A strategy whose `found` is this once it has heard something."""

    class Bad(GoTo):
        def observe(self, observation: Observation) -> None:
            self.found = said()

    return Bad


def raising(error: BaseException) -> Callable[[], Any]:
    def fail() -> None:
        raise error

    return fail


def fails_and_lands(world: World) -> str:
    how = world.fail()
    assert world.on_the_ground
    world.stay_silent(5, since=world.clock.now() + 0.01)
    return how


@every(
    "said, shown",
    [
        (lambda: None, "None"),
        (lambda: (math.nan, 1.0), "(nan, 1.0)"),
        (lambda: (math.inf, 1.0), "(inf, 1.0)"),
        (lambda: (1.0, 0.0, 0.0), "(1.0, 0.0, 0.0)"),
        (lambda: ["1", "2"], "['1', '2']"),
        (lambda: "12", "'12'"),
        (lambda: np.zeros((2, 2)), "array("),
        (nothing, "a coroutine (write def, not async def)"),
        (Untold, "a Untold"),
        (lambda: "x" * 10**6, f"'{'x' * 199}…"),
    ],
)
def test_what_is_no_velocity_fails(said: Callable[[], Any], shown: str) -> None:
    guidance = Guidance(Inline(lambda: saying(said)(1.0)), lambda event: None, 10.0)
    guidance.add(1, Observation(0.0, (0.0, 0.0, -1.0), np.eye(3), 900, 20, False))
    guidance.begin(1, has_id=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of a coroutine that nobody waited for
        answer = guidance.steer(0.0, (0.0, 0.0, -1.0))
    assert answer.failed.startswith(f"the strategy has failed: velocity returned {shown}")
    assert answer.failed.endswith(f", {EXPECTED}{CURE}")


def test_a_failure_counts_whichever_strategy_it_is_of() -> None:
    """A process that was killed does not know the number of the present strategy."""
    worker = Inline(lambda: GoTo(1.0))
    worker.receive = lambda: AnalysisResult(failed="killed")  # type: ignore[method-assign]
    guidance = Guidance(worker, lambda event: None, 10.0)
    guidance.add(1, observation())
    guidance.begin(1, has_id=True)
    assert guidance.steer(0.0, AT) == AnalysisResult(failed="killed")


def test_what_is_no_velocity_ends_the_search_and_it_lands() -> None:
    world = World(ardupilot(), strategy=saying(lambda: None))
    assert fails_and_lands(world) == f"the strategy has failed: velocity returned None, {EXPECTED}{CURE}"


def answered(strategy: Callable[[float], Any]) -> AnalysisResult:
    """What comes of a strategy that gets a reading and is asked to steer."""
    o = observation()
    orders = (Analysis.add, 1, o), (Analysis.begin, 1, 1, True), (Analysis.observe, o, 1.0), (Analysis.steer, 0.0, AT)
    return Analysis(lambda: strategy(1.0), at_once=True).answer(orders)


@every("said", [np.array([0.6, 0.8]), (np.float32(0.6), np.float64(0.8))])
def test_two_numbers_are_a_velocity_whatever_they_come_in(said: Any) -> None:
    velocity = answered(saying(lambda: said)).velocity
    assert velocity == pytest.approx((0.6, 0.8))
    assert [type(v) for v in velocity or ()] == [float, float]


def test_a_billion_metres_a_second_are_as_fast_as_is_allowed() -> None:
    world = World(ardupilot(), strategy=saying(lambda: (1e9, -1e9)), limit_s=6.0, speed=1.0)
    assert world.end() == ("not found", "not found in 6 s")
    flown = [math.hypot(row.v_north, row.v_east) for row in world.rows]
    assert max(flown) == pytest.approx(1.0)


NO_NUMBERS = [
    Found("8", None),  # type: ignore[arg-type]
    Found(8.0, 3.0, now=(1.0,)),  # type: ignore[arg-type]
    Found(8.0, 3.0, covariance=(1.0, 0.0, 1.0, 0.0)),  # type: ignore[arg-type]
]


@every(
    "said, text",
    [
        (lambda: VICTIM, f"{VICTIM}, expected None or arva_hil.Found(north, east)"),
        (nothing, "a coroutine (write def, not async def), expected None or arva_hil.Found(north, east)"),
        *((lambda bad=bad: bad, f"{shown(bad)}, expected numbers, m north and east") for bad in NO_NUMBERS),
    ],
)
def test_what_is_no_place_fails(said: Callable[[], Any], text: str) -> None:
    assert answered(finding(said)).failed == f"the strategy has failed: found is {text}{CURE}"


def test_what_is_no_place_ends_the_search_and_it_lands() -> None:
    how = fails_and_lands(World(ardupilot(), strategy=finding(lambda: VICTIM)))
    assert how.startswith("the strategy has failed: found is ")


@every("make, shown", [(partial(SystemExit, 3), "SystemExit(3)"), (UntoldError, "a UntoldError")])
def test_what_it_raises_is_said_with_its_place(make: Callable[[], BaseException], shown: str) -> None:
    error = make()
    how = answered(saying(raising(error))).failed
    assert how.startswith(f"the strategy has failed: {shown} (test_bad_strategies.py:")
    assert how.endswith(CURE)


def test_what_it_raises_ends_the_search_and_says_where() -> None:
    how = fails_and_lands(World(px4(), strategy=saying(raising(ZeroDivisionError("float division by zero")))))
    shown = "ZeroDivisionError('float division by zero')"
    assert how.startswith(f"the strategy has failed: {shown} (test_bad_strategies.py:")
    assert how.endswith(CURE)


@every("track", [[(1.0, 2.0, 3.0)], ((1.0, 2.0),)])
def test_a_track_of_its_own_is_no_transmitter_that_moves(track: Any) -> None:
    """The name is used by the built-in strategies; one of somebody else may have it for anything."""
    answer = answered(type("Own", (GoTo,), {"track": track}))
    assert (answer.track, answer.failed) == ((), "")


@pytest.mark.parametrize("north", [math.nan, math.inf, 1e300])
def test_a_place_that_is_not_on_earth_is_none(north: float) -> None:
    assert checked_found(Found(north, 0.0)) is None


def test_arrays_are_places_too() -> None:
    world = World(ardupilot(), strategy=finding(lambda: Found(*VICTIM, None, None, np.array(VICTIM))))  # type: ignore[arg-type]
    assert world.end()[0] in ("found", "not sure")


# -- it takes its time -------------------------------------------------------------------------------------


class Late(Inline):
    """A worker whose velocities take so long on the clock of a world."""

    def __init__(self, seconds: float, strategy: Callable[[float], Any] = GoTo) -> None:
        super().__init__(partial(strategy, 1.0))
        self.seconds = seconds
        self.clock = StepClock()  # until a world gives its own
        self.busy = 0.0  # part of the time without a processor
        self._due = -math.inf

    def send(self, orders: Sequence[Order]) -> None:
        super().send(orders)
        slow = any(follow is Analysis.steer for follow, *_ in orders)
        self._due = self.clock.now() + (self.seconds if slow else 0.05)

    def receive(self) -> AnalysisResult | None:
        return super().receive() if self.clock.now() >= self._due else None

    @property
    def starved_s(self) -> float:
        return self.busy * self.clock.now()


def late(make: Callable[[], Any], seconds: float, **plan: Any) -> World:
    worker = Late(seconds)
    world = World(make(), {"worker": worker}, **plan)
    worker.clock = world.clock
    return world


def moved(world: World) -> list[tuple[float, float]]:
    """When each set-point of the search left, and its horizontal speed; they leave in time."""
    begun, ended = (
        next(event.time_s for event in world.events if isinstance(event, kind)) for kind in (SearchBegun, SearchEnded)
    )
    sent = [(at, math.hypot(m.vx, m.vy)) for at, m in set_points(world) if begun + 0.5 <= at < ended]
    assert min(b[0] - a[0] for a, b in itertools.pairwise(sent)) >= 0.15
    assert widest_gap(at for at, _ in sent) <= 0.25
    return sent


def test_one_that_takes_three_seconds_each_time_is_warned_of_and_finds_all_the_same() -> None:
    world = late(px4, 3.0)
    assert world.end() == ("found", "found")
    assert world.ned == pytest.approx((*VICTIM, 0.0), abs=0.8)
    took = [event.took_s for event in world.events if isinstance(event, StrategySlow)]
    assert took == pytest.approx([1.1, 2.2], abs=0.3)
    still = [[at for at, _ in some] for is_still, some in itertools.groupby(moved(world), lambda one: one[1] < 0.01)]
    moving = still[1::2]
    assert len(moving) > 3
    assert all(times[-1] - times[0] == pytest.approx(1.0, abs=0.3) for times in moving[:-1])
    heights = [-row.down_m for row in world.rows if row.phase == "flying" and 15 < row.time_s < 25]
    assert heights == pytest.approx([1.0] * len(heights), abs=0.2)


def test_one_that_never_answers_keeps_its_velocity_for_a_second_hovers_and_lands() -> None:
    world = late(ardupilot, 0.0)
    world.hunt()
    worker: Any = world.client._flight._setup.worker
    worker.seconds, stuck = math.inf, world.clock.now()
    how = fails_and_lands(world)
    assert how.startswith("the strategy has failed: it has not answered for 10.")
    assert how.endswith(f" s{CURE}")
    speeds = [speed for at, speed in moved(world) if at > stuck]
    assert sum(speed > 0.9 for speed in speeds) == pytest.approx(5, abs=2)
    assert speeds[-40:] == [0.0] * 40
    assert [event.took_s for event in world.events if isinstance(event, StrategySlow)][-1] > 7


def test_a_busy_computer_is_no_slow_strategy() -> None:
    world = late(ardupilot, 12.0)
    worker: Any = world.client._flight._setup.worker
    worker.busy = 0.9
    slow = list[StrategySlow]()

    def seen() -> bool:
        slow[:] = [event for event in world.events if isinstance(event, StrategySlow)]
        return len(slow) > 3

    world.until(seen)
    assert world.client.outcome is None
    assert [event.starved_s for event in slow] == pytest.approx([0.9 * event.took_s for event in slow])


def test_a_pause_of_the_computer_is_no_slow_strategy() -> None:
    world = late(ardupilot, 0.5)
    world.hunt()
    world.clock.wait(world.clock.now() + 14.0)
    assert world.end() == ("found", "found")
    assert [event.gap_s for event in world.events if isinstance(event, SearchHeldUp)] == pytest.approx([14.0], abs=0.3)
    assert not [event for event in world.events if isinstance(event, StrategySlow)]


def test_a_dry_run_notices_it_too() -> None:
    world = late(ardupilot, math.inf, dry_run=True)
    assert world.end()[0] == "would fly"
    assert [event.took_s for event in world.events if isinstance(event, StrategySlow)]
    assert world.orders() == []


def test_a_receiver_that_is_silent_is_not_taken_for_a_slow_strategy() -> None:
    world = late(ardupilot, 0.05)
    world.hunt()
    world.port.says = lambda _: None
    assert world.end() == ("failed", "no good frame from the receiver for 10 s")
    assert not [event for event in world.events if isinstance(event, StrategySlow)]


# The process of a strategy: whatever a strategy does in it, the steering loop gets its turn and a clear answer


AT: Position = (3.0, 4.0, -1.0)
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
        (fails, "ZeroDivisionError('by zero') (test_bad_strategies.py:"),
        (allocates, "MemoryError() (test_bad_strategies.py:"),
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


def test_what_it_prints_goes_to_stderr(capfd: pytest.CaptureFixture[str]) -> None:
    def says() -> None:
        print("here I am", flush=True)

    with process(says) as worker:
        steered(worker)
    begun = (Analysis.add, 7, observation()), (Analysis.begin, 3, 7, True)
    Inline(partial(Does, says, 1.0)).send([*begun, (Analysis.observe, observation(), 1.0), (Analysis.steer, 1.0, AT)])
    assert capfd.readouterr() == ("", "here I am\n" * 2)


def test_its_exit_code_is_reported_although_its_pipe_ends_before() -> None:
    reader, writer = os.pipe()

    def ends_slowly() -> None:
        os.closerange(3, reader)
        os.closerange(reader + 1, 256)
        os.read(reader, 1)
        os._exit(3)

    with process(ends_slowly) as worker:
        worker.send([(Analysis.steer, 1.0, AT)])
        assert worker._pipe.poll(WITHIN_S)
        assert worker.receive() is None
        os.write(writer, b"now")
        assert "its process has ended (exit code 3)" in answer(worker).failed
    os.close(reader)
    os.close(writer)


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
        times, took_s = [], []
        while not mission.ended:
            times.append(clock.now())
            mission.on_frame(heard, clock.now(), AT, np.eye(3))
            assert mission.fly(clock.now(), AT)[:2] == (0.0, 0.0)
            took_s.append(clock.now() - times[-1])
            clock.wait(times[-1] + 0.2)
            assert clock.now() < WITHIN_S
    assert times[-1] - times[0] > 1.9
    assert sorted(took_s)[-2] < 0.05  # the computer may be late to wake up, and once in here
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
