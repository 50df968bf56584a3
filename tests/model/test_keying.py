"""Transmitters in time: pulses of any interval, classes of sets, what contradicts itself, who touches whom."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.model.field.keying import KEYING_CLASSES, Keying, PulseTimeline, draw_keying, outside_norm
from tests.every import every

MODERN = draw_keying(KEYING_CLASSES["modern"], 1, 1)


@given(st.lists(st.floats(-50, 500), min_size=2, max_size=8, unique=True), st.randoms())
def test_the_pulses_are_the_same_whatever_interval_is_asked_for_first(edges: list[float], random: object) -> None:
    edges.sort()
    stretches = list(pairwise(edges))
    random.shuffle(stretches)  # type: ignore[attr-defined]
    pieces = {t0: MODERN.pulses(t0, t1) for t0, t1 in stretches}
    whole = MODERN.pulses(edges[0], edges[-1])
    for n in range(4):
        joined = np.concatenate([pieces[t0][n] for t0 in sorted(pieces)])
        assert joined.tolist() == whole[n].tolist()


def test_pulses_come_at_the_period_with_the_jitter_asked_for() -> None:
    keying = Keying(1.1, 0.07, 0.4, jitter_s=2e-3, drift_ppm=100.0, seed=7)
    numbers, starts, ends, amplitudes = keying.pulses(0.0, 22_000.0)
    late = starts - (0.4 + numbers * 1.1 * (1 + 1e-4))
    assert len(numbers) == pytest.approx(20_000, abs=5)
    assert np.abs(late).max() <= 6 * 2e-3
    assert late.std() == pytest.approx(2e-3, rel=0.02)
    assert abs(late.mean()) < 5e-5
    assert abs(np.corrcoef(late[1:], late[:-1])[0, 1]) < 0.02
    assert (ends - starts).tolist() == pytest.approx([0.07] * len(starts))
    assert (amplitudes == 1).all()


@pytest.mark.parametrize("name", KEYING_CLASSES)
def test_sets_of_a_class_differ_as_the_class_says(name: str) -> None:
    kind = KEYING_CLASSES[name]
    sets = [draw_keying(kind, seed, 1) for seed in range(1000)]
    periods = np.array([one.period_s for one in sets])
    spread = kind.spread_s / math.sqrt(3) if kind.spread == "uniform" else kind.spread_s
    assert periods.mean() == pytest.approx(kind.period_s, abs=0.01)
    assert periods.std() == pytest.approx(spread, rel=0.1, abs=1e-12)
    assert max(abs(one.carrier_hz) for one in sets) <= kind.carrier_limit_hz
    assert {one.pulse_s for one in sets} == {kind.pulse_s}
    assert {one.leak_db for one in sets} == {kind.leak_db}
    assert np.mean([one.phase_s / one.period_s for one in sets]) == pytest.approx(0.5, abs=0.03)


def test_the_same_seed_and_id_are_the_same_set_and_others_another_one() -> None:
    kind = KEYING_CLASSES["analogue"]
    assert draw_keying(kind, 3, 4) == draw_keying(kind, 3, 4)
    assert len({draw_keying(kind, seed, id_).period_s for seed in range(5) for id_ in range(5)}) == 25


def test_an_old_set_in_the_cold_is_10_hz_lower_every_10_degrees() -> None:
    kind = replace(KEYING_CLASSES["analogue"], carrier_limit_hz=1000.0)
    warm, cold = (draw_keying(kind, 1, 1, celsius) for celsius in (20.0, -20.0))
    assert warm.carrier_hz - cold.carrier_hz == pytest.approx(40.0)


def test_it_sends_from_when_it_was_switched_on_or_went_back_to_sending() -> None:
    keying = replace(MODERN, from_s=100.0)
    assert not len(keying.pulses(-1000.0, 100.0).starts)
    assert keying.pulses(0.0, 110.0).starts.tolist() == MODERN.pulses(100.0, 110.0).starts.tolist()


def test_the_output_falls_by_3_db_below_a_fifth_of_the_battery() -> None:
    keying = replace(MODERN, battery=0.4, battery_life_s=1000.0)
    times, decibels = keying.pulses(0.0, 600.0).starts, 20 * np.log10(keying.pulses(0.0, 600.0).amplitudes)
    assert decibels[times < 200] == pytest.approx(0.0)
    assert decibels[times > 200] == pytest.approx(-3.0 * np.minimum(1, (times[times > 200] - 200) / 200))


@every(
    "wrong, words",
    [
        ({"period_s": 0.05}, "expected a period above the pulse"),
        ({"pulse_s": 0.0}, "expected a period above the pulse"),
        ({"jitter_s": 0.1}, "jitter_s 0.1: expected 0 or more, and below a twelfth of the pause"),
        ({"jitter_s": -1e-3}, "jitter_s"),
        ({"battery": 1.5}, "battery 1.5"),
        ({"battery_life_s": 0.0}, "battery_life_s 0"),
    ],
)
def test_timing_that_contradicts_itself_is_refused(wrong: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Keying(**wrong)  # type: ignore[arg-type]


def test_what_is_outside_the_norm_is_told_with_the_limit() -> None:
    assert not list(outside_norm(Keying(1.0, 0.07, carrier_hz=80.0), 2.24))
    strange = Keying(0.45, 0.06, carrier_hz=-100.0)
    assert list(outside_norm(strange, 3.0)) == [
        "period 0.45 s: the norm has 0.7…1.3 s",
        "pulse 0.06 s: the norm has at least 0.07 s",
        "pause 0.39 s: the norm has at least 0.4 s",
        "carrier -100 Hz: the norm has at most ±80 Hz",
        "strength 3: the norm has 0.5…2.24 µA/m at 10 m",
    ]


@given(st.integers(0, 1000), st.sampled_from(["modern", "analogue"]), st.integers(1, 6))
def test_a_timeline_has_every_pulse_once_in_time_with_all_that_touch_it(seed: int, name: str, n: int) -> None:
    keyings = [draw_keying(KEYING_CLASSES[name], seed, id_) for id_ in range(n)]
    timeline = PulseTimeline(keyings, 0.0)
    taken = []
    now = 0.0
    while now < 60.0:
        now = timeline.next_end(now, now + 1.0)
        taken += timeline.take(now)
    every = {
        (index, start): end
        for index, keying in enumerate(keyings)
        for start, end in zip(*keying.pulses(-1.0, now + 1.0)[1:3], strict=True)
    }
    assert [(one.pulse.sender, one.pulse.start_s) for one in taken] == sorted(
        (key for key, end in every.items() if 0.0 < end <= now), key=lambda key: every[key]
    )
    for one in taken:
        touching = {
            (index, start)
            for (index, start), end in every.items()
            if index != one.pulse.sender and start < one.pulse.end_s and end > one.pulse.start_s
        }
        assert {(other.sender, other.start_s) for other in one.touching} == touching


def test_after_a_stall_a_timeline_goes_on_with_the_pulses_of_then() -> None:
    timeline = PulseTimeline([MODERN], 0.0)
    timeline.next_end(0.0, 1.0)
    assert timeline.next_end(5000.0, 5002.0) == min(end for end in MODERN.pulses(4998, 5003).ends if end > 5000)
    assert timeline.next_end(5000.0, 5000.001) == 5000.001
