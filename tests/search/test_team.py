"""Several searches of one field: each has its part, its transmitter and its own vehicle, and keeps off the others."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np
import pytest

from arva_hil.clock import Clock, StepClock
from arva_hil.config import parse
from arva_hil.events import Event
from arva_hil.events.searches import TransmitterLeft
from arva_hil.events.words.reasons import in_words
from arva_hil.mavlink.codec import Encoder, Parser, command, decode, dialect
from arva_hil.model.field import LocalFrame
from arva_hil.registry import STRATEGIES
from arva_hil.runtime.loop import run
from arva_hil.search.mission.choice import Choice
from arva_hil.search.mission.ground import Descent, Height
from arva_hil.search.mission.mission import Mission
from arva_hil.search.strategies.analysis import Inline
from arva_hil.search.strategies.guidance import Guidance
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import Observation, towards
from arva_hil.search.team.team import Bus, TeamField, Teammate, divide, strips_of
from arva_hil.search.team.team_tunnel import HeardAt, News
from arva_hil.simulated.autopilot import Mode
from arva_hil.simulated.closed_loop import ClosedLoop, Drone, several
from firmware_proto import Channel, Frame

HOME = (46.0, 7.0, 1000.0)
FRAME = LocalFrame(*HOME)
TWO = "spec: 2\ntransmitters: [{id: 1, ned: [9, -11, 0.5]}, {id: 2, ned: [-8, 12, 1]}]"


def at(north: float, east: float, up: float) -> tuple[float, float, float]:
    lat, lon, alt = (float(value) for value in FRAME.lla([north, east, -up]))
    return lat, lon, alt


def told(number: int, *, hunting: int | None = None, found: tuple[int, ...] = (), hunting_m: float = 30.0) -> News:
    return News(number, 0.0, at(0, 0, 3), True, hunting, found, hunting_m=hunting_m)


def alone(number: int, now: float = 0.0) -> Teammate:
    mate = Teammate(number, lambda news: None)
    mate.report(now, HOME, flying=True)
    return mate


def test_the_parts_of_an_area_are_side_by_side_and_all_of_it() -> None:
    parts = divide((-10.0, -20.0, 30.0, 40.0), 3)
    assert parts == [(-10.0, -20.0, 30.0, 0.0), (-10.0, 0.0, 30.0, 20.0), (-10.0, 20.0, 30.0, 40.0)]
    with pytest.raises(ValueError, match="count: 0, expected 1 or more"):
        divide((0.0, 0.0, 1.0, 1.0), 0)


def test_a_transmitter_is_taken_while_another_one_flies_there_and_once_it_is_found() -> None:
    mate = alone(1)
    assert not mate.taken(7, own=False)
    mate.on_news(told(2, hunting=7))
    assert mate.taken(7, own=False)
    assert not mate.taken(8, own=False)
    mate.on_news(told(2, found=(7,)))
    mate.report(1000.0, HOME, flying=True)
    assert mate.taken(7, own=False)


def test_of_two_that_fly_to_one_the_lower_number_goes_on() -> None:
    first, second = alone(0), alone(1)
    first.on_news(told(1, hunting=7))
    second.on_news(told(0, hunting=7))
    assert not first.taken(7, own=True, metres=30.0)
    assert second.taken(7, own=True, metres=30.0)


def test_one_that_has_heard_it_twice_as_near_takes_it_from_whoever_flies_there() -> None:
    first, second = alone(0), alone(1)
    first.on_news(told(1, hunting=7, hunting_m=12.0))
    second.on_news(told(0, hunting=7, hunting_m=30.0))
    assert (first.taken(7, own=True, metres=30.0), second.taken(7, own=True, metres=12.0)) == (True, False)
    assert (first.taken(7, own=True, metres=20.0), second.taken(7, own=True, metres=20.0)) == (False, True)
    assert (second.taken(7, own=False, metres=16.0), second.taken(7, own=False, metres=14.0)) == (True, False)


def free(number: int, north: float, *heard: HeardAt, time_s: float = 0.0) -> News:
    return News(number, time_s, at(north, 0, 3), True, free=True, heard=heard)


def heard_at(id_: int, metres: float, north: float) -> HeardAt:
    return HeardAt(id_, metres, *at(north, 0, 0)[:2])


def test_what_was_heard_and_nobody_flies_to_is_for_the_nearest_whose_strips_are_flown() -> None:
    sent: list[News] = []
    mate = Teammate(0, sent.append, TeamField((-60.0, -45.0, 60.0, 45.0), FRAME, 3))
    mate.plan(SearchPlan(STRATEGIES["flux"]), FRAME)
    far, near, found = heard_at(7, 60.0, -40.0), heard_at(7, 20.0, 30.0), heard_at(8, 5.0, 10.0)
    for part in range(3):
        mate.on_news(News(1, 0.0, at(0, 9, 3), True, found=(8,), flown=(part,), heard=(far,)))
    mate.done()
    mate.report(0.0, HOME, flying=True, heard=[near, found])
    assert (sent[-1].free, sent[-1].heard) == (True, (near,))  # what is found is no news
    assert mate.handed((0.0, 0.0, -3.0)) == pytest.approx((30.0, 0.0), abs=1e-3)  # where it was heard best
    mate.on_news(free(2, 25.0))
    assert mate.handed((0.0, 0.0, -3.0)) is None  # another one is nearer,
    mate.on_news(free(2, 25.0, heard_at(9, 40.0, -20.0)))
    assert mate.handed((0.0, 0.0, -3.0)) == pytest.approx((-20.0, 0.0), abs=1e-3)  # and each goes to one
    mate.on_news(told(1, hunting=9))
    assert mate.handed((0.0, 0.0, -3.0)) is None
    mate.report(9.0, HOME, flying=True, heard=[near])  # the others are not heard any more
    assert mate.handed((0.0, 0.0, -3.0)) == pytest.approx((-20.0, 0.0), abs=1e-3)
    assert mate.handed((-20.0, 0.0, -3.0)) == pytest.approx((30.0, 0.0), abs=1e-3)  # it was not there
    assert mate.handed((30.0, 0.0, -3.0)) is None
    mate.forgive()
    assert mate.handed((0.0, 0.0, -3.0)) is not None


def test_none_lands_where_another_one_has_landed() -> None:
    mate = alone(1)
    mate.plan(SearchPlan(STRATEGIES["flux"]), FRAME)
    assert mate.beside((4.0, 0.0)) == (4.0, 0.0)
    mate.on_news(News(2, 0.0, at(4, 0, 0), False))
    for place in ((4.0, 0.0), (4.0, 3.0)):
        assert math.dist(mate.beside(place), (4.0, 0.0)) > 6.0
    assert mate.beside((4.0, 8.0)) == (4.0, 8.0)


def test_a_transmitter_of_one_that_is_not_heard_any_more_is_free() -> None:
    mate = alone(1, now=4.9)
    mate.on_news(told(2, hunting=7))
    assert mate.taken(7, own=False)
    mate.report(5.1, HOME, flying=True)
    assert not mate.taken(7, own=False)


def test_news_go_to_all_others_five_times_a_second_and_at_once_when_something_changes() -> None:
    bus = Bus()
    mates = [bus.join() for _ in range(3)]
    heard: list[News] = []
    mates[2].on_news = heard.append  # type: ignore[method-assign]
    for tick in range(100):
        mates[0].report(tick / 100, HOME, flying=True, hunting=7 if tick == 50 else None)
    assert 5 <= len(heard) <= 8
    assert [news.hunting for news in heard].count(7) == 1


@pytest.mark.parametrize(
    ("other", "flying", "wanted", "allowed"),
    [
        ((5, 0, 3), True, (1, 0.5, 0), (0, 0.5, 0)),  # not nearer, but past it
        ((5, 0, 3), True, (-1, 0, 0), (-1, 0, 0)),  # away from it
        ((5, 0, 6), True, (1, 0, 0), (1, 0, 0)),  # below it
        ((7, 0, 3), True, (1, 0, 0), (1, 0, 0)),  # far enough
        ((2, 0, 0), True, (0, 0, 0.5), (0, 0, 0)),  # not down onto it
        ((2, 0, 0), False, (0, 0, 0.5), (0, 0, 0)),  # nor where it has landed
        ((2, 0, 0), False, (1, 0, 0), (1, 0, 0)),  # but over it,
        ((2, 0, -2), False, (0, 0, 0.5), (0, 0, 0.5)),  # and down to 4 m above it
        ((2, 0, 3), True, (0, 0, -0.5), (0, 0, -0.5)),  # up is always free
    ],
)
def test_no_velocity_leads_to_another_vehicle(
    other: tuple[float, float, float],
    flying: bool,
    wanted: tuple[float, float, float],
    allowed: tuple[float, float, float],
) -> None:
    mate = alone(1)
    mate.plan(SearchPlan(STRATEGIES["flux"]), FRAME)
    mate.on_news(News(2, 0.0, at(*other), flying, part=2))
    assert mate.apart((0.0, 0.0, -3.0), wanted, 1.2) == pytest.approx(allowed, abs=1e-3)


@pytest.mark.parametrize(
    ("other", "pushed"),
    [
        (News(0, 0.0, at(5, 0, 3), True, hunting=7, hunting_m=20.0), True),  # the lower number
        (News(2, 0.0, at(5, 0, 3), True, hunting=7, hunting_m=20.0), False),
        (News(2, 0.0, at(5, 0, 3), True, hunting=7, hunting_m=19.0), True),  # nearer to its transmitter
        (News(0, 0.0, at(5, 0, 3), True, hunting=7, hunting_m=21.0), False),
        (News(0, 0.0, at(5, 0, 3), True, free=True), False),  # it only waits
        (News(2, 0.0, at(5, 0, 3), True), True),  # its search has ended,
        (News(2, 0.0, at(5, 0, 9), True), True),  # so it may come down from above
        (News(2, 0.0, at(5, 0, 0), False), False),  # it has landed
        (News(2, -9.0, at(5, 0, 3), True), True),  # nobody knows where it is now,
        (News(2, -9.0, at(5, 0, 30), True), True),  # nor how high
        (News(2, 0.0, at(5, 0, 30), True, lost=True), True),
        (News(2, -9.0, at(5, 0, 0), False), False),  # it sits there
        (News(0, 0.0, at(5, 0, 6), True, hunting=7, hunting_m=9.0), False),  # at another height
    ],
)
def test_it_makes_room_for_one_that_has_precedence(other: News, pushed: bool) -> None:
    mate = alone(1)
    mate.plan(SearchPlan(STRATEGIES["flux"]), FRAME)
    mate.report(0.0, HOME, flying=True, hunting=8, hunting_m=20.0)
    mate.on_news(other)
    north, _, _ = mate.apart((0.0, 0.0, -3.0), (0.0, 0.0, 0.0), 1.2)
    assert north == pytest.approx(-1.2 if pushed else 0.0, abs=1e-3)


@pytest.mark.parametrize(
    ("others", "height", "wanted"),
    [
        ([], 6.0, 6.0),  # nobody is known
        ([News(0, 0.0, at(9, 0, 3), True, part=0)], 6.0, 6.0),
        ([News(0, 0.0, at(9, 0, 0), False, part=0)], 6.0, 6.0),  # it has not taken off yet
        ([News(0, 0.0, at(9, 0, 3), True)], 6.0, 6.0),  # it hovers, or comes down
        ([News(0, -99.0, at(9, 0, 3), True, part=0)], 6.0, 6.0),  # nobody knows where it is now
        ([News(0, 0.0, at(9, 0, 0), False)], 6.0, 3.0),  # it has landed
        ([News(0, 0.0, at(9, 0, 0), False), News(3, 0.0, at(9, 9, 6), True, part=3)], 6.0, 3.0),  # one of its own
        ([News(0, 0.0, at(9, 0, 0), False), News(3, 0.0, at(2, 0, 3), True, part=3)], 5.2, 5.2),  # not onto that one
        ([News(0, 0.0, at(2, 0, 0), False)], 6.0, 3.0),  # over one that has landed
        ([News(0, 0.0, at(2, 0, 0), False)], 3.9, 3.9),  # not as low as elsewhere
    ],
)
def test_the_upper_ones_search_lower_once_all_below_have_landed(
    others: list[News], height: float, wanted: float
) -> None:
    mate = alone(1)
    plan = mate.plan(mate.layered(SearchPlan(STRATEGIES["flux"])), FRAME)
    assert plan.height == 6.0
    for other in others:
        mate.on_news(other)
    assert mate.height(plan.height, height, (0.0, 0.0, -height)) == pytest.approx(wanted)
    unlayered = alone(1)
    unlayered.plan(SearchPlan(STRATEGIES["flux"]), FRAME)
    unlayered.on_news(News(0, 0.0, at(9, 0, 0), False))
    assert unlayered.height(3.0, 3.0, (0.0, 0.0, -3.0)) == 3.0


class Hunter:
    """A vehicle without a body that flies to a transmitter at its height, circles there for 10 s, then comes down."""

    def __init__(self, bus: Bus, place: tuple[float, float], start: tuple[float, float]) -> None:
        self.mate = bus.join()
        self.mate.plan(SearchPlan(STRATEGIES["flux"]), FRAME)
        self.at = (*start, -3.0)
        self._place = place
        self._there_s = 0.0
        self._descent: Descent | None = None

    @property
    def landed(self) -> bool:
        return self._descent is not None and self._descent.done

    def step(self, now: float) -> None:
        north, east, _ = self.at
        circle = self._place[0] + 1.5 * math.cos(now), self._place[1] + 1.5 * math.sin(now)
        self._there_s += 0.5 * (math.dist((north, east), self._place) < 2.0)
        over = self._there_s > 10.0
        hunting = None if over else self.mate.number
        self.mate.report(now, at(north, east, -self.at[2]), flying=not self.landed, hunting=hunting, searching=not over)
        wanted = (*towards(self.at, circle, 1.0), 0.0)
        if over:
            self._descent = self._descent or Descent(self._place, 1.0, now, -self.at[2], self.mate)
            wanted = self._descent.velocity(now, self.at, Height(-self.at[2], True))
        if not self.landed:
            velocity = self.mate.apart(self.at, wanted, 1.0)
            self.at = tuple(place + 0.5 * v for place, v in zip(self.at, velocity, strict=True))  # type: ignore[assignment]


@pytest.mark.parametrize("apart_m", [0.5, 4.0])
def test_places_close_together_are_all_reached_and_nobody_lands_near_another(apart_m: float) -> None:
    bus = Bus()
    team = [Hunter(bus, (n * apart_m, 0.0), (n * 9.0 - 9.0, -20.0)) for n in range(3)]
    nearest = math.inf
    for tick in range(600):
        if all(one.landed for one in team):
            break
        for one in team:
            one.step(tick * 0.5)
        nearest = min(nearest, *(math.dist(a.at, b.at) for a, b in combinations(team, 2)))
    assert all(one.landed for one in team)
    assert nearest > 2.2  # above one that has landed
    assert all(math.dist(a.at, b.at) > 5.5 for a, b in combinations(team, 2))


def test_it_says_when_it_leaves_its_transmitter_to_another_search() -> None:
    mate, said = alone(1), list[Event]()
    mission = Mission(SearchPlan(STRATEGIES["flux"]), 0.0, (0.0, 0.0, -3.0), team=mate, emit=said.append)
    heard = Frame(1, 1, (Channel(7, 1, 2000, 0),))
    mission.on_frame(heard, 1.0, (0.0, 0.0, -3.0), np.eye(3))
    assert mission.choice.target == 7
    mate.on_news(told(0, found=(7,)))
    mission.on_frame(Frame(2, 1, heard.channels), 2.0, (1.0, 0.0, -3.0), np.eye(3))
    assert mission.choice.target is None
    assert [event.transmitter for event in said if isinstance(event, TransmitterLeft)] == [7]


def test_one_that_flies_to_a_transmitter_for_long_goes_to_another_one_and_leaves_it_to_others() -> None:
    said = list[Event]()
    guidance = Guidance(Inline(partial(STRATEGIES["flux"], 1.0)), said.append, 10.0)
    choice = Choice(guidance, lambda id_, own: False, said.append, 240.0)
    for now in range(243):
        for id_, metres in ((7, 20.0), (8, 40.0)):
            choice.add(id_, Observation(float(now), (0.1 * now, 0.0, -3.0), np.eye(3), round(metres * 100), 0, False))
        choice.choose((7, 8), float(now))
        assert choice.target == (7 if now <= 240 else 8)
    assert [event.transmitter for event in said if isinstance(event, TransmitterLeft)] == [7]


def test_a_search_that_finds_nothing_does_not_land_on_another_vehicle() -> None:
    mate = alone(1)
    plan = mate.plan(SearchPlan(STRATEGIES["flux"], limit_s=1.0), FRAME)
    mission = Mission(plan, 0.0, (0.0, 0.0, -6.0), land=True, team=mate)
    place, now = (0.0, 0.0, -6.0), 0.0
    mate.on_news(News(2, 0.0, at(1, 0, 0), False))
    while not mission.over:
        velocity = mate.apart(place, mission.fly(now, place), 1.0)
        place = tuple(a + 0.2 * v for a, v in zip(place, velocity, strict=True))  # type: ignore[assignment]
        now += 0.2
    assert now < 60.0
    assert math.dist(place[:2], (1.0, 0.0)) > 5.5


class Flyer:
    """A vehicle without a body: it flies the strips of its team as they say, 10 m in a step of a second."""

    def __init__(self, bus: Bus, east: float) -> None:
        self.mate = bus.join()
        self._origin = LocalFrame(*at(0, east, 0))
        self._east = east
        plan = self.mate.plan(SearchPlan(STRATEGIES["flux"], strip_width=30.0), self._origin)
        self._plan = replace(plan, speed=10.0)
        self.place = (0.0, 0.0, -3.0)
        self.strips = strips_of(self.mate, self._plan, self.place)
        self.track: list[tuple[float, float]] = []  # in the team's frame

    def step(self, now: float, *, searching: bool = True) -> None:
        self.mate.report(now, at(self.place[0], self.place[1] + self._east, 3), flying=True, searching=searching)
        if searching:
            north, east = self.strips.velocity(now, self.place)
            self.place = (self.place[0] + north, self.place[1] + east, -3.0)
            self.track.append((self.place[0], self.place[1] + self._east))

    def was_in(self, part: int) -> bool:
        south, west, north, east = divide((-60.0, -45.0, 60.0, 45.0), 3)[part]
        norths = [n for n, e in self.track if west < e < east]
        return bool(norths) and min(norths) < south + 2 and max(norths) > north - 2


def flyers() -> list[Flyer]:
    bus = Bus(TeamField((-60.0, -45.0, 60.0, 45.0), FRAME, 3))
    return [Flyer(bus, east) for east in (-5.0, 0.0, 5.0)]


def test_each_searches_its_own_part_and_they_end_when_all_are_flown() -> None:
    team = flyers()
    for second in range(40):
        for one in team:
            one.step(float(second))
    assert [[one.was_in(part) for part in range(3)] for one in team] == np.eye(3, dtype=bool).tolist()
    assert all(one.strips.exhausted for one in team)


@pytest.mark.parametrize("how", ["silent", "ended", "never there"])
def test_the_strips_of_one_that_is_lost_are_flown_by_another(how: str) -> None:
    team, lost_at = flyers(), 0 if how == "never there" else 4
    for second in range(150):
        for number, one in enumerate(team):
            if number != 1 or second < lost_at:
                one.step(float(second))
            elif how == "ended":
                one.step(float(second), searching=False)
        if second == 45:  # nobody waits for a part that nobody flies, but for one that may still come
            assert team[0].strips.exhausted is (how != "never there")
    assert team[0].was_in(1) != team[2].was_in(1)  # by one of them
    assert team[0].strips.exhausted
    assert team[2].strips.exhausted


def test_who_waits_for_another_hovers_and_of_two_that_claim_one_part_the_lower_number_goes_on() -> None:
    mates = [Bus(TeamField((-60.0, -45.0, 60.0, 45.0), FRAME, 3)).join() for _ in range(1)]
    first, second = mates[0], Teammate(1, lambda news: None, TeamField((-60.0, -45.0, 60.0, 45.0), FRAME, 3))
    for mate, other in ((first, second), (second, first)):
        mate.plan(SearchPlan(STRATEGIES["flux"]), FRAME)
        mate.report(0.0, HOME, flying=True)
        mate.on_news(News(other.number, 0.0, at(0, 9, 3), True, part=other.number))
        mate.on_news(News(2, 0.0, at(0, 9, 3), True, part=2))
        mate.done()
        assert mate.claim() is None
        assert mate.waits
        mate.on_news(News(2, 0.0, at(0, 9, 3), True, part=None))
        assert mate.claim() == pytest.approx(divide((-60.0, -45.0, 60.0, 45.0), 3)[2], abs=1e-6)
        mate.on_news(News(other.number, 0.0, at(0, 9, 3), True, part=2))
    assert not first.yields
    assert second.yields


def test_nobody_waits_for_a_part_that_does_not_exist() -> None:
    mate = Teammate(0, lambda news: None, TeamField((-60.0, -45.0, 60.0, 45.0), FRAME, 1))
    mate.plan(SearchPlan(STRATEGIES["flux"]), FRAME)
    mate.report(0.0, HOME, flying=True)
    mate.claim()
    mate.done()
    mate.on_news(News(1, 0.0, at(0, 9, 3), True, part=7))
    assert not mate.waits


@pytest.mark.parametrize(
    ("other", "under"),
    [
        (News(0, 0.0, at(2, 0, 3), True), True),
        (News(0, 0.0, at(2, 0, 30), True), True),
        (News(0, 0.0, at(2, 0, 3), False), False),  # it stands on a slope
        (News(0, 0.0, at(0, 5, 3), True), False),
        (News(0, 0.0, at(2, 0, 0.5), True), False),  # it takes off too
        (News(0, -2.0, at(0, 7, 3), True), True),  # it is not heard any more: it may be nearer
        (News(0, -2.0, at(0, 12, 3), True), False),
    ],
)
def test_a_vehicle_under_another_one_does_not_take_off(other: News, under: bool) -> None:
    mate = Teammate(1, lambda news: None)
    assert not mate.under_another
    mate.report(0.0, HOME, flying=False)
    mate.on_news(other)
    assert mate.under_another == under


@pytest.mark.parametrize(("until_s", "flies"), [(30.0, True), (200.0, False)])
def test_who_takes_off_late_waits_until_nobody_is_above(until_s: float, flies: bool) -> None:
    """The first one hovers above the second one's place until then; the second one waits a minute."""
    clock, plan = StepClock(), SearchPlan(STRATEGIES["flux"], area=(-20, -20, 20, 20))
    loop = ClosedLoop(several(parse(TWO, "test"), 2), plan, start=0.0, stream_hz=10.0)
    first, second = loop.drones
    lat, lon, alt = second.vehicle.truth(0.0).lla
    flying: list[float] = []

    def over() -> bool:
        now = clock.now()
        assert second.search._flight._team is not None
        second.search._flight._team.on_news(News(0, now, (lat + (now > until_s) * 1e-3, lon, alt + 5.0), True, part=0))
        if second.vehicle.flying:
            flying.append(now)
        return bool(flying) or second.search.outcome is not None

    run([task for task in loop.tasks if task is not first.search], clock, until=150.0, stopped=over)
    if flies:
        assert until_s < flying[0] < until_s + 10.0
    else:
        assert not flying
        assert second.search.outcome is not None
        assert "does not arm: another vehicle of the team is above it, or may be" in in_words(second.search.outcome.how)


class Field:
    """Three drones on one field, flown to the end. A task of the loop, too: it watches.

    `gap_m`: the least distance of two that are in the air; `orders`: to each drone's autopilot, (when, message);
    `early`: who told others of a transmitter found before the search for it had ended.
    """

    links = ()

    def __init__(self, strategy: str, *, pilot_of: int | None = None, pilot_s: float = math.inf) -> None:
        self.clock = StepClock()
        plan = SearchPlan(STRATEGIES[strategy], area=(-15.0, -15.0, 15.0, 15.0))
        self.loop = ClosedLoop(several(parse(TWO, "field"), 3), plan, start=0.0, stream_hz=10.0)
        self.gap_m, self.early = math.inf, set[str]()
        self.orders: dict[str, list[tuple[float, object]]] = {drone.name: [] for drone in self.loop.drones}
        self._pilot_of, self._pilot_s = pilot_of, pilot_s
        for drone in self.loop.drones:
            self._tap(drone)
        run([*self.loop.tasks, self], self.clock, until=900.0, stopped=lambda: self.loop.over)

    def service(self, clock: Clock) -> float:
        now = clock.now()
        flying = [drone.vehicle for drone in self.loop.drones if drone.vehicle.flying]
        places = [np.array(self.loop.frame.ned(*vehicle.truth(now).lla)) for vehicle in flying]
        self.gap_m = min([self.gap_m, *(float(np.linalg.norm(a - b)) for a, b in combinations(places, 2))])
        for drone in self.loop.drones:
            mission, mate = drone.search.mission, drone.search._flight._team
            if mission and not mission.ended and mate and mate._own:
                self.early.add(drone.name)
        if self._pilot_of is not None and now >= self._pilot_s:
            drone = self.loop.drones[self._pilot_of]
            mode = command(drone.vehicle.system, 1, dialect.MAV_CMD_DO_SET_MODE, 1, Mode.LOITER)
            drone.vehicle.feed(Encoder(255, 190).pack(mode), now, link=9)
            self._pilot_of = None
        return now + 0.1

    def _tap(self, drone: Drone) -> None:
        read, parser = drone.commands.read, Parser()

        def tapped() -> bytes:
            data = read()
            for packet in parser.feed(data):
                if (message := decode(packet)) is not None and hasattr(message, "target_system"):
                    self.orders[drone.name].append((self.clock.now(), message))
            return data

        drone.commands.read = tapped  # type: ignore[method-assign]


def test_a_team_finds_every_transmitter_once_and_its_vehicles_keep_apart() -> None:
    field = Field("flux")
    missions = [drone.search.mission for drone in field.loop.drones]
    ids = [mission.choice.target for mission in missions if mission and mission.found is not None]
    assert sorted(ids, key=str) == [1, 2]
    assert all(error is None or error < 1.5 for error in (drone.error() for drone in field.loop.drones))
    assert field.gap_m > 2.5
    assert not field.early
    for drone in field.loop.drones:  # nobody commands another's
        orders = [message for _, message in field.orders[drone.name] if not hasattr(message, "payload")]  # no TUNNEL
        assert {message.target_system for message in orders} == {drone.vehicle.system}  # type: ignore[attr-defined]


def test_the_pilot_of_one_drone_takes_over_that_one_and_no_other() -> None:
    field = Field("estimate", pilot_of=1, pilot_s=20.0)
    drones = field.loop.drones
    mine = drones[1].search.outcome
    assert mine is not None
    assert "LOITER" in in_words(mine.how)
    assert drones[1].vehicle.state.startswith("LOITER, armed")
    moves = [
        at
        for at, message in field.orders[drones[1].name]
        if type(message).__name__.startswith("MAVLink_set_position_target") and at > 21.0
    ]
    assert not moves
    for other in (drones[0], drones[2]):
        assert other.search.outcome is not None
        assert other.search.outcome.kind in ("found", "not found")
    assert field.loop.found == {1, 2}
