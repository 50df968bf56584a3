"""Trials: who flies them, how one is flown, and range tests."""

from __future__ import annotations

import gc
import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from arva_hil.campaign import runner
from arva_hil.campaign.plan import Planned, trials
from arva_hil.campaign.range_test.data_sheet import as_dict, lines, measured, table
from arva_hil.campaign.range_test.walk import COUPLINGS, RangePlan, alone, detection, signals, strip_width, walked
from arva_hil.campaign.results import TrialRow, row
from arva_hil.campaign.runner import Fly, MissingExtra, Unreachable, WorkerPool, cluster, processes
from arva_hil.campaign.trial import Result, fly
from arva_hil.clock import StepClock
from arva_hil.config import DEFAULT, Noise, Scenario, parse
from arva_hil.config.campaign import parse_plan
from arva_hil.emulator.build import transmitters
from arva_hil.events import StatusReport
from arva_hil.model.field import LocalFrame
from arva_hil.registry import STRATEGIES
from arva_hil.runtime.loop import run
from arva_hil.search.mission.outcome import SearchStep
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import STILL, Found, Observation, Position, Velocity
from arva_hil.simulated.closed_loop import ClosedLoop
from tests.one_receiver import Diary

from . import fakes
from .fakes import fake, planned

if TYPE_CHECKING:
    from distributed import LocalCluster, Scheduler

EVERY = planned()
EXPECTED = {one.key: fake(one.trial) for one in EVERY}


def flown(crew: WorkerPool, fly: Fly = fake, every: list[Planned] = EVERY) -> dict[str, Result]:
    pairs = [(one.key, result) for some in crew.fly(every, fly, stopped=lambda: False) for one, result in some]
    results = dict(pairs)
    assert len(results) == len(pairs)
    return results


def frozen(_: object) -> Result:
    return Result(str(gc.get_freeze_count() > 1000), None, None, 0.0, 0.0, 0)


def threads(_: object) -> Result:
    return Result(",".join(os.environ.get(name, "") for name in runner._ONE_THREAD), None, None, 0.0, 0.0, 0)


def test_processes_fly_every_trial_once_and_numpy_has_one_thread_in_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    with processes(2) as crew:
        assert crew.name == "processes: 2"
        assert flown(crew) == EXPECTED
        assert [result.outcome for result in flown(crew, frozen, EVERY[:1]).values()] == ["True"]  # what is imported
        assert [result.outcome for result in flown(crew, threads, EVERY[:1]).values()] == ["1,1,1"]
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "MKL_NUM_THREADS" not in os.environ


def test_a_trial_that_raises_has_that_for_an_outcome_and_the_others_go_on() -> None:
    with fakes.here(1) as crew:
        results = flown(crew, fakes.raising)
        exits = flown(crew, fakes.exiting, EVERY[:1])
    for one in EVERY:
        if one.trial.scenario.seed % 2:
            assert results[one.key] == Result("failed: ZeroDivisionError: by\nnothing", None, None, 0.0, 0.0, 0)
        else:
            assert results[one.key] == EXPECTED[one.key]
    assert [result.outcome for result in exits.values()] == ["failed: SystemExit: enough"]


def test_what_a_strategy_prints_goes_to_stderr(capfd: pytest.CaptureFixture[str]) -> None:
    with processes(1) as crew:
        assert len(flown(crew, fakes.failing)) == len(EVERY)
    out, err = capfd.readouterr()
    assert (out, err.count("here I am\n")) == ("", len(EVERY))


def test_it_stops_between_two_results_when_told_to() -> None:
    got: list[str] = []
    with fakes.here(1) as crew:
        for some in crew.fly(EVERY, fake, stopped=lambda: len(got) > 0):
            got.extend(one.key for one, _ in some)
    assert 0 < len(got) < len(EVERY)


def test_two_kernels_of_blas_give_the_same_rows() -> None:
    """Elsewhere than on x86 processors there is one kernel, and nothing differs."""
    code = """
from arva_hil.campaign.plan import trials
from arva_hil.campaign.results import row
from arva_hil.campaign.trial import fly
from arva_hil.config.campaign import parse_plan
text = "{spec: 1, strategies: [estimate], scenarios: [{random: {within_m: 15}}], seeds: [7]}"
for planned in trials(parse_plan(text, "plan")): print(row(planned, fly(planned.trial)))
"""
    without = "AVX2 AVX512_SKX X86_V3 X86_V4"  # names of older and of newer numpy
    kernels = {"OPENBLAS_CORETYPE": "Haswell"}, {"OPENBLAS_CORETYPE": "Nehalem", "NPY_DISABLE_CPU_FEATURES": without}
    running = [
        subprocess.Popen([sys.executable, "-c", code], env=os.environ | kernel, stdout=subprocess.PIPE, text=True)
        for kernel in kernels
    ]
    one, other = (process.communicate(timeout=120)[0] for process in running)
    assert one == other
    assert one.count("outcome='found'") == 1


# A cluster


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """A scheduler and two workers, all in this process, on the loopback interface."""
    with closing(local_cluster()) as local:
        yield local.scheduler_address


def local_cluster() -> LocalCluster:
    from distributed import LocalCluster  # here: it takes 0.3 s, in every worker that only collects this test

    return LocalCluster(
        n_workers=2, processes=False, threads_per_worker=1, host="tcp://127.0.0.1", dashboard_address="127.0.0.1:0"
    )


def test_a_cluster_flies_every_trial_once(scheduler: str) -> None:
    with cluster(scheduler, len(EVERY)) as crew:
        assert crew.name == "Dask workers: 2, threads: 2"
        assert flown(crew) == EXPECTED


def test_a_large_plan_goes_to_a_cluster_in_shards(scheduler: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "_AHEAD", 3)  # and no more at a time
    with cluster(scheduler, len(EVERY)) as crew:
        shards = list(crew.fly(EVERY, fakes.raising, stopped=lambda: False))
    assert crew.shard == len(EVERY) // 3 + 1
    assert max(map(len, shards)) == crew.shard
    assert sorted(one.key for some in shards for one, _ in some) == sorted(EXPECTED)
    raised = "failed: ZeroDivisionError"
    kept = {one.key: result for some in shards for one, result in some if not result.outcome.startswith(raised)}
    assert (kept, len(kept)) == ({key: EXPECTED[key] for key in kept}, len(EVERY) // 2)


def test_of_what_was_flown_the_scheduler_keeps_little(scheduler: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It logs its last 1000 messages to each worker with all that is in them."""
    from distributed import Client

    every = planned(fakes.PLAN.replace("seeds: 6", "seeds: 100"))
    monkeypatch.setattr(runner, "_AHEAD", 2)
    with Client(scheduler, set_as_default=False) as client:
        before = client.run_on_scheduler(kept)
        with cluster(scheduler, len(every)) as crew:
            assert crew.shard == 50
            assert len(flown(crew, every=every)) == 400
        assert client.run_on_scheduler(kept) - before < 8 * 5000  # 12 kB a shard as they are


def kept(dask_scheduler: Scheduler) -> int:
    """Bytes of the messages in the scheduler's logs of its workers."""
    return sum(len(pickle.dumps(list(comm.recent_message_log))) for comm in dask_scheduler.stream_comms.values())


def test_a_scheduler_that_goes_is_said() -> None:
    with closing(local_cluster()) as local, cluster(local.scheduler_address, 1) as crew:
        results = crew.fly(EVERY, fake, stopped=lambda: False)
        next(results)
        local.close()
        with pytest.raises(Unreachable, match=r"the scheduler at tcp://127\.0\.0\.1:\d+ is gone"):
            list(results)


def test_without_dask_it_is_said_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtra, match=r"pip install 'arva-hil\[dask\]'"), cluster("tcp://127.0.0.1:1", 1):
        pass


# -- a trial, flown --------------------------------------------------------------------------------------------


PLAN = "strategies: estimate\nscenarios: one.yaml\nnoise: off\nlimit_s: 300\n"


def trial_of(folder: Path, scenario: str, plan: str = PLAN) -> Planned:
    """The only trial of a plan whose scenario has this text."""
    (folder / "one.yaml").write_text(scenario)
    (one,) = trials(parse_plan(plan, str(folder / "plan.yaml")))
    return one


def row_of(folder: Path, scenario: str, plan: str = PLAN) -> TrialRow:
    planned = trial_of(folder, scenario, plan)
    return row(planned, fly(planned.trial))


def test_a_transmitter_on_a_path_is_found_where_it_is_at_the_end(tmp_path: Path) -> None:
    """It has stopped 4 m from where it was at first before anybody is near."""
    path = "{frame: ned, points: [[0, 6, 0, 0], [5, 10, 0, 0]]}"
    one = row_of(tmp_path, f"spec: 2\ntransmitters: [{{id: 1, path: {path}}}]\n")
    assert (one.outcome, one.distance_m) == ("found", 6.0)
    assert (one.error_m, one.hover_m) == (pytest.approx(0, abs=0.5), pytest.approx(0, abs=2.1))
    assert one.path_m > 10


def test_an_offset_of_the_position_is_an_error_on_earth_and_none_relative_to_the_vehicle(tmp_path: Path) -> None:
    text = "spec: 2\nnavigation_error: {bias_ned: [3, 0, 0]}\ntransmitters: [{id: 1, ned: [5, 5, 1]}]\n"
    one = row_of(tmp_path, text)
    assert (one.outcome, one.error_m) == ("found", pytest.approx(3, abs=0.3))
    assert (one.relative_m, one.hover_m) == (pytest.approx(0, abs=0.2), pytest.approx(0, abs=2.1))


def test_the_position_is_rounded_also_for_a_scenario_with_an_error_of_0(tmp_path: Path) -> None:
    """The true place of the vehicle is its own plus the error, not the place that its messages tell."""
    text = "spec: 2\ntransmitters: [{id: 1, ned: [5, 5, 1]}]\n"
    without, with_none = row_of(tmp_path, text), row_of(tmp_path, f"{text}navigation_error: {{}}\n")
    assert with_none.relative_m == pytest.approx(without.relative_m, abs=1e-6)
    assert with_none.hover_m == pytest.approx(without.hover_m, abs=1e-6)


def test_of_several_victims_the_uncertainty_is_that_of_the_place_with_the_largest_error(tmp_path: Path) -> None:
    two = "transmitters: [{id: 1, ned: [4, -3, 0]}, {id: 2, ned: [-3, 5, 0]}]\n"
    one = row_of(tmp_path, two, f"{PLAN}victims: 2\nspeed_m_s: 2\n")
    assert (one.outcome, one.error_m, one.sigma_m) == ("found", pytest.approx(0, abs=0.1), pytest.approx(2.1, abs=0.1))
    assert (one.relative_m, one.relative_sigma_m) == (None, None)  # the vehicle has left the first place


def test_a_search_for_all_that_misses_one_is_no_success(tmp_path: Path) -> None:
    """It received one of the two, and ends with found."""
    two = "transmitters: [{id: 1, ned: [8, -6, 0]}, {id: 2, ned: [400, 9, 0]}]\n"
    one = row_of(tmp_path, two, f"{PLAN}victims: all\narea_m: [-12, -12, 12, 12]\n")
    assert (one.outcome, one.success(2.0)) == ("1 of 2 found", False)


class FoundAtOnce:
    """Reports the place of each reading as found."""

    def __init__(self, speed: float) -> None:
        self.found: Found | None = None

    def observe(self, observation: Observation) -> None:
        self.found = Found(*observation.position[:2])

    def velocity(self, time_s: float, position: Position) -> Velocity:
        return STILL


def test_more_places_than_transmitters_have_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(STRATEGIES.loaded, "flux", FoundAtOnce)
    plan = "strategies: flux\nscenarios: one.yaml\nvictims: all\nlimit_s: 30\n"
    one = row_of(tmp_path, "transmitters: [{id: 1, ned: [12, 5, 0]}]\noutput: {format: text}\n", plan)
    assert (one.error_m, one.success(2.0)) == (None, False)


class Raising(FoundAtOnce):
    """Fails at the first reading."""

    def observe(self, observation: Observation) -> None:
        raise ZeroDivisionError


@pytest.mark.parametrize("drones", [1, 2])
def test_a_strategy_that_fails_is_the_outcome(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drones: int) -> None:
    monkeypatch.setitem(STRATEGIES.loaded, "flux", Raising)
    plan = f"strategies: flux\nscenarios: one.yaml\ndrones: {drones}\nlimit_s: 30\n"
    one = row_of(tmp_path, "transmitters: [{id: 1, ned: [12, 5, 0]}]\n", plan)
    assert (one.failed, one.outcome[:42]) == (True, "the strategy has failed: ZeroDivisionError")


def test_a_reading_is_used_in_the_step_of_its_own_instant(tmp_path: Path) -> None:
    """There is one a second, on the second: five steps a second, and none of them hears it later."""
    steps: list[SearchStep] = []
    fly(trial_of(tmp_path, "transmitters: [{id: 1, ned: [12, 9, 0]}]\n").trial, steps.append)
    heard = [step.time_s for step in steps if step.phase == "flying" and step.d_cm is not None]
    assert len(heard) > 5
    assert heard == pytest.approx([round(at) for at in heard], abs=1e-6)


def test_several_drones_find_one_transmitter_each_and_the_time_is_that_of_the_last(tmp_path: Path) -> None:
    two = "spec: 2\ntransmitters: [{id: 1, ned: [4, -3, 0]}, {id: 2, ned: [-3, 5, 0]}]\n"
    two += "receiver: {mount: {position: [3, 0, 0]}}\n"
    plan = f"{PLAN}victims: 2\ndrones: 2\narea_m: [-6, -6, 6, 6]\n"
    one = row_of(tmp_path, two, plan)
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


# -- range tests: receivers are heard from as far as the field says, and testers' rules are kept ---------------


COAXIAL, TURNED, VERTICAL = COUPLINGS
FLAT = RangePlan(height_m=0.0, walks=1)


def quiet(**keys: Any) -> Scenario:
    """The paper's receiver with equal antennas, without noise, ten times a second."""
    receiver = replace(DEFAULT.receiver, rate_hz=10.0, sensitivity=(1.0, 1.0, 1.0), noise=Noise("off"))
    return replace(DEFAULT, receiver=receiver, **keys)


def pulsed(profile: str) -> Scenario:
    text = "spec: 2\ntransmitters: [{id: 1, enu: [0, 0, 0]}]\nreceiver: {profile: 'builtin:%s'}\n"
    return parse(text % profile, profile)


@pytest.mark.parametrize(("strength", "metres"), [(0.5, 43.3), (1.0, 54.5), (2.24, 71.3)])
def test_on_the_axis_a_receiver_of_50_m_hears_as_far_as_the_field_says(strength: float, metres: float) -> None:
    transmitter = replace(DEFAULT.transmitters[0], strength=strength)
    walk = walked(quiet(transmitters=(transmitter,)), COAXIAL, FLAT, 0, motors=False)
    assert (walk.stable_m, walk.first_m) == (pytest.approx(metres, abs=0.15), walk.stable_m)


def test_a_receiver_with_equal_antennas_hears_as_far_when_it_is_turned() -> None:
    assert walked(quiet(), TURNED, FLAT, 0, motors=False).stable_m == pytest.approx(54.5, abs=0.15)


def test_an_upright_dipole_is_not_heard_in_its_own_plane_and_is_from_above() -> None:
    assert walked(quiet(), VERTICAL, FLAT, 0, motors=False).stable_m is None
    walk = walked(quiet(), VERTICAL, RangePlan(height_m=3.0), 0, motors=False)
    assert walk.stable_m is not None
    along, r = np.sqrt(walk.stable_m**2 - 9), walk.stable_m
    field = 3 * 3.0 * along / r**2 / (4 * np.pi * r**3)  # horizontal part of an upright dipole's field
    assert np.cbrt(1.542 / (4 * np.pi * field)) == pytest.approx(50, abs=0.3)


@pytest.mark.parametrize(
    ("heard", "first", "stable"),
    [
        ("......", None, None),
        (".x....", 9, None),
        (".x.xxx", 9, 7),
        (".x..xx", 9, None),
        ("xxxxxx", 10, 10),
        ("xxx.xxx", 10, 10),
        ("xx.xxx", 10, 7),
    ],
)
def test_a_signal_is_stable_from_the_frame_after_which_there_is_no_gap(
    heard: str, first: float | None, stable: float | None
) -> None:
    ranges = np.arange(10.0, 10.0 - len(heard), -1)
    d = np.array([1.0 if one == "x" else np.nan for one in heard])
    assert signals(ranges, d, 2.0) == (first, stable)


def test_who_hears_from_the_start_on_begins_farther_away() -> None:
    walk = walked(quiet(), COAXIAL, RangePlan(height_m=0.0, start_m=20.0), 0, motors=False)
    assert (walk.stable_m, walk.range_m[0]) == (pytest.approx(54.5, abs=0.15), 80.0)
    near = walked(quiet(), COAXIAL, RangePlan(height_m=0.0, start_m=20.0, farthest_m=40.0), 0, motors=False)
    assert near.stable_m == 40.0  # and no farther than that


@pytest.mark.parametrize("profile", ["three_antennas", "one_antenna", "strength_only", "unequal_antennas", "deafened"])
def test_every_model_has_a_data_sheet(profile: str) -> None:
    scenario = pulsed(profile)
    sheet = measured(scenario, RangePlan(walks=3))
    motors = scenario.receiver.vehicle_noise is not None
    assert len(sheet.rows) == 3 * (1 + motors)
    coaxial = sheet.row("coaxial")
    expected = 35.7 if profile == "deafened" else 71.3  # 8 times the threshold, half the range
    assert coaxial.mean_m == pytest.approx(expected, rel=0.08)
    said = "\n".join(lines(sheet))
    assert f"model {scenario.receiver.model}, 1 Hz" in said
    assert ("motors on" in said) == motors
    if profile == "one_antenna":
        assert "turned by 90°: not every walk had a stable signal" in said


def test_single_signals_from_far_away_do_not_count() -> None:
    row = measured(pulsed("three_antennas"), RangePlan(walks=10)).row("coaxial")
    assert max(row.first_m) > max(row.stable_m) + 5


def test_the_sheet_says_what_testers_ask_and_its_numbers_are_those_of_the_walks() -> None:
    sheet = measured(quiet(), RangePlan(height_m=0.0, walks=2, passes=2))
    *_, coaxial, turned, strip, heard = lines(sheet)
    assert coaxial == "coaxial 54.5 m: enough (testers want 30 m or more)"
    assert turned == "turned by 90° 100% of that: enough (testers want 50% or more)"
    assert strip == "search strips of 69 m: 1.26 × (coaxial mean − 2 s.d.)"
    assert heard.startswith("flights along strips that receive it, at random places and attitudes: 100.0% at 69 m")
    rows = list(table([sheet]))
    assert rows[0] == ("receiver", "coupling", "motors", "walk", "first_m", "stable_m")
    assert len(rows) == 1 + 3 * 2
    couplings = {one["coupling"]: one for one in as_dict(sheet)["couplings"]}
    assert couplings["coaxial"]["stable_m"] == [row[5] for row in rows[1:3]]
    assert couplings["vertical"]["mean_m"] is None


def test_the_same_seed_gives_the_same_sheet_and_another_another() -> None:
    plan = RangePlan(walks=3)
    first, again = (as_dict(measured(DEFAULT, plan)) for _ in range(2))
    assert first == again
    assert as_dict(measured(replace(DEFAULT, seed=99), plan))["couplings"] != first["couplings"]


@pytest.mark.parametrize(("profile", "metres"), [("two_antennas", 47.4), ("deafened", 29.6)])
def test_strips_as_wide_as_the_formula_has_them_miss_one_in_a_hundred(profile: str, metres: float) -> None:
    width = strip_width(pulsed(profile), 3.0, 1.0)
    assert width.metres == pytest.approx(metres, abs=0.5)
    assert width.detection >= 0.985


def test_wider_strips_miss_more_and_what_hears_nothing_has_none() -> None:
    chosen = pulsed("two_antennas")
    shares = [detection(chosen, RangePlan(passes=20), width) for width in (60.0, 140.0, 220.0)]
    assert shares == sorted(shares, reverse=True)
    assert shares[0] > 0.97
    assert shares[2] < 0.7
    deaf = replace(chosen, receiver=replace(chosen.receiver, options={"threshold_na_m": 1e9}))
    assert strip_width(deaf, 3.0, 1.0) is None


def test_a_transmitter_with_a_depth_lies_at_the_origin_as_every_other() -> None:
    deep = replace(DEFAULT, transmitters=(replace(DEFAULT.transmitters[0], depth_m=5.0),))
    at = transmitters(alone(deep, (0.0, 0.0, 0.0), 0), LocalFrame(0.0, 0.0, 0.0)).positions
    assert at.tolist() == [[0.0, 0.0, 0.0]]
