"""The check of set-points against the motion reported, on motions made up."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable

import pytest

from arva_hil.search.flight.airborne import Deviation, SetPointCheck

STEP_S = 0.2


def first(
    flown: Callable[[float, complex], complex],
    *,
    order: Callable[[float], complex] = lambda t: 1 + 0j,
    jump_m: float = 0.0,
    reported: float = 1.0,
    until_s: float = 60.0,
) -> tuple[float, Deviation] | None:
    """The first deviation of a vehicle that flies `flown(t, order)`, and when.

    `jump_m`: of its position, each 10 s. `reported`: the share of its velocity that it reports.
    """
    check, place = SetPointCheck(), 0j
    for step in range(round(until_s / STEP_S)):
        t = step * STEP_S
        ordered = order(t)
        moving = flown(t, ordered) if step else 0j
        place += moving * STEP_S + (jump_m if step % 50 == 49 else 0.0)
        velocity = reported * moving
        vectors = ((v.real, v.imag, 0.0) for v in (ordered, place, velocity))
        if deviation := check.observe(t, *vectors):
            return t, deviation
    return None


def turned(degrees: float, share: float = 1.0) -> Callable[[float, complex], complex]:
    return lambda t, order: order * cmath.rect(share, math.radians(degrees))


@pytest.mark.parametrize("degrees", [90.0, -90.0, 120.0, 180.0])
def test_a_vehicle_that_flies_elsewhere_is_known_after_its_window_with_its_direction(degrees: float) -> None:
    found = first(turned(degrees))
    assert found is not None
    after_s, deviation = found
    assert 5.0 <= after_s < 7.0
    assert deviation.off_deg == pytest.approx(degrees, abs=1.0)
    assert deviation.seconds == pytest.approx(5.0, abs=0.3)
    assert deviation.ordered_m == pytest.approx(5.0, abs=0.3)
    assert deviation.flown_m == pytest.approx(5.0, abs=0.3)


@pytest.mark.parametrize(("speed", "at_most_s"), [(1.0, 7.0), (0.5, 12.0), (4.0, 10.0)])
def test_a_vehicle_that_stands_hardly_moves(speed: float, at_most_s: float) -> None:
    found = first(lambda t, order: 0j, order=lambda t: complex(0.0, speed))
    assert found is not None
    assert found[0] < at_most_s
    assert found[1].off_deg is None
    assert found[1].flown_m == pytest.approx(0.0)


def test_one_that_stops_later_is_known_too() -> None:
    found = first(lambda t, order: order if t < 30.0 else 0j)
    assert found is not None
    assert 33.5 < found[0] < 36.0


def ramp(acceleration: float) -> Callable[[float, complex], complex]:
    """The velocity of a vehicle whose acceleration is limited."""
    velocity = 0j

    def flown(t: float, order: complex) -> complex:
        nonlocal velocity
        lag = order - velocity
        velocity += lag * min(1.0, acceleration * STEP_S / max(abs(lag), 1e-9))
        return velocity

    return flown


@pytest.mark.parametrize(
    ("flown", "order"),
    [
        pytest.param(turned(0.0), lambda t: 1 + 0j, id="follows"),
        pytest.param(turned(0.0, 0.3), lambda t: 1 + 0j, id="slow"),
        pytest.param(turned(0.0, 0.06), lambda t: 5 + 0j, id="limited to 0.3 m/s"),
        pytest.param(turned(45.0), lambda t: 1 + 0j, id="blown aside"),
        pytest.param(ramp(0.5), lambda t: complex(1.0 if t % 12 < 6 else -1.0), id="back and forth"),
        pytest.param(ramp(1.0), lambda t: complex(5.0 if t % 60 < 30 else -5.0), id="fast, back and forth"),
        pytest.param(ramp(0.5), lambda t: cmath.rect(1.0, t / 2), id="circle"),
        pytest.param(turned(0.0, 0.0), lambda t: 0j, id="hover"),
        pytest.param(lambda t, order: order + cmath.rect(0.4, t), lambda t: 0.4 + 0j, id="gusts"),
    ],
)
def test_no_vehicle_that_does_what_it_can_deviates(
    flown: Callable[[float, complex], complex], order: Callable[[float], complex]
) -> None:
    assert first(flown, order=order, until_s=120.0) is None


def test_a_position_that_jumps_and_a_velocity_that_is_not_reported_are_no_deviation() -> None:
    assert first(turned(0.0), jump_m=-9.0) is None
    assert first(turned(0.0), reported=0.0) is None


def test_after_a_gap_or_a_restart_it_begins_again() -> None:
    check = SetPointCheck()
    for gap, restarted in ((1.2, False), (STEP_S, True)):
        for begin in (0.0, 4.6 + gap):
            for step in range(24):
                assert check.observe(begin + step * STEP_S, (1.0, 0.0, 0.0), (0.0,) * 3, (0.0,) * 3) is None
            if restarted:
                check.restart()
        check.restart()
