"""A fence inside the area is said before the vehicle is armed; beyond it there is no flight."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from arva_hil.simulated import arducopter
from tests import simulated_px4
from tests.search.test_client import World, ardupilot, px4

ON = {"FENCE_ENABLE": 1, "FENCE_TYPE": 3}


def fenced(patch: pytest.MonkeyPatch, make: Callable[[], Any], values: dict[str, float], **plan: Any) -> World:
    parameters = simulated_px4.PARAMETERS if make is px4 else arducopter._VALUES
    for name, value in values.items():
        patch.setitem(parameters, name, value)
    return World(make(), **plan)


@pytest.mark.parametrize(
    ("make", "values", "said"),
    [
        (
            ardupilot,
            ON | {"FENCE_RADIUS": 60},
            "71 m from the take-off point, beyond the vehicle's fence (FENCE_RADIUS",
        ),
        (ardupilot, ON | {"FENCE_TYPE": 4, "FENCE_TOTAL": 5}, "which is not compared with the area (FENCE_TOTAL 5)"),
        (px4, {"GF_MAX_HOR_DIST": 60.0}, "beyond the vehicle's fence (GF_MAX_HOR_DIST 60)"),
        (ardupilot, ON | {"FENCE_RADIUS": 80}, ""),
        (ardupilot, ON | {"FENCE_RADIUS": 60, "FENCE_TYPE": 1}, ""),
        (ardupilot, {"FENCE_RADIUS": 60}, ""),
        (px4, {"GF_MAX_HOR_DIST": 60.0, "GF_ACTION": 0}, ""),
    ],
)
def test_a_fence_inside_the_area_is_said_before_it_is_armed(
    monkeypatch: pytest.MonkeyPatch, make: Callable[[], Any], values: dict[str, float], said: str
) -> None:
    world = fenced(monkeypatch, make, values)
    world.reach("arming")
    found = [text for text in world.said if "fence" in text]
    assert len(found) == bool(said)
    assert all(said in text for text in found)


@pytest.mark.parametrize(
    ("make", "values", "plan", "how"),
    [
        (
            ardupilot,
            ON | {"FENCE_ALT_MAX": 10},
            {"height": 12.0},
            "the height is beyond the vehicle's fence (FENCE_ALT_MAX 10), 12 m needed; nothing was armed",
        ),
        (
            px4,
            {"GF_MAX_VER_DIST": 5.0},
            {"take_off": 6.0},
            "the height is beyond the vehicle's fence (GF_MAX_VER_DIST 5), 6 m needed; nothing was armed",
        ),
        (
            px4,
            {"GF_MAX_HOR_DIST": 30.0},
            {"area": (40.0, -10.0, 60.0, 10.0)},
            "the whole area is beyond the vehicle's fence (GF_MAX_HOR_DIST 30), 40 m needed; nothing was armed",
        ),
    ],
)
def test_beyond_the_fence_nothing_is_armed(
    monkeypatch: pytest.MonkeyPatch, make: Callable[[], Any], values: dict[str, float], plan: dict[str, Any], how: str
) -> None:
    world = fenced(monkeypatch, make, values, **plan)
    assert world.end() == ("failed", how)
    assert world.orders() == []
