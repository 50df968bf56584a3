"""A member of a team whose news are wrong: the others end in time, say what is so, and fly to nobody's place."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

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
from arva_hil.search.mission.outcome import Outcome
from arva_hil.search.strategies.analysis import AnalysisResult
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import Found
from arva_hil.search.team.spacing import Near, kept_apart
from arva_hil.search.team.team import TeamField, Teammate, strips_of
from arva_hil.search.team.team_tunnel import HeardAt, News
from arva_hil.simulated.autopilot import Mode
from arva_hil.simulated.closed_loop import ClosedLoop, Drone, several

HOME = (46.0, 7.0, 1000.0)
FRAME = LocalFrame(*HOME)
FIELD = TeamField((-20.0, -30.0, 20.0, 30.0), FRAME, 3)
TWO = """
spec: 2
datum: {lat: 46.0, lon: 7.0, alt: 1000.0}
transmitters: [{id: 1, ned: [9, -11, 0.5]}, {id: 2, ned: [-8, 3, 1]}]
"""
LIMIT_S, BEGINS_S = 15.0, 14.0  # of the search; of the lies, after the take-off
LANDING_S = 200.0  # three descents from 6 m, 60 s each, and the landing itself

Place = NDArray[np.float64]  # NED
Lie = Callable[[float, Place], News]


def at(north: float, east: float, up: float) -> tuple[float, float, float]:
    lat, lon, alt = (float(value) for value in FRAME.lla([north, east, -up]))
    return lat, lon, alt


def beside(place: Place, north: float, east: float, down: float) -> tuple[float, float, float]:
    return at(place[0] + north, place[1] + east, -place[2] - down)


def everywhere(now: float, place: Place) -> News:
    there = beside(place, 9 * math.sin(7 * now), 9 * math.cos(11 * now), 4 * math.sin(13 * now))
    tick = int(now * 5)
    states = {"part": tick % 3, "free": tick % 2 == 0, "lost": tick % 5 == 0, "hunting": tick % 3, "hunting_m": 0.0}
    return replace(News(2, now, there, tick % 4 > 0), **states)  # type: ignore[arg-type]


LIES: dict[str, Lie] = {
    "everything found": lambda now, _: News(2, now, at(5, 5, 0), False, found=tuple(range(16)), flown=(0, 1, 2)),
    "below": lambda now, place: News(2, now, beside(place, 0.5, 0, 1), False),
    "above": lambda now, place: News(2, now, beside(place, 0.5, 0, -2), True),
    "behind": lambda now, place: News(2, now, beside(place, 0, -4, 0), True, 9, hunting_m=0.0),
    "lost over it": lambda now, place: News(2, now, beside(place, 0.5, 0, 0), True, lost=True),
    "everywhere": everywhere,
}


class Lied:
    """Two searches that fly, and news of a third one that only lies. A task of the loop, too: it watches.

    `gap_m`: least distance of the two in the air; `lowest`: of their heights before the descent, as a share of those
    wanted; `outside_m`: farthest from the area.
    """

    links = ()

    def __init__(self, lie: Lie) -> None:
        plan = SearchPlan(STRATEGIES["flux"], area=(-15.0, -15.0, 15.0, 15.0), limit_s=LIMIT_S)
        self.loop = ClosedLoop(several(parse(TWO, "field"), 3), plan, start=0.0, stream_hz=10.0)
        *self.flown, liar = self.loop.drones
        self.gap_m, self.lowest, self.outside_m = math.inf, math.inf, 0.0
        self._lie = lie
        tasks = [task for task in self.loop.tasks if task is not liar.search]
        run([*tasks, self], StepClock(), until=BEGINS_S + LIMIT_S + LANDING_S, stopped=lambda: all(self.outcomes))

    @property
    def outcomes(self) -> list[Outcome | None]:
        return [drone.search.outcome for drone in self.flown]

    def service(self, clock: Clock) -> float:
        now = clock.now()
        places = {drone.name: np.array(self.loop.frame.ned(*drone.vehicle.truth(now).lla)) for drone in self.flown}
        flying = [places[drone.name] for drone in self.flown if drone.vehicle.flying]
        self.gap_m = min([self.gap_m, *(float(np.linalg.norm(a - b)) for a, b in combinations(flying, 2))])
        self.outside_m = max([self.outside_m, *(float(max(abs(place[:2]))) - 15.0 for place in flying)])
        for drone in self.flown:
            self._watch(drone, places[drone.name])
            assert drone.search._flight._team is not None
            if now >= BEGINS_S:
                drone.search._flight._team.on_news(self._lie(now, places[drone.name]))
        return now + 0.2

    def _watch(self, drone: Drone, place: Place) -> None:
        mission = drone.search.mission
        if mission and not mission.ended and mission.found is None:
            self.lowest = min(self.lowest, -float(place[2]) / mission.plan.height)


@pytest.mark.parametrize("lie", LIES)
def test_beside_a_liar_two_searches_end_and_keep_off_the_ground_and_each_other(lie: str) -> None:
    lied = Lied(LIES[lie])
    for outcome, drone in zip(lied.outcomes, lied.flown, strict=True):
        assert outcome is not None, "it does not end"
        assert outcome.kind in ("found", "not sure", "not found", "failed")
        error_m = drone.error()
        assert outcome.kind != "found" or (error_m is not None and error_m < 1.5)
        hovers = "hovers, because another vehicle of the team reports that it is below" in in_words(outcome.how)
        assert drone.vehicle.flying == hovers, in_words(outcome.how)
    assert lied.gap_m > 2.5
    assert lied.lowest > 0.5
    assert lied.outside_m < 25.0


near = st.builds(
    lambda angle, metres, below, flying: Near(
        News(2, 0.0, HOME, flying), math.cos(angle), math.sin(angle), metres, below
    ),
    st.floats(0, math.tau), st.floats(0.01, 9), st.floats(-3, 3), st.booleans(),
)  # fmt: skip


@given(st.lists(near, max_size=4), st.lists(near, max_size=2), st.tuples(*[st.floats(-1, 1)] * 3), st.floats(0.1, 3))
def test_out_of_the_way_of_one_vehicle_is_never_the_way_to_another(
    others: list[Near], room_for: list[Near], wanted: tuple[float, float, float], speed: float
) -> None:
    north, east, down = kept_apart([*others, *room_for], room_for, wanted, speed)
    for one in [*others, *room_for]:
        if one.level and one.metres < one.apart_m:
            assert north * one.north + east * one.east < 1e-6
    assert math.hypot(north, east) < speed + 1e-6
    assert down <= wanted[2]


def member(number: int = 1) -> Teammate:
    mate = Teammate(number, lambda news: None, FIELD)
    mate.plan(SearchPlan(STRATEGIES["flux"]), FRAME)
    mate.report(0.0, HOME, flying=True)
    return mate


def test_its_own_part_is_flown_whatever_the_others_say() -> None:
    mate = member()
    place = (0.0, 0.0, -3.0)
    strips = strips_of(mate, SearchPlan(STRATEGIES["flux"], strip_width=10.0), place)
    mate.on_news(News(0, 0.0, at(0, 9, 3), True, part=1, flown=(0, 1, 2)))
    for _ in range(3):
        assert strips.velocity(0.0, place) != (0.0, 0.0)
    assert not strips.exhausted


def test_the_part_of_one_that_comes_back_is_left_to_it() -> None:
    mate = member(0)
    mate.on_news(News(1, 0.0, at(0, 0, 3), True, part=1))
    mate.done()
    mate.report(61.0, HOME, flying=True)
    assert mate.claim() is not None
    for number in (1, 2):
        mate.on_news(News(number, 61.0, at(0, 0, 3), True, part=number))
    assert mate.yields


def test_no_transmitter_is_flown_to_that_was_heard_far_outside_the_area() -> None:
    mate = member()
    for east, flown_to in ((45.0, True), (55.0, False)):
        heard = HeardAt(7, 5.0, *at(0, east, 0)[:2])
        mate.on_news(News(2, 0.0, at(0, 9, 3), True, heard=(heard,)))
        assert (mate.handed((0.0, 0.0, -3.0)) is not None) == flown_to


@pytest.mark.parametrize(("east", "wanted", "made"), [(45.0, 0.0, True), (55.0, 0.0, False), (55.0, 0.5, True)])
def test_nobody_drives_it_far_out_of_the_area(east: float, wanted: float, made: bool) -> None:
    mate = member()
    mate.on_news(News(2, 0.0, at(0, east - 3, 3), True, hunting=7, hunting_m=1.0))
    velocity = mate.apart((0.0, east, -3.0), (0.0, wanted, 0.0), 1.0)
    assert velocity == pytest.approx((0.0, 1.0 if made else 0.0, 0.0), abs=0.01)


def test_below_half_its_height_it_makes_no_room_and_only_climbs() -> None:
    mate = member()
    mission = Mission(SearchPlan(STRATEGIES["flux"]), 0.0, (0.0, 0.0, -3.0), team=mate)
    for height_m, made in ((3.0, True), (1.4, False)):
        place = (0.0, 0.0, -height_m)
        mate.on_news(News(0, 0.0, at(3, 0, height_m), True, hunting=7, hunting_m=1.0))
        north, east, down = mate.apart(place, mission.fly(1.0, place), mission.pace)
        assert (math.hypot(north, east) > 0.9, down < -0.9) == (made, not made)


# A vehicle whose search is gone is still somewhere: the others keep off where it is, or where it was heard last


NOT_SURE = in_words(because(Why.NOT_SURE))


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
