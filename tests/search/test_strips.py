"""The strips: their geometry, and that they are flown to their end."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.search.strategies.strategy import STILL
from arva_hil.search.strategies.strips import Area, Strips

PLACE = st.floats(-200, 200)
WIDTH = st.floats(1, 100)
SHARE = st.floats(0, 1)
AREA = st.tuples(PLACE, PLACE, st.floats(1, 300), st.floats(1, 300)).map(
    lambda a: (a[0], a[1], a[0] + a[2], a[1] + a[3])
)
AT = st.tuples(PLACE, PLACE, st.just(-1.0))

Point = tuple[float, float]


def lanes(strips: Strips) -> list[tuple[Point, Point]]:
    ends = strips.lanes
    assert len(ends) % 2 == 0
    return list(zip(ends[::2], ends[1::2], strict=True))


def beside(point: Point, a: Point, b: Point) -> float:
    """The distance of a point from a lane."""
    along = b[0] - a[0], b[1] - a[1]
    share = ((point[0] - a[0]) * along[0] + (point[1] - a[1]) * along[1]) / math.hypot(*along) ** 2
    share = max(0.0, min(1.0, share))
    return math.dist(point, (a[0] + share * along[0], a[1] + share * along[1]))


@given(AREA, AT, WIDTH, SHARE, SHARE)
def test_every_place_is_within_half_a_width_of_a_lane(area: Area, at: Point, width: float, n: float, e: float) -> None:
    south, west, north, east = area
    point = south + n * (north - south), west + e * (east - west)
    strips = Strips(area, 1.0, (*at[:2], -1.0), width=width)
    assert min(beside(point, *lane) for lane in lanes(strips)) <= width / 2 + 1e-6


@given(AREA, AT, WIDTH)
def test_no_more_lanes_than_it_takes_and_all_along_the_longer_side(
    area: Area, at: tuple[float, float, float], width: float
) -> None:
    south, west, north, east = area
    flown = lanes(Strips(area, 1.0, at, width=width))
    shorter, longer = sorted((north - south, east - west))
    assert len(flown) == math.ceil(shorter / width)
    for a, b in flown:
        assert math.dist(a, b) == pytest.approx(longer)
        assert all(south <= n <= north and west <= e <= east for n, e in (a, b))
        assert a[0] == b[0] or a[1] == b[1]
    turns = [math.dist(a[1], b[0]) for a, b in pairwise(flown)]
    assert turns == pytest.approx([shorter / len(flown)] * len(turns))  # from each end straight to the next lane's


@given(AREA, AT, WIDTH)
def test_begins_at_the_nearest_corner(area: Area, at: tuple[float, float, float], width: float) -> None:
    strips = Strips(area, 1.0, at, width=width)
    corners = [end for lane in (lanes(strips)[0], lanes(strips)[-1]) for end in lane]
    assert math.dist(at[:2], strips.lanes[0]) <= min(math.dist(at[:2], corner) for corner in corners) + 1e-6


@given(AREA, AT, WIDTH, st.floats(0.5, 10))
def test_no_faster_than_allowed(area: Area, at: tuple[float, float, float], width: float, speed: float) -> None:
    assert math.hypot(*Strips(area, speed, at, width=width).velocity(0.0, at)) <= speed * (1 + 1e-9)


@pytest.mark.parametrize("speed", [1.0, 5.0])
@pytest.mark.parametrize("area", [(0, 0, 100, 70), (-50, -80, -20, 40)])
def test_is_flown_to_its_end(area: Area, speed: float) -> None:
    strips = Strips(area, speed, (0.0, 0.0, -1.0))
    to_come, at, way = list(strips.lanes), (0.0, 0.0), 0.0
    length = math.dist(at, to_come[0]) + sum(map(math.dist, to_come, to_come[1:]))
    while not strips.exhausted and way < 2 * length:
        velocity = strips.velocity(0.0, (*at, -1.0))
        at = at[0] + 0.2 * velocity[0], at[1] + 0.2 * velocity[1]
        way += 0.2 * math.hypot(*velocity)
        if to_come and math.dist(at, to_come[0]) < 1.5:
            to_come.pop(0)
    assert not to_come
    assert way == pytest.approx(length, abs=2 * len(strips.lanes))
    assert strips.velocity(0.0, (*at, -1.0)) == STILL


def test_forty_metres_unless_told_otherwise() -> None:
    strips = Strips((0, 0, 100, 80), 1.0, (0.0, 0.0, 0.0))
    assert strips.lanes == [(0, 20), (100, 20), (100, 60), (0, 60)]
    assert not strips.exhausted


@pytest.mark.parametrize("area", [(0, 0, 0, 10), (10, 0, 0, 10), (0, 5, 10, 5), (math.nan, 0, 10, 10)])
def test_an_empty_area_is_refused(area: Area) -> None:
    with pytest.raises(ValueError, match="nothing to fly over"):
        Strips(area, 1.0, (0.0, 0.0, 0.0))


@pytest.mark.parametrize("width", [0.0, -40.0, math.nan])
def test_a_strip_has_a_width(width: float) -> None:
    with pytest.raises(ValueError, match="nothing to fly over"):
        Strips((0, 0, 10, 10), 1.0, (0.0, 0.0, 0.0), width=width)
