"""Range tests: receivers are heard from as far as the field says, and testers' rules are kept."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from arva_hil.campaign.range_test.data_sheet import as_dict, lines, measured, table
from arva_hil.campaign.range_test.walk import COUPLINGS, RangePlan, alone, detection, signals, strip_width, walked
from arva_hil.config import DEFAULT, Noise, Scenario, parse
from arva_hil.emulator.build import transmitters
from arva_hil.model.field import LocalFrame

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
    assert walk.stable_m == pytest.approx(metres, abs=0.15)
    assert walk.first_m == walk.stable_m


def test_a_receiver_with_equal_antennas_hears_as_far_when_it_is_turned() -> None:
    assert walked(quiet(), TURNED, FLAT, 0, motors=False).stable_m == pytest.approx(54.5, abs=0.15)


def test_an_upright_dipole_is_not_heard_in_its_own_plane_and_is_from_above() -> None:
    assert walked(quiet(), VERTICAL, FLAT, 0, motors=False).stable_m is None
    plan = RangePlan(height_m=3.0)
    walk = walked(quiet(), VERTICAL, plan, 0, motors=False)
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
    assert walk.stable_m == pytest.approx(54.5, abs=0.15)
    assert walk.range_m[0] == 80.0
    near = walked(quiet(), COAXIAL, RangePlan(height_m=0.0, start_m=20.0, farthest_m=40.0), 0, motors=False)
    assert near.stable_m == 40.0  # and no farther than that


@pytest.mark.parametrize("profile", ["three_antennas", "one_antenna", "strength_only", "estimator", "deafened"])
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
    sheet = measured(pulsed("three_antennas"), RangePlan(walks=10))
    row = sheet.row("coaxial")
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
    assert width is not None
    assert width.metres == pytest.approx(metres, abs=0.5)
    assert width.detection >= 0.985


def test_wider_strips_miss_more_and_what_hears_nothing_has_none() -> None:
    chosen = pulsed("two_antennas")
    shares = [detection(chosen, RangePlan(passes=40), width) for width in (60.0, 140.0, 220.0)]
    assert shares == sorted(shares, reverse=True)
    assert shares[0] > 0.97
    assert shares[2] < 0.7
    deaf = replace(chosen, receiver=replace(chosen.receiver, options={"threshold_na_m": 1e9}))
    assert strip_width(deaf, 3.0, 1.0) is None


def test_a_transmitter_with_a_depth_lies_at_the_origin_as_every_other() -> None:
    deep = replace(DEFAULT, transmitters=(replace(DEFAULT.transmitters[0], depth_m=5.0),))
    at = transmitters(alone(deep, (0.0, 0.0, 0.0), 0), LocalFrame(0.0, 0.0, 0.0)).positions
    assert at.tolist() == [[0.0, 0.0, 0.0]]
