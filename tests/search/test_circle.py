"""The circle about a place."""

from __future__ import annotations

import math

import pytest

from arva_hil.search.strategies.circle import RADIUS_M, Circle


@pytest.mark.parametrize("start", [(0.0, 0.0), (1.5, 0.0), (-3.0, 2.0)])
@pytest.mark.parametrize("speed", [0.5, 3.0])
def test_it_leads_round_the_place_at_the_speed_asked_for(start: tuple[float, float], speed: float) -> None:
    centre = (10.0, -5.0)
    north, east = centre[0] + start[0], centre[1] + start[1]
    circle, bearings, flown_s = Circle(centre, (north, east, -3.0)), set(), 0.0
    while not circle.done and flown_s < 60:
        circle.observe(centre)
        v_north, v_east = circle.velocity((north, east, -3.0), speed)
        assert math.hypot(v_north, v_east) <= min(speed, 0.8 * RADIUS_M) + 1e-9
        north, east, flown_s = north + 0.2 * v_north, east + 0.2 * v_east, flown_s + 0.2
        if math.dist((north, east), centre) > 0.7 * RADIUS_M:
            bearings.add(round(math.degrees(math.atan2(east - centre[1], north - centre[0])) / 60) % 6)
        assert math.dist((north, east), centre) < RADIUS_M + max(math.hypot(*start), 0.5)
    assert circle.done
    assert len(bearings) >= 5
