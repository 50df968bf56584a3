"""A trial, flown."""

from __future__ import annotations

from pathlib import Path

import pytest

from arva_hil.campaign.plan import trials
from arva_hil.campaign.results import row
from arva_hil.campaign.trial import fly
from arva_hil.clock import StepClock
from arva_hil.config import parse
from arva_hil.config.campaign import parse_plan
from arva_hil.events import StatusReport
from arva_hil.registry import STRATEGIES
from arva_hil.runtime.loop import run
from arva_hil.search.mission.outcome import SearchStep
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.simulated.closed_loop import ClosedLoop
from tests.one_receiver import Diary

PLAN = "strategies: estimate\nscenarios: moving.yaml\nnoise: off\nlimit_s: 300\n"


def test_a_transmitter_on_a_path_is_found_where_it_is_at_the_end(tmp_path: Path) -> None:
    """It has stopped 8 m from where it was at first before anybody is near."""
    (tmp_path / "moving.yaml").write_text(
        "spec: 2\ntransmitters: [{id: 1, path: {frame: ned, points: [[0, 12, 0, 0], [10, 20, 0, 0]]}}]\n"
    )
    (planned,) = trials(parse_plan(PLAN, str(tmp_path / "plan.yaml")))
    one = row(planned, fly(planned.trial))
    assert (one.outcome, one.distance_m) == ("found", 12.0)
    assert one.error_m == pytest.approx(0, abs=0.5)
    assert one.hover_m == pytest.approx(0, abs=1.0)
    assert one.path_m > 20


def test_an_offset_of_the_position_is_an_error_on_earth_and_none_relative_to_the_vehicle(tmp_path: Path) -> None:
    text = "spec: 2\nnavigation_error: {bias_ned: [3, 0, 0]}\ntransmitters: [{id: 1, ned: [5, 5, 1]}]\n"
    (tmp_path / "moving.yaml").write_text(text)
    (planned,) = trials(parse_plan(PLAN, str(tmp_path / "plan.yaml")))
    one = row(planned, fly(planned.trial))
    assert (one.outcome, one.error_m) == ("found", pytest.approx(3, abs=0.3))
    assert one.relative_m == pytest.approx(0, abs=0.2)
    assert one.hover_m == pytest.approx(0, abs=1.0)


def test_a_reading_is_used_in_the_step_of_its_own_instant(tmp_path: Path) -> None:
    """There is one a second, on the second: five steps a second, and none of them hears it later."""
    (tmp_path / "near.yaml").write_text("transmitters: [{id: 1, ned: [12, 9, 0]}]\n")
    plan = PLAN.replace("moving", "near")
    (planned,) = trials(parse_plan(plan, str(tmp_path / "plan.yaml")))
    steps: list[SearchStep] = []
    fly(planned.trial, steps.append)
    heard = [step.time_s for step in steps if step.phase == "flying" and step.d_cm is not None]
    assert len(heard) > 5
    assert heard == pytest.approx([round(at) for at in heard], abs=1e-6)


def test_several_drones_find_one_transmitter_each_and_the_time_is_that_of_the_last(tmp_path: Path) -> None:
    (tmp_path / "two.yaml").write_text("spec: 2\ntransmitters: [{id: 1, ned: [8, -6, 0]}, {id: 2, ned: [-6, 9, 0]}]\n")
    plan = "strategies: flux\nscenarios: two.yaml\nnoise: off\nvictims: 2\ndrones: 2\narea_m: [-12, -12, 12, 12]\n"
    (planned,) = trials(parse_plan(plan, str(tmp_path / "plan.yaml")))
    one = row(planned, fly(planned.trial))
    assert (one.outcome, one.drones, one.hover_m) == ("found", 2, None)
    assert one.error_m == pytest.approx(0, abs=1.0)
    assert one.path_m > one.time_s  # of both


def test_who_watches_a_flight_changes_nothing_of_it() -> None:
    def flown(observers: list[Diary]) -> list[SearchStep]:
        steps: list[SearchStep] = []
        one = parse("transmitters: [{id: 1, ned: [12, 9, 0]}]\n", "one.yaml")
        loop = ClosedLoop(one, SearchPlan(STRATEGIES["flux"]), start=0.0, observers=observers, log=steps.append)
        run(loop.tasks, StepClock(), until=15.0)
        return steps

    diary = Diary()
    alone = flown([])
    assert len(alone) > 10
    assert alone == flown([diary])
    assert any(isinstance(event, StatusReport) for event in diary.events)
