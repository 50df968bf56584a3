"""A transmitter that moves, as that of a rescuer, is said to move and put aside; the buried one is found."""

from __future__ import annotations

import math

import numpy as np

from arva_hil.cli.search_report import as_dict, result
from arva_hil.clock import StepClock
from arva_hil.config import parse
from arva_hil.events import Event
from arva_hil.events.searches import TransmitterMoves
from arva_hil.registry import STRATEGIES
from arva_hil.runtime.loop import run
from arva_hil.search.strategies.estimate import Estimate
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import Observation
from arva_hil.simulated.closed_loop import ClosedLoop
from tests.search.test_drift import heard

WORLD = """spec: 2
transmitters:
  - {id: 1, enu: [-24, -18, -1]}
  - id: 2
    path:
      frame: enu
      end: loop
      points: [[0, 8, 4, 1], [30, 10, 30, 1], [65, -24, 25, 1], [100, 5, 5, 1], [150, 30, 30, 1]]
"""


def test_the_one_who_walks_is_put_aside_and_the_buried_one_is_found() -> None:
    told, clock = list[Event](), StepClock()
    plan = SearchPlan(STRATEGIES["estimate"], limit_s=300.0)
    loop = ClosedLoop(
        parse(WORLD, "world"), plan, start=clock.now(), stream_hz=10.0, emit=lambda _, event: told.append(event)
    )
    (drone,) = loop.drones
    run(loop.tasks, clock, until=500.0, stopped=lambda: drone.search.outcome is not None)
    outcome = drone.search.outcome
    assert outcome is not None
    assert (outcome.kind, outcome.id) == ("found", 1)
    assert outcome.found is not None
    assert math.dist(outcome.found[:2], (-18, -24)) < 0.5
    (moves,) = (event for event in told if isinstance(event, TransmitterMoves))
    assert moves.transmitter == 2
    assert 0.2 < moves.speed_m_s < 3.0
    assert [one["id"] for one in as_dict(outcome)["moving"]] == [2]
    assert len(as_dict(outcome)["moving"][0]["track"]) > 4
    assert any(line.startswith("transmitter 2 moves, at about ") for line in result(outcome))


def test_a_transmitter_that_stands_still_has_no_track_though_places_drift() -> None:
    strategy = Estimate(1.0)
    for k in range(120):
        at = np.array([15 * math.cos(0.1 * k), 15 * math.sin(0.1 * k), -3.0])
        d_m, delta = heard(at)
        drift = 2.0 * np.array([math.sin(0.02 * k), math.cos(0.03 * k), 0.0])
        place = tuple((at + drift).tolist())
        strategy.observe(Observation(1.5 * k, place, np.eye(3), round(100 * d_m), round(math.degrees(delta)), False))
        assert strategy.track == ()
