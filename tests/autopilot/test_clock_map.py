"""The autopilot's clock seen through a link that delays."""

from __future__ import annotations

import random
from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.autopilot.following.navigation import ClockMap

WINDOW_S = 1.0
TINY = 1e-9


def test_before_the_first_sample_nothing_is_known() -> None:
    assert ClockMap().boot(12.0) is None


def test_it_counts_on_between_samples() -> None:
    clock = ClockMap()
    clock.add(100.0, 7.0)
    assert clock.boot(100.0) == 7.0
    assert clock.boot(103.5) == 10.5
    assert clock.boot(99.0) == 6.0


@given(
    st.lists(st.tuples(st.floats(0.001, 0.4), st.floats(0, 0.6)), min_size=1, max_size=60),
    st.floats(-1000, 1000),
)
def test_never_ahead_of_the_vehicle_and_late_by_the_least_delay(
    samples: list[tuple[float, float]], offset: float
) -> None:
    """Any delays, which may put samples out of order too; the vehicle's clock keeps the host's time."""
    sent = list(accumulate(gap for gap, _ in samples))
    arrivals = sorted((t + delay, t, delay) for t, (_, delay) in zip(sent, samples, strict=True))
    clock = ClockMap()
    for i, (now, stamp, _) in enumerate(arrivals):
        clock.add(now, stamp - offset)
        estimate = clock.boot(now)
        assert estimate is not None
        late = now - offset - estimate
        least = min(delay for at, _, delay in arrivals[: i + 1] if at >= now - WINDOW_S)
        assert -TINY <= late <= least + TINY


@pytest.mark.parametrize(("rate", "earliest", "latest"), [(0.985, -0.0155, 0.0), (1.015, 0.0, 0.0155)])
def test_a_clock_that_runs_wrong_is_followed(rate: float, earliest: float, latest: float) -> None:
    """1.5 % slow was measured: 15 ms in the second that is remembered."""
    numbers = random.Random(1)
    clock = ClockMap()
    delays: list[tuple[float, float]] = []
    for i in range(3000):
        sent = 0.02 * i
        delay = numbers.uniform(0.001, 0.02)
        now = sent + delay
        delays.append((now, delay))
        clock.add(now, rate * sent)
        estimate = clock.boot(now)
        assert estimate is not None
        least = min(d for at, d in delays[-60:] if at >= now - WINDOW_S)
        late = rate * now - estimate
        assert earliest <= late <= least * 1.02 + latest


def steady(clock: ClockMap, start: float, end: float, offset: float) -> None:
    """50 Hz with 5 ms of delay."""
    for i in range(round((end - start) * 50)):
        sent = start + 0.02 * i
        clock.add(sent + 0.005, sent - offset)


def test_a_clock_that_jumped_ahead_is_believed_at_once() -> None:
    clock = ClockMap()
    steady(clock, 0, 5, 0.0)
    clock.add(5.005, 5.15)
    assert clock.boot(5.005) == pytest.approx(5.15)


@pytest.mark.parametrize(
    ("again_s", "soon_s", "late_s", "behind_s"),
    [(5.0, 5.9, 6.1, 0.15), (6.5, 7.0, 7.6, 1.5)],
    ids=["it fell behind", "the simulator stood still"],
)
def test_a_clock_that_fell_behind_is_believed_after_the_window(
    again_s: float, soon_s: float, late_s: float, behind_s: float
) -> None:
    clock = ClockMap()
    steady(clock, 0, 5, 0.0)
    steady(clock, again_s, soon_s, behind_s)
    assert clock.boot(soon_s) == pytest.approx(soon_s - 0.005)  # it may still be a delay
    steady(clock, soon_s, late_s, behind_s)
    assert clock.boot(late_s) == pytest.approx(late_s - behind_s - 0.005)


def test_a_burst_behind_a_stall_does_not_pass_for_fresh() -> None:
    """A link that held everything up for 1.5 s, and then delivers it at once."""
    clock = ClockMap()
    steady(clock, 0, 5, 0.0)
    for i in range(75):
        clock.add(6.5 + 0.001 * i, 5.0 + 0.02 * i)
        assert clock.boot(6.5 + 0.001 * i) == pytest.approx(6.495 + 0.001 * i)


@pytest.mark.parametrize(("speed", "rate"), [(0.5, 1.0), (1.0, 1.0), (1.5, 1.5), (19.0, 19.0), (30.0, 20.0)])
def test_the_rate_is_that_of_a_simulator_faster_than_real_time(speed: float, rate: float) -> None:
    clock = ClockMap()
    assert clock.rate == 1.0
    for i in range(0, 201, 2):
        clock.add(100 + 0.01 * i, 7 + speed * 0.01 * i)
        assert clock.rate == 1.0  # 2 s are too short for measuring it
    for i in range(202, 301, 2):
        clock.add(100 + 0.01 * i, 7 + speed * 0.01 * i)
        assert clock.rate == pytest.approx(rate)


def test_silence_does_not_keep_an_old_estimate() -> None:
    clock = ClockMap()
    clock.add(0.0, 0.0)
    clock.add(30.0, 29.5)
    assert clock.boot(30.0) == 29.5
