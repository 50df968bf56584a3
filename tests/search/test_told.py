"""What a search tells of itself to whoever watches: frames and where they were heard, beliefs, the place found."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from arva_hil.autopilot.following.navigation import VehicleState
from arva_hil.clock import StepClock
from arva_hil.config import DEFAULT
from arva_hil.events import Event
from arva_hil.events.searches import BeliefChanged, FrameHeard, FromSearch, PlaceFound, TakeOffPoint
from arva_hil.model.field import LocalFrame, Mount
from arva_hil.runtime.loop import run
from arva_hil.search.flight.airborne import FlightSetup, MissionRun
from arva_hil.search.mission.mission import Mission
from arva_hil.search.strategies.estimate import Estimate
from arva_hil.search.strategies.extremum import Extremum
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import Belief
from arva_hil.simulated import HOME
from arva_hil.simulated.closed_loop import ClosedLoop
from firmware_proto import Channel, Frame
from tests.search.world import PAPER, fly

FRAME = Frame(1, 1, (Channel(1, 1, 1234, 17),))


class Watcher:
    def __init__(self) -> None:
        self.told: list[Event] = []

    def observe(self, event: Event) -> None:
        if isinstance(event, FromSearch):
            self.told.append(event.event)


class Thinker(Estimate):
    """Believes what it is told to."""

    said: object = Belief(((1.0, 2.0, 1.0),), None, (3.0, 4.0))

    @property
    def belief(self) -> Belief:
        return self.said  # type: ignore[return-value]


def test_a_flight_tells_its_take_off_point_its_frames_its_beliefs_and_the_place() -> None:
    watcher, clock = Watcher(), StepClock()
    loop = ClosedLoop(
        DEFAULT,
        SearchPlan(Estimate),
        start=clock.now(),
        observers=[watcher],
    )
    run(loop.tasks, clock, until=300.0, stopped=lambda: loop.drones[0].search.outcome is not None)
    (point,) = (event for event in watcher.told if isinstance(event, TakeOffPoint))
    assert (point.lat, point.lon, point.alt) == pytest.approx(HOME, abs=1e-3)
    frames = [event for event in watcher.told if isinstance(event, FrameHeard)]
    placed = [event.position for event in frames if event.position is not None]
    assert placed
    assert any(event.position is None for event in frames)  # on the ground, before the take-off point is known
    beliefs = [event for event in watcher.told if isinstance(event, BeliefChanged)]
    assert all(math.isclose(sum(share for _, _, share in b.hypotheses), 1.0, abs_tol=1e-9) for b in beliefs)
    assert len(beliefs[0].hypotheses) > 1
    assert all(belief.goal is not None for belief in beliefs)
    (found,) = (event for event in watcher.told if isinstance(event, PlaceFound))
    assert math.dist((found.north_m, found.east_m), (20.0, 5.0)) < 1.0
    assert found.sure
    assert found.covariance is not None


def test_beliefs_are_told_twice_a_second_at_most() -> None:
    told: list[Event] = []
    mission = Mission(SearchPlan(Thinker), 0.0, (0.0, 0.0, -3.0), emit=told.append)
    for step in range(21):
        mission.on_frame(
            Frame(step, 1, (Channel(1, 1, 1234 - step, 17),)), step / 10, (0.1 * step, 0.0, -3.0), np.eye(3)
        )
    beliefs = [event for event in told if isinstance(event, BeliefChanged)]
    assert [event.time_s for event in beliefs] == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert beliefs[0] == BeliefChanged(0.0, 1, ((1.0, 2.0, 1.0),), None, (3.0, 4.0))


def test_an_estimate_believes_in_where_it_goes() -> None:
    estimate = Estimate(1.0)
    assert estimate.belief == Belief()
    flight = fly(estimate, PAPER[0])
    assert flight.found is not None
    best = max(estimate.belief.hypotheses, key=lambda place: place[2])
    assert math.dist(best[:2], flight.found[:2]) < 0.5
    assert Extremum(1.0).belief == Belief()


def test_frames_are_told_ten_times_a_second_with_the_place_of_the_receiver() -> None:
    told: list[Event] = []
    half = math.sqrt(0.5)
    east = VehicleState(0.0, np.array([3.0, 2.0, -1.0]), np.zeros(3), (half, 0.0, 0.0, half), 0.0)
    poses = {0.0: None}
    session: Any = SimpleNamespace(navigation=SimpleNamespace(state_at=lambda now, origin: poses.get(now, east)))
    ground: Any = None
    setup = FlightSetup(SearchPlan(Estimate, mount=Mount((1.0, 0.0, 0.0))), session, ground, 0.0, told.append)
    flight = MissionRun(setup)
    flight.origin = LocalFrame(46.0, 7.0, 500.0)
    for step in range(5):
        flight.on_frame(FRAME, flight.pose(step / 20), step / 20)
    assert told[0] == FrameHeard(0.0, FRAME, None, None)
    (second, third) = told[1:]
    assert (second.time_s, third.time_s) == (0.1, 0.2)
    assert isinstance(second, FrameHeard)
    assert second.position == pytest.approx((3.0, 3.0, -1.0))
    assert second.heading_deg == pytest.approx(90.0)
