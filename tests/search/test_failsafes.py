"""At each failsafe of the built-in vehicle the search obeys: it ends, and orders nothing any more."""

from __future__ import annotations

import math

import pytest

from arva_hil.autopilot.commanding.authority import BOUND_MS
from arva_hil.simulated.arducopter import FAILSAFES
from tests.search.test_client import World, ardupilot

TAKEN = "the mode is {}: the pilot or a failsafe has taken over"


def struck(name: str, phase: str) -> tuple[World, float]:
    """A search whose vehicle has its failsafe in this phase, and when that was."""
    world = World(ardupilot(), take_off=6.0, height=6.0)
    world.reach(phase)
    if phase == "flying":
        world.hunt()
    elif phase == "landing":
        world.until(lambda: world.client._commander.lands_by_itself)
    at = world.clock.now()
    world.vehicle.trigger(FAILSAFES[name], at)  # type: ignore[union-attr]
    return world, at


@pytest.mark.parametrize("name", FAILSAFES)
@pytest.mark.parametrize("phase", ["climbing", "flying"])
def test_in_the_air_it_ends_at_once_and_the_vehicle_does_what_its_failsafe_does(name: str, phase: str) -> None:
    world, at = struck(name, phase)
    assert world.end(2.0) == ("failed", TAKEN.format(FAILSAFES[name].mode.name))
    world.until(lambda: not world.armed)
    world.pass_s(5)
    assert world.orders(at + BOUND_MS / 1000 + 0.1) == []  # 0.1 s: its mode is said at 10 Hz
    assert world.vehicle.state == f"{FAILSAFES[name].mode.name}, disarmed, on the ground"  # type: ignore[union-attr]
    if FAILSAFES[name].mode.name == "RTL":
        assert math.hypot(*world.ned[:2]) < 1.5


@pytest.mark.parametrize("name", FAILSAFES)
def test_while_it_lands_the_failsafe_lands_it_on(name: str) -> None:
    """One that lands too is no other mode: the landing goes on, and the place stays found."""
    world, at = struck(name, "landing")
    kind, how = world.end(90.0)
    mode = FAILSAFES[name].mode.name
    assert (kind, how) == ("found", "found" if mode == "LAND" else TAKEN.format(mode))
    world.until(lambda: not world.armed)
    world.pass_s(5)
    assert world.orders(at + BOUND_MS / 1000 + 0.1) == []


@pytest.mark.parametrize("name", FAILSAFES)
def test_on_the_ground_nothing_takes_off_after_it(name: str) -> None:
    """Before it is armed a failsafe only speaks; an empty battery is not armed."""
    world = World(ardupilot(), {"countdown_s": 3.0, "timeout_s": 10.0})
    world.until(lambda: world.said and "arming in 3 s" in world.said)
    world.vehicle.trigger(FAILSAFES[name], world.clock.now())  # type: ignore[union-attr]
    if not FAILSAFES[name].empty:
        world.reach("flying")
        return
    kind, how = world.end(30.0)
    assert (kind, how) == (
        "failed",
        "the battery is not healthy, or not measured: nothing was flown",
    )
    assert world.orders() == []
