"""Whatever a strategy of one's own does wrong, the search ends clearly and the vehicle comes down."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from test_client import BOTH, VICTIM, GoTo, World, ardupilot, px4

from arva_hil.events.searches import StrategySlow
from arva_hil.search.strategy import Observation, Position

CURE = "; mend it, and fly it in arva-hil demo first"
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
        def hear(self, observation: Observation) -> None:
            self.found = said()

    return Bad


def raising(error: BaseException) -> Callable[[], Any]:
    def fail() -> None:
        raise error

    return fail


def came_down(world: World) -> None:
    assert not world.armed
    assert world.ned[2] == pytest.approx(0.0, abs=0.05)
    ended = world.clock.now()
    world.pass_s(5)
    assert world.orders(ended + 0.01) == []


@BOTH
@pytest.mark.parametrize(
    ("said", "shown"),
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
    ids=["None", "NaN", "infinite", "three", "texts", "text", "matrix", "coroutine", "no repr", "huge"],
)
def test_what_is_no_velocity_ends_the_search_and_it_lands(
    make: Callable[[], Any], said: Callable[[], Any], shown: str
) -> None:
    world = World(make(), strategy=saying(said))
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of a coroutine that nobody waited for
        kind, how = world.end()
    assert kind == "failed"
    assert how.startswith(f"the strategy has failed: velocity returned {shown}")
    assert how.endswith(f", {EXPECTED}{CURE}")
    came_down(world)


@pytest.mark.parametrize("said", [[0.6, 0.8], np.array([0.6, 0.8]), (np.float32(0.6), np.int64(1))])
def test_two_numbers_are_a_velocity_whatever_they_come_in(said: Any) -> None:
    world = World(ardupilot(), strategy=saying(lambda: said), limit_s=8.0)
    assert world.end() == ("not found", "not found in 8 s")
    assert math.hypot(*world.ned[:2]) > 4.0


def test_a_billion_metres_a_second_are_as_fast_as_is_allowed() -> None:
    world = World(ardupilot(), strategy=saying(lambda: (1e9, -1e9)), limit_s=20.0, speed=1.0)
    assert world.end() == ("not found", "not found in 20 s")
    flown = [math.hypot(row.v_north, row.v_east) for row in world.rows]
    assert max(flown) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        (lambda: VICTIM, f"{VICTIM}, expected None or arva_hil.Found(north, east)"),
        (lambda: True, "True, expected None or arva_hil.Found(north, east)"),
        (nothing, "a coroutine (write def, not async def), expected None or arva_hil.Found(north, east)"),
    ],
    ids=["a tuple", "True", "a coroutine"],
)
def test_what_is_no_place_ends_the_search_and_it_lands(said: Callable[[], Any], shown: str) -> None:
    world = World(ardupilot(), strategy=finding(said))
    assert world.end() == ("failed", f"the strategy has failed: found is {shown}{CURE}")
    came_down(world)


@BOTH
@pytest.mark.parametrize(
    ("error", "shown"),
    [
        (ZeroDivisionError("float division by zero"), "ZeroDivisionError('float division by zero')"),
        (SystemExit(3), "SystemExit(3)"),
        (RecursionError("deep"), "RecursionError('deep')"),
        (UntoldError(), "a UntoldError"),
    ],
    ids=["an error", "an exit", "too deep", "no repr"],
)
def test_what_it_raises_ends_the_search_and_says_where(
    make: Callable[[], Any], error: BaseException, shown: str
) -> None:
    world = World(make(), strategy=saying(raising(error)))
    kind, how = world.end()
    assert kind == "failed"
    assert how.startswith(f"the strategy has failed: {shown} (test_bad_strategies.py:")
    assert how.endswith(CURE)
    came_down(world)


# -- it takes its time -------------------------------------------------------------------------------------


def slow(world: World, seconds: float, times: int = 10**6) -> None:
    """From now on the strategy of a world takes so long for each velocity; meanwhile nothing else is done."""
    assert world.client.mission is not None
    strategy: Any = world.client.mission._choice.strategy
    velocity, left = strategy.velocity, [times]

    def slowly(time_s: float, position: Position) -> Any:
        if left[0] > 0:
            left[0] -= 1
            world.clock.wait(world.clock.now() + seconds)
        return velocity(time_s, position)

    strategy.velocity = slowly


def test_one_that_takes_ten_seconds_twice_ends_it_and_it_lands() -> None:
    world = World(ardupilot())
    world.hunt()
    slow(world, 10.0)
    kind, how = world.end()
    assert kind == "failed"
    took = "it took 10.0 s to answer, more than 1 s, and the vehicle was not steered meanwhile"
    assert how == f"the strategy has failed: {took}{CURE}"
    assert [event.took_s for event in world.events if isinstance(event, StrategySlow)] == pytest.approx([10.0, 10.0])
    came_down(world)


def test_one_that_takes_long_once_may_have_been_a_pause_of_the_computer() -> None:
    world = World(ardupilot())
    world.hunt()
    slow(world, 2.0, times=1)
    assert world.end() == ("found", "found")
    assert len([event for event in world.events if isinstance(event, StrategySlow)]) == 1


def test_px4_does_not_wait_for_it_and_the_end_names_the_strategy() -> None:
    """It leaves OFFBOARD by itself after a second without set-points, and is left where it is."""
    world = World(px4())
    world.hunt()
    slow(world, 10.0)
    kind, how = world.end()
    assert kind == "failed"
    assert how.startswith("the mode is ")
    assert how.endswith("; the strategy took 10.0 s to answer")
    ended, place = world.clock.now(), world.ned
    world.pass_s(5)
    assert world.orders(ended + 0.01) == []
    assert world.ned == pytest.approx(place, abs=0.5)


def test_a_dry_run_notices_it_too() -> None:
    class Slow(GoTo):
        def velocity(self, time_s: float, position: Position) -> Any:
            world.clock.wait(world.clock.now() + 1.5)
            return super().velocity(time_s, position)

    world = World(ardupilot(), {"dry_run": True}, strategy=Slow)
    kind, how = world.end()
    assert (kind, how.partition(",")[0]) == ("failed", "dry run: the strategy has failed: it took 1.5 s to answer")
    assert world.orders() == []
