"""A search is the same everywhere on Earth: at the date line, near the poles, at 4,300 m."""

from __future__ import annotations

import math

import pytest

from arva_hil.clock import StepClock
from arva_hil.config import parse
from arva_hil.model.field import LocalFrame
from arva_hil.registry import STRATEGIES
from arva_hil.runtime.loop import run
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.simulated import closed_loop
from arva_hil.simulated.closed_loop import ClosedLoop
from tests.search.test_client import VICTIM, World
from tests.simulated_px4 import Px4

Place = tuple[float, float, float]

PLACES = pytest.mark.parametrize(
    "home",
    [
        pytest.param((-16.5, 179.99998, 10.0), id="west of the date line"),
        pytest.param((65.2, -179.99999, 5.0), id="east of the date line"),
        pytest.param((70.0, 25.8, 300.0), id="70° north"),
        pytest.param((89.9, -30.0, 5.0), id="near the north pole"),
        pytest.param((-89.9, 120.0, 2800.0), id="near the south pole"),
        pytest.param((-22.9, -67.8, 4300.0), id="4,300 m"),
    ],
)


@PLACES
def test_a_transmitter_is_found_and_its_place_on_earth_said(home: Place) -> None:
    """PX4 is told a place on Earth to take off to, ArduPilot is not."""
    world = World(Px4(home))
    assert world.end() == ("found", "found")
    assert world.client.outcome is not None
    assert world.client.outcome.lat_lon is not None
    lat, lon = world.client.outcome.lat_lon
    assert -180.0 <= lon <= 180.0
    north, east, _ = LocalFrame(*home).ned(lat, lon, home[2])
    assert math.dist((north, east), VICTIM) < 0.1
    assert math.dist(world.ned[:2], VICTIM) < 0.6


@pytest.mark.parametrize("home", [(65.2, -179.99999, 5.0), (-89.9, 120.0, 2800.0)])
def test_the_emulator_and_a_search_agree_there(monkeypatch: pytest.MonkeyPatch, home: Place) -> None:
    monkeypatch.setattr(closed_loop, "HOME", home)
    scenario = parse("spec: 1\ntransmitters: [{id: 1, ned: [5, 3, 0.5]}]", "test")
    plan, clock = SearchPlan(STRATEGIES["flux"], area=(-20, -20, 20, 20)), StepClock()
    loop = ClosedLoop(scenario, plan, start=0.0, stream_hz=10.0)
    run(loop.tasks, clock, until=300.0, stopped=lambda: loop.drones[0].search.outcome is not None)
    assert loop.drones[0].search.outcome is not None
    assert loop.drones[0].search.outcome.kind == "found"
    error = loop.drones[0].error()
    assert error is not None
    assert error < 1.0
