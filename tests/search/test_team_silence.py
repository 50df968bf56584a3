"""A vehicle whose search is gone is still somewhere: the others keep off where it is, or where it was heard last."""

from __future__ import annotations

import math

import pytest

from arva_hil.clock import Clock, StepClock
from arva_hil.config import parse
from arva_hil.events import Event
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import TeammateBack, TeammateLost
from arva_hil.events.words.reasons import in_words
from arva_hil.mavlink.codec import Encoder, command, dialect
from arva_hil.model.field import LocalFrame
from arva_hil.registry import STRATEGIES
from arva_hil.runtime.loop import run
from arva_hil.search.mission.mission import Mission
from arva_hil.search.strategies.analysis import AnalysisResult
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import Found
from arva_hil.search.team.team import TeamField, Teammate, strips_of
from arva_hil.search.team.team_tunnel import HeardAt, News
from arva_hil.simulated.autopilot import Mode
from arva_hil.simulated.closed_loop import ClosedLoop, Drone, several

NOT_SURE = in_words(because(Why.NOT_SURE))

HOME = (46.0, 7.0, 1000.0)
FRAME = LocalFrame(*HOME)


def at(north: float, east: float, up: float) -> tuple[float, float, float]:
    lat, lon, alt = (float(value) for value in FRAME.lla([north, east, -up]))
    return lat, lon, alt


def one(now: float = 0.0, speed: float = 1.0) -> Teammate:
    mate = Teammate(1, lambda news: None, TeamField((-60.0, -45.0, 60.0, 45.0), FRAME, 3))
    mate.plan(SearchPlan(STRATEGIES["flux"], speed=speed), FRAME)
    mate.report(now, HOME, flying=True)
    return mate


@pytest.mark.parametrize(
    ("age_s", "other", "speed", "wanted", "allowed"),
    [
        (0.9, (7, 0, 3), 1, (1, 0, 0), (1, 0, 0)),
        (2.0, (7, 0, 3), 1, (1, 0, 0), (-1 / 3, 0, 0)),  # it may have flown 2 m this way
        (2.0, (9, 0, 3), 1, (1, 0, 0), (1, 0, 0)),
        (2.0, (11, 0, 3), 3, (1, 0, 0), (-1, 0, 0)),  # faster, it may have flown farther
        (4.0, (8.9, 0, 3), 1, (1, 0.5, 0), (-0.0333, 0.5, 0)),  # past it
        (0.9, (0, 0.1, 6), 1, (1, 0, 0), (1, 0, 0)),
        (1.1, (0, 0.1, 6), 1, (1, 0, 0), (0.7071, -0.7071, 0)),  # it may come down from there,
        (6.0, (5, 0, 40), 1, (0, 0, 0), (-1, 0, 0)),  # or from anywhere,
        (6.0, (5.9, 0, 1), 1, (0, 0, 0.5), (-1, 0, 0)),  # or climb
        (6.0, (9.1, 0, 3), 1, (1, 0, 0.5), (1, 0, 0.5)),
        (9e3, (8.9, 0, 3), 1, (1, 0, 0), (-0.0333, 0, 0)),  # as long as the search lasts
    ],
)
def test_from_one_that_is_not_heard_it_keeps_farther_off_at_any_height(
    age_s: float,
    other: tuple[float, float, float],
    speed: float,
    wanted: tuple[float, float, float],
    allowed: tuple[float, float, float],
) -> None:
    mate = one(age_s, speed)
    mate.on_news(News(2, 0.0, at(*other), True, part=2, hunting=7))
    assert mate.apart((0.0, 0.0, -3.0), wanted, speed) == pytest.approx([v * 1.0 for v in allowed], abs=2e-3) or (
        speed == 3 and mate.apart((0.0, 0.0, -3.0), wanted, speed)[0] < -1.0
    )


def test_one_that_says_that_it_is_lost_is_kept_off_at_once_and_one_on_the_ground_stays_where_it_is() -> None:
    mate = one()
    mate.on_news(News(2, 0.0, at(5, 0, 40), True, lost=True))
    assert mate.apart((0.0, 0.0, -3.0), (1.0, 0.0, 0.0), 1.0)[0] < 0
    assert mate.above_another((0.0, 0.0, -3.0))
    assert math.dist(mate.beside((5.0, 1.0)), (5.0, 0.0)) > 9.5
    mate.on_news(News(2, 0.0, at(5, 0, 0), False, lost=True))
    assert mate.apart((0.0, 0.0, -3.0), (1.0, 0.0, 0.0), 1.0) == (1.0, 0.0, 0.0)
    assert math.dist(mate.beside((5.0, 1.0)), (5.0, 0.0)) == pytest.approx(7.0, abs=0.01)
    assert mate.lost == {}


def test_it_does_not_wait_for_a_place_where_one_that_is_lost_may_be() -> None:
    mate, here = one(6.0), (-48.0, 0.0, -3.0)
    mate.on_news(News(2, 0.0, at(-56, 0, 3), True))
    strips = strips_of(mate, mate.plan(SearchPlan(STRATEGIES["flux"]), FRAME), here)
    north, _ = strips.velocity(6.0, here)
    assert north > 0.5  # to the other end of its lane
    mate.done()
    for number in (0, 2):
        mate.on_news(News(number, 6.0 * (number == 0), at(-56, 0, 3), number == 2, flown=(0, 2)))
    mate.on_news(News(0, 6.0, at(50, 0, 0), False, flown=(0, 2), heard=(HeardAt(7, 9.0, *at(-55, 0, 0)[:2]),)))
    assert mate.handed((0.0, 0.0, -3.0)) == pytest.approx((-55.0, 0.0), abs=1e-3)
    assert mate.handed(here) is None  # it comes no nearer


def test_between_those_that_are_lost_it_lands_where_it_is_rather_than_to_hover_for_ever() -> None:
    mate, place = one(9.0), (0.0, 0.0, -3.0)
    for number, north, east in ((0, 7, 0), (2, 0, 7), (3, -7, 0), (4, 0, -7)):
        mate.on_news(News(number, 0.0, at(north, east, 3), True))
    mission = Mission(SearchPlan(STRATEGIES["flux"], limit_s=1.0), 9.0, place, land=True, team=mate)
    mission._reached = AnalysisResult(found=Found(5.0, 0.0), sure=True)
    now = 9.0
    while not mission.over and now < 120.0:
        mate.report(now, at(place[0], place[1], -place[2]), flying=True)
        velocity = mate.apart(place, mission.fly(now, place), 1.0)
        place = tuple(a + 0.2 * v for a, v in zip(place, velocity, strict=True))  # type: ignore[assignment]
        now += 0.2
    assert mission.over
    assert all(math.dist(place[:2], lost[:2]) > 6.0 for lost in mate.lost.values())


def test_a_place_found_where_one_that_is_lost_may_be_is_told_without_flying_there() -> None:
    mate, here = one(9.0), (-4.5, 0.0, -3.0)
    mate.on_news(News(2, 0.0, at(5, 0, 3), True))
    mission = Mission(SearchPlan(STRATEGIES["flux"]), 9.0, here, team=mate)
    mission._reached = AnalysisResult(found=Found(3.0, 0.0))
    mission.fly(9.0, here)
    assert in_words(mission.ended) == NOT_SURE


def test_a_pause_of_its_own_program_is_not_the_silence_of_the_others() -> None:
    mate = one()
    mate.on_news(News(2, 0.0, at(9, 0, 3), True, part=2, hunting=7))
    mate.skip(10.0)
    mate.report(10.0, HOME, flying=True)
    assert (mate.taken(7, own=False), mate.lost) == (True, {})
    mate.report(15.2, HOME, flying=True)
    assert (mate.taken(7, own=False), list(mate.lost)) == (False, [2])


class Killed:
    """A search that is served until an instant."""

    def __init__(self, drone: Drone, at_s: float) -> None:
        self.links = drone.search.links
        self._search = drone.search
        self._at_s = at_s

    def service(self, clock: Clock) -> float:
        if clock.now() < self._at_s:
            return min(self._search.service(clock), self._at_s)
        self.links = []
        return math.inf


def test_the_others_know_of_one_on_the_ground_of_one_that_its_pilot_flies_and_of_one_whose_search_is_killed() -> None:
    said: list[tuple[str, Event]] = []
    plan = SearchPlan(STRATEGIES["flux"], area=(-30.0, -30.0, 30.0, 30.0))
    scenario = several(parse("spec: 2\ntransmitters: [{id: 1, ned: [-25, 25, 1]}]", "field"), 4)
    loop = ClosedLoop(scenario, plan, start=0.0, stream_hz=10.0, emit=lambda name, event: said.append((name, event)))
    waiting, taken, lost, watching = loop.drones
    mate = watching.search._flight._team
    assert mate is not None
    waiting.search._preflight.check = lambda now: False  # type: ignore[method-assign]
    tasks = [Killed(lost, 12.0) if task is lost.search else task for task in loop.tasks]
    clock = StepClock()

    def seen(drone: Drone) -> tuple[News, float]:
        news = mate._others[loop.drones.index(drone)]
        return news, math.dist(loop.frame.ned(*news.lla), loop.frame.ned(*drone.vehicle.truth(clock.now()).lla))

    run(tasks, clock, until=10.0)
    news, off_m = seen(waiting)
    assert (news.flying, news.ended, off_m < 0.1) == (False, False, True)
    mode = command(taken.vehicle.system, 1, dialect.MAV_CMD_DO_SET_MODE, 1, Mode.RTL)
    taken.vehicle.feed(Encoder(255, 190).pack(mode), 10.0, link=9)
    run(tasks, clock, until=21.0)
    news, off_m = seen(taken)
    height_m = -float(loop.frame.ned(*news.lla)[2])
    assert (news.flying, news.ended, off_m < 1.5, height_m > 8.0) == (True, True, True, True)
    news, _ = seen(lost)
    assert (news.flying, news.time_s) == (True, pytest.approx(12.0, abs=0.5))
    assert [(name, event.number, event.apart_m) for name, event in said if isinstance(event, TeammateLost)] == [
        (watching.name, 3, 9.0)
    ]
    mate.on_news(News(2, 21.0, news.lla, False))
    run(tasks, clock, until=21.5)
    assert [event.number for name, event in said if isinstance(event, TeammateBack)] == [3]
