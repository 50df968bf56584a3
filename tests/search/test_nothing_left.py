"""A search with nothing left to find ends, also with a team, and does not fly its strips until the limit."""

from __future__ import annotations

import pytest

from arva_hil.events.words.reasons import in_words
from arva_hil.model.field import LocalFrame
from arva_hil.search.mission.mission import Mission
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import STILL, Found, Observation, Position, Velocity
from arva_hil.search.team.team import TeamField, Teammate
from arva_hil.search.team.team_tunnel import News
from tests.search.test_mission import LEVEL, beacon, frame

FRAME = LocalFrame(46.0, 7.0, 1000.0)
AREA = (0.0, 0.0, 30.0, 20.0)


class Hover:
    """A strategy that finds nothing."""

    found: Found | None = None

    def __init__(self, speed: float) -> None: ...

    def observe(self, observation: Observation) -> None: ...

    def velocity(self, time_s: float, position: Position) -> Velocity:
        return STILL


def mate() -> Teammate:
    """The first of two; the other one has flown its part, found a transmitter and landed."""
    first = Teammate(0, lambda news: None, TeamField(AREA, FRAME, 2))
    first.report(100.0, (46.0, 7.0, 1003.0), flying=True)
    first.on_news(News(1, 100.0, (46.0, 7.0003, 1000.0), False, found=(9,), flown=(1,)))
    return first


@pytest.mark.parametrize("team", [False, True])
@pytest.mark.parametrize("victims", [1, None])
def test_one_that_only_hears_a_transmitter_hardly_ends_after_two_rounds(team: bool, victims: int | None) -> None:
    plan = SearchPlan(Hover, height=3.0, speed=2.0, area=AREA, strip_width=10.0, limit_s=1e9, victims=victims)
    with_mate = mate() if team else None
    if with_mate:
        plan = with_mate.plan(plan, FRAME)
    m = Mission(plan, 100.0, (0.0, 0.0, -3.0), team=with_mate)
    position, now = (0.0, 0.0, -3.0), 100.0
    while not m.ended:
        now += 0.5
        if with_mate:
            with_mate.report(now, (46.0, 7.0, 1003.0), flying=True, heard=[])
        few = [beacon(1, 63)] if round(2 * now) % 16 == 0 else []  # in one frame of sixteen
        m.on_frame(frame(*few), now, position, LEVEL)
        north, east, _ = m.fly(now, position)
        position = position[0] + 0.5 * north, position[1] + 0.5 * east, -3.0
        assert now < 1300.0
    assert in_words(m.ended).startswith("not found: all strips are flown")
    assert in_words(m.ended).endswith(", twice")
