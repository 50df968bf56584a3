"""The plan: what is read, what is refused and where, and which trials it stands for."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import islice
from pathlib import Path

import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.campaign.plan import draw, size, trials, wind
from arva_hil.config import Scenario, ScenarioError, load
from arva_hil.config.campaign import CampaignPlan, Random, load_plan, parse_plan
from arva_hil.model.field import rotation
from tests.every import every

from .fakes import planned

CONFIGS = Path(__file__).parent.parent.parent / "configs"
MINIMAL = "strategies: flux\nscenarios: {random: {within_m: 50}}\n"  # what is appended starts at line 3


def mistakes(text: str, source: str = "p.yaml") -> list[str]:
    with pytest.raises(ScenarioError) as caught:
        parse_plan(text, source)
    return str(caught.value).split("\n")


# What is read


def test_a_full_plan_is_read_as_written() -> None:
    text = """
spec: 1
strategies: [flux, estimate]
scenarios: [../paper_case_1.yaml, {random: {within_m: 30, depth_m: [0.5, 1.5]}}]
seeds: [7, 3]
noise: [gaussian, off]
wind_m_s: [0, 3]
gps_noise_m: 0.5
take_off_m: [1, 2]
height_m: {estimate: 2}
speed_m_s: 1.5
limit_s: {flux: 60, estimate: 120}
victims: all
drones: [1, 2]
area_m: [-80, -70, 60, 50]
strip_width_m: 30
success_m: 3
"""
    assert parse_plan(text, str(CONFIGS / "campaigns" / "p.yaml")) == CampaignPlan(
        strategies=("flux", "estimate"),
        scenarios={
            "paper_case_1": load(CONFIGS / "paper_case_1.yaml"),
            "random within 30 m at 0.5 to 1.5 m": Random(30.0, (0.5, 1.5)),
        },
        seeds=(7, 3),
        noise=("gaussian", "off"),
        wind_m_s=(0.0, 3.0),
        gps_noise_m=(0.5,),
        take_off_m=(1.0, 2.0),
        height_m={"flux": 3.0, "estimate": 2.0},
        speed_m_s={"flux": 1.5, "estimate": 1.5},
        limit_s={"flux": 60.0, "estimate": 120.0},
        victims=None,
        drones=(1, 2),
        area_m=(-80.0, -70.0, 60.0, 50.0),
        strip_width_m=30.0,
        success_m=3.0,
    )


def test_a_short_plan_has_the_defaults_of_a_trial() -> None:
    plan = parse_plan(MINIMAL, "p.yaml")
    assert (list(plan.seeds), plan.noise, plan.take_off_m, plan.success_m) == ([1], (None,), (3.0,), 2.0)
    (one,) = trials(plan)
    assert replace(one.trial, scenario=Scenario(())) == type(one.trial)("flux", Scenario(()))


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("paper", 4 * 25 * 4 * 3),
        ("random", 500 * 3),
        ("one_victim", 200),
        ("gps_drift", 400),
        ("two_victims", 200),
        ("four_victims", 200),
        ("four_published", 3 * 200),
        ("drones", 4 * 35 * 3),
        ("pila", 200),
    ],
)
def test_the_plans_that_come_with_it(name: str, count: int) -> None:
    path = CONFIGS / "campaigns" / f"{name}.yaml"
    plan = load_plan(path)
    assert size(plan) == count
    assert len({one.key for one in islice(trials(plan), 50)}) == min(count, 50)
    assert path.read_text().startswith("# ")


# What is refused


@every(
    "text, expected",
    [
        ("", ["1:1: an empty file, expected a mapping with strategies and scenarios"]),
        ("- 1", ["1:1: a list of 1, expected a mapping with spec, strategies, scenarios, seeds, noise, "]),
        ("seeds: 3", ["1:1: no strategies, expected ", "1:1: no scenarios, expected "]),
        (MINIMAL + "spec: 2", ["3:7: spec 2 is newer than this program reads (1): upgrade arva-hil, expected spec 1"]),
        (MINIMAL + "sedes: 5", ["3:1: unknown key 'sedes', expected one of spec, strategies, "]),
        (MINIMAL + "seeds: 0", ["3:8: seeds: '0', expected a list of seeds, or how many, from 1 to 100000"]),
        (MINIMAL + "seeds: [1, 2.5]", ["3:12: seeds: '2.5', expected a whole number from 0 to 9223372036854775807"]),
        (MINIMAL + "seeds: [1, 2, 1]", ["3:15: 1 again (first on line 3), expected each once"]),
        (MINIMAL + "seeds: []", ["3:8: seeds: a list of 0, expected a list of 1 to 100000 seeds"]),
        (MINIMAL + "wind_m_s: [0, -1]", ["3:15: wind_m_s: '-1', expected a number from 0 to 100"]),
        (MINIMAL + "wind_m_s: strong", ["3:11: wind_m_s: 'strong', expected a number from 0 to 100"]),
        (MINIMAL + "take_off_m: 0", ["3:13: take_off_m: '0', expected a number above 0, at most 1000"]),
        (MINIMAL + "take_off_m: [1, 1.0]", ["3:17: 1.0 again (first on line 3), expected each once"]),
        (
            MINIMAL + "noise: [off, unifrom]",
            ["3:14: noise: 'unifrom', expected one of uniform, gaussian, off, did you "],
        ),
        (MINIMAL + "height_m: {estimate: 2}", ["3:12: unknown key 'estimate', expected flux"]),
        (MINIMAL + "speed_m_s: {flux: fast}", ["3:19: flux: 'fast', expected a number above 0, at most 100"]),
        (MINIMAL + "limit_s: [1]", ["3:10: limit_s: a list of 1, expected a number above 0, at most 86400"]),
        (MINIMAL + "victims: 0", ["3:10: victims: '0', expected a whole number 1…16, or all"]),
        (MINIMAL + "victims: every", ["3:10: victims: 'every', expected a whole number 1…16, or all"]),
        (MINIMAL + "victims: 2", ["3:10: victims: 2, expected at most 1, the transmitters of random within 50 m"]),
        (MINIMAL + "drones: [2, 65]", ["3:13: drones: '65', expected a whole number from 1 to 64"]),
        (MINIMAL + "area_m: [0, 0, -1, 5]", ["3:9: area_m: [0, 0, -1, 5], expected south, west, north, east"]),
        (MINIMAL + "success_m: .nan", ["3:12: success_m: '.nan', expected a number above 0, at most 1000"]),
        (
            "strategies: [flx]\nscenarios: {random: {within_m: 5}}",
            ["1:14: strategies: 'flx', expected one of flux, extremum, estimate, did you mean 'flux'?"],
        ),
        ("strategies: flux\nscenarios: []", ["2:12: scenarios: a list of 0, expected a list of 1 to 100000 scenarios"]),
        (
            "strategies: flux\nscenarios: [[a]]",
            ["2:13: scenarios: a list of 1, expected a scenario file or {random: …}"],
        ),
        ("strategies: flux\nscenarios: {}", ["2:12: no random, expected a mapping with random"]),
        (
            "strategies: flux\nscenarios: {random: {}}",
            ["2:21: no within_m or area_m, expected a mapping with exactly one of within_m, area_m"],
        ),
        ("strategies: flux\nscenarios: {random: 5}", ["2:21: random: '5', expected a mapping with within_m, depth_m"]),
        (
            "strategies: flux\nscenarios: {random: {within_m: 0, depth_m: [2, 1]}}",
            ["2:32: within_m: '0', expected a number above 0", "2:44: depth_m: [2, 1], expected the smaller one first"],
        ),
        (
            "strategies: flux\nscenarios: {random: {within_m: 5, depth_m: 1}}",
            ["2:44: depth_m: '1', expected a list of 2 numbers"],
        ),
        (
            MINIMAL + "seeds: 10000000\nwind_m_s: [1, 2, 3]\ntake_off_m: [1, 2, 3, 4]",
            ["1:1: 120000000 trials, expected at most 100000000"],
        ),
        (MINIMAL + "seeds: !!int 5", ["3:8: the tag '!!int', expected a value without a tag"]),
    ],
)
def test_every_mistake_is_named_at_its_place(text: str, expected: list[str]) -> None:
    found = mistakes(text)
    assert len(found) == len(expected)
    for line, start in zip(found, expected, strict=True):
        assert line.startswith(f"p.yaml:{start}")


def test_a_scenario_that_is_not_there_is_named() -> None:
    source = str(CONFIGS / "campaigns" / "p.yaml")
    (line,) = mistakes("strategies: flux\nscenarios: [../paper_case1.yaml]", source)
    assert line.startswith(f"{source}:2:13: no file {CONFIGS}/campaigns/../paper_case1.yaml, ")


def test_two_scenarios_of_one_name_are_refused() -> None:
    source = str(CONFIGS / "campaigns" / "p.yaml")
    (line,) = mistakes("strategies: flux\nscenarios:\n- ../default.yaml\n- ../../configs/default.yaml", source)
    assert line == f"{source}:4:3: default again (first on line 3), expected each once"


def test_mistakes_in_a_scenario_file_are_shown_with_those_of_the_plan(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("transmitters: []\nsed: 5\n")
    found = mistakes("strategies: flux\nscenarios: a.yaml\nseeds: none\n", str(tmp_path / "p.yaml"))
    places = [line.removeprefix(f"{tmp_path}/").split(": ")[0] for line in found]
    assert places == ["a.yaml:1:15", "a.yaml:2:1", "p.yaml:3:8"]


PATH = "path: {frame: ned, points: [[0, 20, 5, 0], [60, 26, 5, 0]]}"


@pytest.mark.parametrize(
    "part",
    [
        "pose: truth\ntransmitters: [{id: 1, ned: [5, 5, 0]}]",
        "navigation_error: {heading_deg: 3}\ntransmitters: [{id: 1, ned: [5, 5, 0]}]",
        f"transmitters: [{{id: 1, {PATH}}}]",
    ],
)
def test_a_scenario_of_spec_2_is_flown_where_one_vehicle_can(tmp_path: Path, part: str) -> None:
    (tmp_path / "newer.yaml").write_text(f"spec: 2\n{part}\n")
    plan = parse_plan("strategies: flux\nscenarios: newer.yaml\n", str(tmp_path / "p.yaml"))
    assert list(plan.scenarios) == ["newer"]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("transmitters: [{id: 1, follows: {system: 2}}]", "follows"),
        ("output: {format: tunnel}\ntransmitters: [{id: 1, ned: [5, 5, 0]}]", "format tunnel"),
        (
            "transmitters: [{id: 1, ned: [5, 5, 0]}]\n"
            "vehicles: [{name: a, system: 1, receivers: [{name: r, port: pty}]}]",
            "vehicles",
        ),
    ],
)
def test_a_scenario_that_no_campaign_flies_is_refused_with_what_is_in_the_way(
    tmp_path: Path, text: str, what: str
) -> None:
    (tmp_path / "newer.yaml").write_text(f"spec: 2\n{text}\n")
    (line,) = mistakes("strategies: flux\nscenarios: newer.yaml\n", str(tmp_path / "p.yaml"))
    expected = f"{tmp_path}/newer.yaml with {what}, expected a scenario that a campaign flies"
    assert line == f"{tmp_path}/p.yaml:2:12: {expected}"


def test_one_error_of_the_position_is_flown_and_not_two(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(
        "spec: 2\nnavigation_error: {bias_ned: [3, 0, 0]}\ntransmitters: [{id: 1, ned: [5, 5, 0]}]\n"
    )
    (line,) = mistakes("strategies: flux\nscenarios: s.yaml\ngps_noise_m: [0, 1]\n", str(tmp_path / "p.yaml"))
    expected = "gps_noise_m: 1 with the navigation_error of s, expected 0: the scenario has the error"
    assert line == f"{tmp_path}/p.yaml:3:14: {expected}"
    two = mistakes("strategies: flux\nscenarios: s.yaml\ngps_noise_m: [x, 1]\n", str(tmp_path / "p.yaml"))
    wrong = "gps_noise_m: 'x', expected a number from 0 to 1000"
    assert two == [f"{tmp_path}/p.yaml:3:14: {expected}", f"{tmp_path}/p.yaml:3:15: {wrong}"]


def test_several_drones_need_frames_with_ids(tmp_path: Path) -> None:
    two = "[{id: 1, ned: [5, 5, 0]}, {id: 2, ned: [-5, 5, 0]}]"
    (tmp_path / "s.yaml").write_text(f"spec: 2\noutput: {{format: text}}\ntransmitters: {two}\n")
    text = "strategies: flux\nscenarios: s.yaml\nvictims: 2\ndrones: [1, 2]\n"
    (line,) = mistakes(text, str(tmp_path / "p.yaml"))
    expected = "drones: 2 with frames of s in the format text, expected 1: several need frames with ids"
    assert line == f"{tmp_path}/p.yaml:4:9: {expected}"


def test_a_plan_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    for path, why in [(tmp_path / "none.yaml", "No such file"), (tmp_path, "Is a directory")]:
        with pytest.raises(ScenarioError, match=rf"{path}:1:1: {why}.*, expected the plan of a campaign"):
            load_plan(path)
    (tmp_path / "latin.yaml").write_bytes(b"# \xe9t\xe9\n")
    with pytest.raises(ScenarioError, match="1:3: the byte 0xe9, expected UTF-8"):
        load_plan(tmp_path / "latin.yaml")
    (tmp_path / "long.yaml").write_bytes(b"#" * (1 << 20) + b"\n")
    with pytest.raises(ScenarioError, match="1:1: more than 1 MiB"):
        load_plan(tmp_path / "long.yaml")


# Which trials


def test_all_is_crossed_seed_by_seed_and_strategies_side_by_side() -> None:
    every = planned("strategies: [flux, estimate]\nscenarios: {random: {within_m: 9}}\nseeds: 2\ntake_off_m: [1, 2]\n")
    order = [(one.trial.scenario.seed, one.trial.take_off_m, one.trial.strategy) for one in every]
    assert order == [(s, h, name) for s in (1, 2) for h in (1.0, 2.0) for name in ("flux", "estimate")]


def test_strategies_meet_the_same_transmitter_noise_and_wind() -> None:
    every = planned(
        "strategies: [flux, extremum, estimate]\nscenarios: {random: {within_m: 50}}\n"
        "seeds: 3\nwind_m_s: [2, 4]\nheight_m: {flux: 4}\n"
    )
    for at in range(0, len(every), 3):
        flux, *others = (one.trial for one in every[at : at + 3])
        for other in others:
            assert other == replace(flux, strategy=other.strategy, height_m=other.height_m)
    assert len({one.trial.scenario.transmitters for one in every}) == 3


def test_a_seed_draws_the_same_whatever_else_is_planned() -> None:
    one = planned(MINIMAL + "seeds: [42]")[0]
    other = planned(MINIMAL.replace("flux", "[estimate, flux]") + "seeds: 50\nwind_m_s: [5, 0]")
    same = [two for two in other if two.key == one.key]
    assert [two.trial for two in same] == [one.trial]


@pytest.mark.parametrize(
    "more",
    [
        "seeds: [2]",
        "noise: off",
        "wind_m_s: 1",
        "gps_noise_m: 1",
        "take_off_m: 2",
        "height_m: 2",
        "limit_s: 5",
        "victims: all",
    ],
)
def test_whatever_changes_a_trial_changes_its_key(more: str) -> None:
    assert planned(MINIMAL)[0].key != planned(MINIMAL + more)[0].key


def test_a_key_is_of_the_content_of_the_scenario(tmp_path: Path) -> None:
    plan = "strategies: flux\nscenarios: a.yaml\n"
    keys = []
    for text in ("{id: 1, ned: [1, 2, 0]}", "{id: 1, enu: [2, 1, 0]} # the same", "{id: 1, ned: [1, 2, 0.5]}"):
        (tmp_path / "a.yaml").write_text(f"transmitters:\n- {text}\n")
        keys += [one.key for one in trials(parse_plan(plan, str(tmp_path / "p.yaml")))]
    assert keys[0] == keys[1] != keys[2]


def test_noise_is_the_scenarios_own_unless_the_plan_has_some(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("transmitters: [{id: 1, ned: [1, 2, 0]}]\nreceiver: {noise: {kind: gaussian}}\n")
    plan = "strategies: flux\nscenarios: a.yaml\n"
    for more, kinds in [("", ["gaussian"]), ("noise: [off, uniform]", ["off", "uniform"])]:
        every = trials(parse_plan(plan + more, str(tmp_path / "p.yaml")))
        assert [one.trial.scenario.receiver.noise.kind for one in every] == kinds


def test_several_are_drawn_each_of_its_own() -> None:
    scenario = draw(Random(area_m=(0.0, 10.0, 5.0, 30.0), count=3, model="pulsed", keying="modern"), 7)
    assert [transmitter.id for transmitter in scenario.transmitters] == [1, 2, 3]
    places = [transmitter.ned for transmitter in scenario.transmitters]
    assert len(set(places)) == 3
    assert all(place and 0 <= place[0] <= 5 and 10 <= place[1] <= 30 for place in places)
    assert scenario.receiver.model == "pulsed"
    assert {transmitter.keying and transmitter.keying.kind for transmitter in scenario.transmitters} == {"modern"}


@given(st.integers(0, 2**63 - 1), st.floats(0.1, 100), st.floats(-2, 2), st.floats(0, 5))
def test_a_transmitter_is_drawn_inside_its_box(seed: int, within: float, low: float, more: float) -> None:
    kind = Random(within, (low, low + more))
    (transmitter,) = draw(kind, seed).transmitters
    north, east, down = transmitter.ned
    assert max(abs(north), abs(east)) <= within + 0.0005
    assert low - 0.0005 <= down <= low + more + 0.0005
    assert draw(kind, seed) == draw(kind, seed)


def test_transmitters_are_drawn_uniformly() -> None:
    drawn = [draw(Random(50.0, (0.0, 2.0)), seed).transmitters[0] for seed in range(1, 501)]
    places = [t.ned for t in drawn if t.ned]
    matrices = rotation.to_matrix(
        rotation.from_euler(*[[math.radians(t.attitude[n]) for t in drawn] for n in range(3)])
    )
    for axis, (low, width) in enumerate([(-50, 100), (-50, 100), (0, 2)]):
        assert scipy.stats.kstest([place[axis] for place in places], "uniform", (low, width)).pvalue > 0.01
    for entry in matrices.reshape(-1, 9).T:  # every entry of a random rotation is uniform: Archimedes' hat-box theorem
        assert scipy.stats.kstest(entry, "uniform", (-1, 2)).pvalue > 0.01


def test_the_wind_comes_from_anywhere_at_its_speed() -> None:
    drawn = [wind(3.0, seed) for seed in range(1, 1001)]
    assert {down for _, _, down in drawn} == {0.0}
    assert {round(math.hypot(north, east), 5) for north, east, _ in drawn} == {3.0}
    bearings = [math.atan2(east, north) for north, east, _ in drawn]
    assert scipy.stats.kstest(bearings, "uniform", (-math.pi, 2 * math.pi)).pvalue > 0.01
    assert str(wind(0.0, 7)) == "(0.0, 0.0, 0.0)"
