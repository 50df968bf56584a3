"""The height held, the least one, and the way down onto the place found."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.events import Event
from arva_hil.events.searches import TooLow
from arva_hil.search.mission.ground import Descent, Height, HeightKeeper
from arva_hil.search.mission.height_sensors import Odometry, RangeCheck

PLACE = (5.0, -3.0)


def ignored(event: Event) -> None: ...


def test_a_margin_is_flown_higher_and_has_time_to_be_climbed() -> None:
    keeper = HeightKeeper(3.0, ignored)
    assert keeper.velocity(0.0, Height(9.0, False, 6.0)) == 0.0
    assert keeper.wanted == 9.0
    assert keeper.velocity(1.0, Height(3.0, False, 6.0)) == -1.0
    assert keeper.too_low
    for time_s in (12.0, 16.9):
        keeper.velocity(time_s, Height(3.0, False, 6.0))
        assert not keeper.failed
    keeper.velocity(17.1, Height(3.0, False, 6.0))
    assert keeper.failed


def test_landing_is_left_to_the_autopilot_above_the_margin() -> None:
    descent = Descent((0.0, 0.0), 1.0, 0.0, 9.0)
    assert descent.velocity(0.0, (0.0, 0.0, -9.0), Height(9.0, False, 6.0))[2] > 0
    assert descent.velocity(1.0, (0.0, 0.0, -7.5), Height(7.5, False, 6.0)) == (0.0, 0.0, 0.0)
    assert descent.done


@given(st.floats(0.3, 100), st.floats(-100, 300), st.floats(0, 100))
def test_below_half_the_height_wanted_nothing_points_down(wanted: float, height: float, time_s: float) -> None:
    down = HeightKeeper(wanted, ignored).velocity(time_s, Height(height, False))
    assert -1.0 <= down <= 0.5
    if height < wanted / 2:
        assert down == -1.0


def test_a_height_that_is_no_number_is_climbed_from() -> None:
    assert HeightKeeper(3.0, ignored).velocity(0.0, Height(math.nan, False)) == -1.0


def test_too_low_is_said_once_and_holds_until_it_is_clear() -> None:
    events: list[Event] = []
    keeper = HeightKeeper(4.0, events.append)
    keeper.velocity(0.0, Height(4.0, False))
    assert not keeper.too_low
    assert keeper.velocity(1.0, Height(1.9, False)) == -1.0
    assert keeper.velocity(2.0, Height(2.5, False)) == -1.0
    assert keeper.too_low
    assert events == [TooLow(1.0, 1.9, 4.0)]
    keeper.velocity(3.0, Height(3.0, False))
    assert not keeper.too_low
    assert not keeper.failed


def test_on_the_way_up_from_the_take_off_there_is_nothing_to_say() -> None:
    events: list[Event] = []
    keeper = HeightKeeper(4.0, events.append)
    assert keeper.velocity(0.0, Height(1.0, False)) == -1.0
    assert keeper.too_low
    assert events == []


def test_what_does_not_get_up_has_failed() -> None:
    keeper = HeightKeeper(4.0, ignored)
    for time_s in range(11):
        keeper.velocity(time_s, Height(1.0, False))
        assert not keeper.failed
    keeper.velocity(10.5, Height(1.0, False))
    assert keeper.failed


def test_far_below_it_has_time_for_the_climb_as_long_as_it_rises() -> None:
    keeper = HeightKeeper(3.0, ignored)
    for tenths in range(400):
        assert keeper.velocity(tenths / 10, Height(-30.0 + tenths / 10, False)) <= 0.5
        assert not keeper.failed


def test_a_height_that_rises_for_ever_and_is_never_enough_has_failed() -> None:
    keeper = HeightKeeper(3.0, ignored)
    for time_s in range(62):
        keeper.velocity(time_s, Height(-1000.0 + time_s, False))
    assert keeper.failed


# -- the way down ------------------------------------------------------------------------------------------


def sunk(start: tuple[float, float, float], *, measured: bool, drift: tuple[float, float] = (0.0, 0.0)) -> list[float]:
    """The way down of a point that follows velocities, and drifts; north, east, down and the time it took."""
    north, east, down = start
    descent = Descent(PLACE, 1.0, 100.0, -down)
    now = 100.0
    while not descent.done:
        v_n, v_e, v_d = descent.velocity(now, (north, east, down), Height(-down, measured))
        assert math.hypot(v_n, v_e) <= 1.0 + 1e-9
        assert -0.5 <= v_d <= 0.5
        if math.dist((north, east), PLACE) > 0.5:
            assert v_d <= 0
        north, east, down = north + (v_n + drift[0]) * 0.1, east + (v_e + drift[1]) * 0.1, down + v_d * 0.1
        now += 0.1
        assert now < 300
    return [north, east, down, now - 100.0]


@pytest.mark.parametrize(("measured", "lowest"), [(True, 0.5), (False, 1.5)])
@pytest.mark.parametrize("drift", [(0.0, 0.0), (0.1, 0.05)])
def test_it_comes_down_on_the_place_and_leaves_the_rest_to_the_landing(
    measured: bool, lowest: float, drift: tuple[float, float]
) -> None:
    north, east, down, _ = sunk((0.0, 0.0, -4.0), measured=measured, drift=drift)
    assert math.dist((north, east), PLACE) < 0.2
    assert lowest < -down < lowest + 0.15


def test_what_is_low_beside_the_place_climbs_and_goes_there() -> None:
    north, east, down, _ = sunk((4.0, -3.0, -1.0), measured=False)
    assert math.dist((north, east), PLACE) < 0.5
    assert 1.0 < -down < 1.65


@pytest.mark.parametrize(
    ("place", "height"),
    [
        (PLACE, Height(0.6, True)),
        (PLACE, Height(0.1, True)),
        (PLACE, Height(3.0, True, landed=True)),
        (PLACE, Height(3.0, True, doubt="the rangefinder says 8.0 m, and the vertical speed 3.0 m")),
        ((50.0, 0.0), Height(0.29, True)),
    ],
)
def test_low_on_the_ground_or_without_a_sure_height_the_autopilot_lands_at_once(
    place: tuple[float, float], height: Height
) -> None:
    descent = Descent(PLACE, 1.0, 0.0, 3.0)
    assert descent.velocity(1.0, (*place, -3.0), height) == (0.0, 0.0, 0.0)
    assert descent.done


def test_through_the_height_of_rest_it_comes_up_again() -> None:
    descent = Descent(PLACE, 1.0, 0.0, 3.0)
    *_, down = descent.velocity(1.0, (PLACE[0] + 0.3, PLACE[1], -0.8), Height(0.8, True))
    assert down == pytest.approx(-0.2)
    assert not descent.done


def test_it_flies_on_only_while_the_height_is_sure() -> None:
    keeper = HeightKeeper(3.0, ignored)
    keeper.velocity(0.0, Height(3.0, True, still=True))
    assert keeper.pace == 0.0
    keeper.velocity(0.2, Height(3.0, True))
    assert keeper.pace == 1.0


def test_a_rangefinder_that_drifts_is_found_although_the_vehicle_could_sink_as_fast() -> None:
    check, keeper = RangeCheck(0.9), HeightKeeper(3.0, ignored)
    height, flown, speed = 3.0, 0.0, 0.5
    for n in range(600):
        time_s, climbed = 0.1 * n, height - 3.0
        shown = height + 0.1 * time_s
        lowest = check.height(Odometry(time_s, climbed, flown, speed, (flown, 0.0)), shown, shown, height + 0.9)
        assert lowest is not None
        height -= 0.1 * keeper.velocity(time_s, Height(lowest, True, still=check.still))
        speed = 0.5 * keeper.pace
        flown += 0.1 * speed
        assert height > 1.5
    assert check.deviation(60.0)


@pytest.mark.parametrize(("gap_s", "height"), [(5.0, 9.0), (100.0, 3.0)])
def test_ground_that_is_lower_after_a_long_silence_is_not_believed(gap_s: float, height: float) -> None:
    """A rangefinder that says 6 m more may be wrong, or the ground may have fallen on the way of 16 m."""
    check = RangeCheck(0.9)
    check.height(Odometry(0.0, 0.0, 0.0, 0.0, (0.0, 0.0)), 3.0, 3.0, 3.0)
    there = Odometry(gap_s, 0.0, 16.0, 1.0, (16.0, 0.0))
    assert check.height(there, 9.0, 9.0, 9.0) == pytest.approx(height)


def test_ground_that_slopes_below_a_descent_is_no_drift() -> None:
    check = RangeCheck(0.9)
    for n in range(200):
        time_s = 0.1 * n
        sunk, aside = 0.45 * max(0.0, time_s - 12.5), 0.2 * max(0.0, time_s - 12.5)
        metres = 5.0 - sunk + 0.4 * aside
        check.height(Odometry(time_s, -sunk, aside, 0.2, (aside, 0.0)), metres, metres, metres - 2.0)
    assert check.deviation(20.0) is None


@pytest.mark.parametrize(("climb", "stuck"), [(0.4, False), (1.5, True)])
def test_one_value_above_a_slope_that_is_followed_is_not_stuck(climb: float, stuck: bool) -> None:
    check = RangeCheck(0.9)
    motions = [Odometry(0.1 * n, 0.1 * n * climb, 0.1 * n, 1.0, (0.1 * n, 0.0)) for n in range(20)]
    heights = [check.height(motion, 2.69, 2.69, 2.69) for motion in motions]
    assert (None in heights) is stuck


def test_a_place_that_is_not_reached_is_not_waited_for_for_ever() -> None:
    _, _, down, took = sunk((0.0, 0.0, -4.0), measured=True, drift=(-2.0, 0.0))
    assert took == pytest.approx(50, abs=1)
    assert down == -4.0
