"""Several searches of one field: parts, transmitters, distances; members that lie, fall silent, or are far away."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from arva_hil import simulated
from arva_hil.autopilot.following.session import Session
from arva_hil.clock import Clock, StepClock
from arva_hil.config import parse
from arva_hil.events import Event
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import TeammateBack, TeammateLost, TransmitterLeft
from arva_hil.events.words.reasons import in_words
from arva_hil.links import memory
from arva_hil.mavlink.codec import Encoder, Packet, Parser, command, decode, dialect, untunnel
from arva_hil.model.field import LocalFrame
from arva_hil.registry import STRATEGIES
from arva_hil.runtime.loop import run
from arva_hil.search.flight.client import COMPONENT, SearchClient
from arva_hil.search.mission import ground
from arva_hil.search.mission.choice import Choice, Guidance
from arva_hil.search.mission.ground import Descent, Height
from arva_hil.search.mission.mission import Mission
from arva_hil.search.mission.outcome import Outcome
from arva_hil.search.strategies.analysis import AnalysisResult, Inline
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import Found, Observation, towards
from arva_hil.search.team.team import Bus, Near, TeamField, Teammate, divide, kept_apart, strips_of
from arva_hil.search.team.team_tunnel import TEAM_TYPE, HeardAt, News, TeamTunnel, encode
from arva_hil.search.team.team_tunnel import parse as read
from arva_hil.simulated.autopilot import Mode
from arva_hil.simulated.closed_loop import ClosedLoop, Drone, several
from firmware_proto import Channel, Decoder, Frame
from tests.every import every

HOME = (46.0, 7.0, 1000.0)
FRAME = LocalFrame(*HOME)
WIDE = TeamField((-100.0, -100.0, 100.0, 100.0), FRAME, 2)
TWO = "spec: 2\ntransmitters: [{id: 1, ned: [-2, -2, 0.5]}, {id: 2, ned: [2, 2, 1]}]"  # nearer than two may fly


def at(north: float, east: float, up: float) -> tuple[float, float, float]:
    lat, lon, alt = (float(value) for value in FRAME.lla([north, east, -up]))
    return lat, lon, alt


def told(number: int, *, hunting: int | None = None, found: tuple[int, ...] = (), hunting_m: float = 30.0) -> News:
    return News(number, 0.0, at(0, 0, 3), True, hunting, found, hunting_m=hunting_m)


def alone(number: int, now: float = 0.0) -> Teammate:
    mate = Teammate(number, lambda news: None, WIDE)
    mate.report(now, HOME, flying=True)
    return mate


def planned() -> Teammate:
    mate = alone(1)
    mate.plan(SearchPlan(STRATEGIES["flux"]), FRAME)
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
    mate = planned()
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
    bus = Bus(WIDE)
    mates = [bus.join() for _ in range(3)]
    heard: list[News] = []
    mates[2].on_news = heard.append  # type: ignore[method-assign]
    for tick in range(100):
        mates[0].report(tick / 100, HOME, flying=True, hunting=7 if tick == 50 else None)
    assert 5 <= len(heard) <= 8
    assert [news.hunting for news in heard].count(7) == 1


def test_a_report_leaves_in_each_step_of_a_search_though_a_step_may_come_early() -> None:
    told: list[News] = []
    mate = Teammate(0, told.append, WIDE)
    for step in range(50):
        mate.report(0.2 * step - 0.01 * (step % 2), HOME, flying=True)
    assert len(told) == 50


def test_what_turns_out_not_sure_after_all_is_free_again() -> None:
    bus = Bus(WIDE)
    finder, other = bus.join(), bus.join()
    finder.report(0.0, HOME, flying=True, found=(7,), searching=False)
    assert other.taken(7, own=False)
    finder.report(20.0, HOME, flying=True, searching=False)  # the readings near the ground contradict the place
    assert not other.taken(7, own=False)


@every(
    "other, flying, wanted, allowed",
    [
        ((5, 0, 3), True, (1, 0.5, 0), (0, 0.5, 0)),  # not nearer, but past it
        ((5, 0, 3), True, (-1, 0, 0), (-1, 0, 0)),  # away from it
        ((5, 0, 6), True, (1, 0, 0), (1, 0, 0)),  # below it
        ((7, 0, 3), True, (1, 0, 0), (1, 0, 0)),  # far enough
        ((2, 0, 0), True, (0, 0, 0.5), (0, 0, 0)),  # not down onto it
        ((2, 0, 0), False, (0, 0, 0.5), (0, 0, 0)),  # nor where it has landed
        ((2, 0, 0), False, (1, 0, 0), (1, 0, 0)),  # but over it,
        ((2, 0, -2), False, (0, 0, 0.5), (0, 0, 0.5)),  # and down to 4 m above it
        ((5, 0, 3), True, (0, 0, -0.5), (0, 0, -0.5)),  # up is always free
    ],
)
def test_no_velocity_leads_to_another_vehicle(
    other: tuple[float, float, float],
    flying: bool,
    wanted: tuple[float, float, float],
    allowed: tuple[float, float, float],
) -> None:
    mate = planned()
    mate.on_news(News(2, 0.0, at(*other), flying, part=2))
    assert mate.apart((0.0, 0.0, -3.0), wanted, 1.2) == pytest.approx(allowed, abs=1e-3)


@every(
    "other, pushed",
    [
        (News(0, 0.0, at(5, 0, 3), True, hunting=7, hunting_m=20.0), True),  # the lower number
        (News(2, 0.0, at(5, 0, 3), True, hunting=7, hunting_m=20.0), False),
        (News(2, 0.0, at(5, 0, 3), True, hunting=7, hunting_m=19.0), True),  # nearer to its transmitter
        (News(0, 0.0, at(5, 0, 3), True, hunting=7, hunting_m=21.0), False),
        (News(0, 0.0, at(5, 0, 3), True, free=True), False),  # it only waits,
        (News(0, 0.0, at(4, 0, 3), True, free=True), True),  # but may not know where the other is
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
    mate = planned()
    mate.report(0.0, HOME, flying=True, hunting=8, hunting_m=20.0)
    mate.on_news(other)
    north, _, _ = mate.apart((0.0, 0.0, -3.0), (0.0, 0.0, 0.0), 1.2)
    assert north == pytest.approx(-1.2 if pushed else 0.0, abs=1e-3)


@every(
    "others, height, wanted",
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


def test_the_upper_one_does_not_come_down_to_one_that_it_has_never_had_news_of() -> None:
    mate = one()
    plan = mate.layered(SearchPlan(STRATEGIES["flux"]))
    for number, wanted in ((0, 6.0), (2, 3.0)):
        mate.on_news(News(number, 0.0, at(9, 0, 0), False))
        assert mate.height(plan.height, 6.0, (0.0, 0.0, -6.0)) == pytest.approx(wanted)


def test_it_flies_on_down_a_slope_past_one_that_has_landed() -> None:
    """It may not descend there, and so gets higher than wanted."""
    mate = planned()
    mate.report(0.0, at(0, 0, 3), flying=True)
    mate.on_news(News(0, 0.0, at(0, 1, 0), False))
    keeper, north, above = ground.HeightKeeper(3.0, lambda event: None), 0.0, 3.0
    for tick in range(200):
        clear, position = above + 0.36 * north, (north, 0.0, -above)
        keeper.asked = mate.height(3.0, clear, position)
        down = keeper.velocity(0.2 * tick, Height(clear, True))
        ahead, _, down = mate.apart(position, (keeper.pace, 0.0, down), 1.0)
        north, above = north + 0.2 * ahead, above - 0.2 * down
    assert north > 30.0
    assert clear == pytest.approx(3.36, abs=0.1)


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


@pytest.mark.parametrize("speed", [1.0, 3.0, 10.0])
def test_two_that_fly_to_each_other_stop_in_time_however_fast(speed: float) -> None:
    """A vehicle without a body that brakes with 2 m/s²."""
    bus = Bus(WIDE)
    team, places, moving = [bus.join(), bus.join()], [-60.0, 60.0], [speed, -speed]
    for mate in team:
        mate.plan(SearchPlan(STRATEGIES["flux"], speed=speed), FRAME)
    nearest = math.inf
    for tick in range(round(600 / speed)):
        for n, mate in enumerate(team):
            mate.report(0.2 * tick, at(places[n], 0, 3), flying=True, hunting=n, hunting_m=9.0)
        for n, mate in enumerate(team):
            wanted, _, _ = mate.apart((places[n], 0.0, -3.0), ((-1) ** n * speed, 0.0, 0.0), speed)
            moving[n] += max(-0.4, min(wanted - moving[n], 0.4))
            places[n] += 0.2 * moving[n]
        nearest = min(nearest, places[1] - places[0])
    assert 5.0 < nearest < 9.0


@pytest.mark.parametrize("deaf", [0, 1])
def test_one_that_receives_nothing_of_another_is_evaded_by_it_whoever_goes_first(deaf: int) -> None:
    bus = Bus(WIDE)
    team, places = [bus.join(), bus.join()], [0.0, 20.0]
    for mate in team:
        mate.plan(SearchPlan(STRATEGIES["flux"]), FRAME)
    team[deaf].on_news = lambda news: None  # type: ignore[method-assign]
    nearest = math.inf
    for tick in range(300):
        for n, mate in enumerate(team):
            mate.report(0.2 * tick, at(places[n], 0, 3), flying=True, hunting=n, hunting_m=9.0)
        for n, mate in enumerate(team):
            wanted = (1.0 - 2.0 * deaf) * (n == deaf)
            places[n] += 0.2 * mate.apart((places[n], 0.0, -3.0), (wanted, 0.0, 0.0), 1.0)[0]
        nearest = min(nearest, abs(places[1] - places[0]))
    assert nearest > 4.0


@pytest.mark.parametrize("apart_m", [0.5, 4.0])
def test_places_close_together_are_all_reached_and_nobody_lands_near_another(apart_m: float) -> None:
    bus = Bus(WIDE)
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
    mission = Mission(plan, 0.0, (0.0, 0.0, -6.0), team=mate)
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


@every(
    "other, under",
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
    mate = Teammate(1, lambda news: None, WIDE)
    assert not mate.under_another
    mate.report(0.0, HOME, flying=False)
    mate.on_news(other)
    assert mate.under_another == under


@pytest.mark.parametrize(("until_s", "flies"), [(10.0, True), (200.0, False)])
def test_who_takes_off_late_waits_until_nobody_is_above(until_s: float, flies: bool) -> None:
    """The first one hovers above the second one's place until then; the second one waits 15 s."""
    clock, plan = StepClock(), SearchPlan(STRATEGIES["flux"], area=(-20, -20, 20, 20), timeout_s=15.0)
    loop = ClosedLoop(several(parse(TWO, "test"), 2), plan, start=0.0, stream_hz=10.0)
    first, second = loop.drones
    lat, lon, alt = second.vehicle.truth(0.0).lla
    flying: list[float] = []

    def over() -> bool:
        now = clock.now()
        second.search._flight._team.on_news(News(0, now, (lat + (now > until_s) * 1e-3, lon, alt + 5.0), True, part=0))
        if second.vehicle.flying:
            flying.append(now)
        return bool(flying) or second.search.outcome is not None

    run([task for task in loop.tasks if task is not first.search], clock, until=150.0, stopped=over)
    if flies:
        assert until_s < flying[0] < until_s + 10.0
    else:
        assert not flying
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


@pytest.fixture(scope="module")
def field() -> Field:
    return Field("estimate", pilot_of=1, pilot_s=20.0)


def test_a_team_finds_every_transmitter_once_and_its_vehicles_keep_apart(field: Field) -> None:
    missions = [drone.search.mission for drone in field.loop.drones]
    ids = [mission.choice.target for mission in missions if mission and mission.found is not None]
    assert sorted(ids, key=str) == [1, 2]
    assert field.loop.found == {1, 2}
    assert all(error is None or error < 0.5 for error in (drone.error() for drone in field.loop.drones))
    assert field.gap_m > 4.5
    assert not field.early
    for drone in field.loop.drones:  # nobody commands another's
        orders = [message for _, message in field.orders[drone.name] if not hasattr(message, "payload")]  # no TUNNEL
        assert {message.target_system for message in orders} == {drone.vehicle.system}  # type: ignore[attr-defined]


def test_the_pilot_of_one_drone_takes_over_that_one_and_no_other(field: Field) -> None:
    drones = field.loop.drones
    mine = drones[1].search.outcome
    assert "LOITER" in in_words(mine.how)
    assert drones[1].vehicle.state.startswith("LOITER, armed")
    moves = [
        at
        for at, message in field.orders[drones[1].name]
        if type(message).__name__.startswith("MAVLink_set_position_target") and at > 21.0
    ]
    assert not moves
    for other in (drones[0], drones[2]):
        assert other.search.outcome.kind in ("found", "not found")


# A member of a team whose news are wrong: the others end in time, say what is so, and fly to nobody's place


FIELD = TeamField((-20.0, -30.0, 20.0, 30.0), FRAME, 3)
TWO_APART = """
spec: 2
datum: {lat: 46.0, lon: 7.0, alt: 1000.0}
transmitters: [{id: 1, ned: [9, -11, 0.5]}, {id: 2, ned: [-8, 3, 1]}]
"""
LIMIT_S, BEGINS_S = 15.0, 14.0  # of the search; of the lies, after the take-off
LANDING_S = 125.0  # three descents from 6 m, 35 s each, and the landing itself

Place = NDArray[np.float64]  # NED
Lie = Callable[[float, Place], News]


def beside(place: Place, north: float, east: float, down: float) -> tuple[float, float, float]:
    return at(place[0] + north, place[1] + east, -place[2] - down)


def everywhere(now: float, place: Place) -> News:
    there = beside(place, 9 * math.sin(7 * now), 9 * math.cos(11 * now), 4 * math.sin(13 * now))
    tick = int(now * 5)
    states = {"part": tick % 3, "free": tick % 2 == 0, "lost": tick % 5 == 0, "hunting": tick % 3, "hunting_m": 0.0}
    return replace(News(2, now, there, tick % 4 > 0), **states)  # type: ignore[arg-type]


LIES: dict[str, Lie] = {
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
        self.loop = ClosedLoop(several(parse(TWO_APART, "field"), 3), plan, start=0.0, stream_hz=10.0)
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
def test_beside_a_liar_two_searches_end_and_keep_off_the_ground_and_each_other(
    monkeypatch: pytest.MonkeyPatch, lie: str
) -> None:
    monkeypatch.setattr(ground, "_LIMIT_S", 5.0)  # of a descent; else the flight is twice as long
    lied = Lied(LIES[lie])
    for outcome, drone in zip(lied.outcomes, lied.flown, strict=True):
        assert outcome.kind in ("found", "not sure", "not found", "failed")
        error_m = drone.error()
        assert outcome.kind != "found" or (error_m is not None and error_m < 1.5)
        hovers = "hovers, because another vehicle of the team reports that it is below" in in_words(outcome.how)
        assert drone.vehicle.flying == hovers, in_words(outcome.how)
    assert lied.gap_m > 2.5
    assert lied.lowest > 0.5
    assert (lied.outside_m > 5.0) == (lie == "lost over it")  # it is driven off
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


@every("east, wanted, made", [(45.0, 0.0, True), (55.0, 0.0, False), (55.0, 0.5, True)])
def test_nobody_drives_it_far_out_of_the_area(east: float, wanted: float, made: bool) -> None:
    mate = member()
    mate.on_news(News(2, 0.0, at(0, east - 3, 3), True, hunting=7, hunting_m=1.0))
    velocity = mate.apart((0.0, east, -3.0), (0.0, wanted, 0.0), 1.0)
    assert velocity == pytest.approx((0.0, 1.0 if made else 0.0, 0.0), abs=0.01)


@pytest.mark.parametrize(("below", "descends"), [(7.9, False), (8.1, True)])
def test_it_descends_onto_no_vehicle_that_is_less_than_eight_metres_below(below: float, descends: bool) -> None:
    mate = member()
    mate.on_news(News(2, 0.0, at(0, 3, 20.0 - below), True))
    assert (mate.apart((0.0, 0.0, -20.0), (0.0, 0.0, 0.5), 1.0)[2] > 0) == descends


@every("way", [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_beyond_every_side_of_the_area_it_flies_along_the_side_only(way: tuple[int, int]) -> None:
    """Another one drives it out, and it wants along the side."""
    north, east = way
    mate = member()
    mate.on_news(News(2, 0.0, at(52 * north, 52 * east, 3), True, hunting=7, hunting_m=1.0))
    wanted = 0.3 * east, 0.3 * north, 0.0
    assert mate.apart((55.0 * north, 55.0 * east, -3.0), wanted, 1.0) == pytest.approx(wanted, abs=0.01)


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


@every(
    "age_s, other, speed, wanted, allowed",
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
    mission = Mission(SearchPlan(STRATEGIES["flux"], limit_s=1.0), 9.0, place, team=mate)
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
    mate.others.skip(10.0, 10.0)
    mate.report(10.0, HOME, flying=True)
    assert (mate.taken(7, own=False), mate.lost) == (True, {})
    mate.report(15.2, HOME, flying=True)
    assert (mate.taken(7, own=False), list(mate.lost)) == (False, [2])


def test_after_a_pause_of_its_own_program_one_that_was_lost_before_is_still_lost() -> None:
    mate = one(60.0)
    mate.on_news(News(2, 0.0, at(8, 0, 12), True, part=2, hunting=7))
    mate.others.skip(62.0, 2.0)
    mate.report(62.0, HOME, flying=True)
    assert (mate.taken(7, own=False), list(mate.lost)) == (False, [2])
    assert mate.apart((0.0, 0.0, -3.0), (1.0, 0.0, 0.0), 1.0)[0] < 0.0
    mate.on_news(News(0, 62.0, at(20, 0, 3), True, part=0))
    mate.others.skip(62.5, 2.0)  # the news came in the pause
    mate.report(68.0, HOME, flying=True)
    assert sorted(mate.lost) == [0, 2]


def test_the_others_know_that_one_lands_though_its_mission_has_not_ended() -> None:
    plan = SearchPlan(STRATEGIES["flux"], area=(-30.0, -30.0, 30.0, 30.0))
    scenario = several(parse("spec: 2\ntransmitters: [{id: 1, ned: [-25, 25, 1]}]", "field"), 2)
    loop = ClosedLoop(scenario, plan, start=0.0, stream_hz=10.0)
    watching, landing = loop.drones
    mate = watching.search._flight._team
    assert mate is not None
    clock = StepClock()
    run(loop.tasks, clock, until=60.0, stopped=lambda: landing.search._commander.phase.name == "FLYING")
    assert not mate.others.newest[1].ended
    landing.search._commander.land(clock.now(), because(Why.NOT_FOLLOWED))
    run(loop.tasks, clock, until=clock.now() + 1.0)
    news = mate.others.newest[1]
    assert (landing.search._commander.phase.name, news.flying, news.ended) == ("LANDING", True, True)
    landing.search.stop()
    run(loop.tasks, clock, until=clock.now() + 2.0)
    assert clock.now() - mate.others.newest[1].time_s < 0.5


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
        news = mate.others.newest[loop.drones.index(drone)]
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


# News of searches in MAVLink TUNNEL messages: of the chosen systems, in order and in time; else nothing changes


SYSTEMS = (11, 12, 13)
HEARD = (HeardAt(3, 12.34, 46.0124, 7.7455), HeardAt(0, 64.0, 46.0121, 7.7459))
NEWS = News(1, 5.0, (46.0123, 7.7456, 1650.25), True, 7, (0, 9, 254), 2, (0, 1), 21.5, False, HEARD, True)


def packet(message: Any, system: int = 12, component: int = COMPONENT) -> Packet:
    (one,) = Parser().feed(Encoder(system, component).pack(message))
    return one


def sent(news: News) -> Any:
    tunnel = TeamTunnel(SYSTEMS, COMPONENT)
    tunnel.send(news)
    (message,) = tunnel.poll()
    assert tunnel.poll() == []
    return message


def test_news_are_read_as_they_were_told_on_the_own_clock() -> None:
    heard = TeamTunnel(SYSTEMS, COMPONENT).on_packet(packet(sent(NEWS)), 90.0)
    assert heard == replace(NEWS, time_s=90.0)
    least = News(2, 0.0, (-90.0, 180.0, -10.0), False)
    assert TeamTunnel(SYSTEMS, COMPONENT).on_packet(packet(sent(least), 13), 1.0) == replace(least, time_s=1.0)
    free = replace(NEWS, part=None, hunting=None, hunting_m=math.inf, free=True)
    assert read(encode(free), 3) == free
    assert len(encode(replace(NEWS, found=tuple(range(40)), heard=HEARD * 20))) <= 128


def test_only_the_newest_news_wait_to_be_sent() -> None:
    tunnel = TeamTunnel(SYSTEMS, COMPONENT)
    for second in range(5):
        tunnel.send(replace(NEWS, time_s=float(second)))
    assert [read(untunnel(message), 3) for message in tunnel.poll()] == [replace(NEWS, time_s=4.0)]


@every(
    "system, component, changes",
    [
        (99, COMPONENT, {}),  # a stranger
        (12, 1, {}),  # not from a search
        (13, COMPONENT, {}),  # in another one's name
        (12, COMPONENT, {"payload_type": TEAM_TYPE - 1}),
        (12, COMPONENT, {"payload_length": 20}),
        (12, COMPONENT, {"payload_length": 128}),
    ],
)
def test_all_else_changes_nothing(system: int, component: int, changes: dict[str, int]) -> None:
    message = sent(NEWS)
    for name, value in changes.items():
        setattr(message, name, value)
    assert TeamTunnel(SYSTEMS, COMPONENT).on_packet(packet(message, system, component), 1.0) is None
    heartbeat = dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)
    assert TeamTunnel(SYSTEMS, COMPONENT).on_packet(packet(heartbeat), 1.0) is None


@every("version", [0, 1, 255])
def test_another_version_is_not_guessed_at(version: int) -> None:
    assert read(bytes([version]) + encode(NEWS)[1:], 3) is None


@given(st.binary(max_size=128), st.integers(1, 64))
def test_any_payload_is_news_of_a_member_or_nothing(payload: bytes, members: int) -> None:
    for data in (payload, b"\x02" + payload):
        if news := read(data, members):
            assert news.number < members
            assert news.part is None or news.part < members
            assert set(news.flown) <= set(range(members))
            assert len(news.found) <= 16
            assert len(news.heard) <= 7
            assert encode(news) == data


def test_what_is_repeated_overtaken_or_long_on_the_way_is_dropped() -> None:
    tunnel = TeamTunnel(SYSTEMS, COMPONENT)

    def heard(sent_s: float, now: float) -> bool:
        return tunnel.on_packet(packet(sent(replace(NEWS, time_s=sent_s))), now) is not None

    assert heard(100.0, 10.0)
    assert not heard(100.0, 10.1)  # again
    assert heard(101.0, 11.5)
    assert not heard(100.5, 11.6)  # overtaken
    assert not heard(102.0, 14.5)  # 2.5 s later than the quickest
    assert heard(104.0, 14.6)
    assert not heard(1.0, 16.0)
    assert heard(2.0, 20.0)  # begun anew after a silence
    assert tunnel.dropped == 4


def test_a_search_tells_and_hears_over_its_autopilots_link_and_believes_no_stranger() -> None:
    far, near = memory.pair()
    tunnel = TeamTunnel(SYSTEMS, COMPONENT)
    mate = Teammate(0, tunnel.send, TeamField((-9.0, -9.0, 9.0, 9.0), LocalFrame(*simulated.HOME), 3))
    session = Session(target_system=11, component=COMPONENT)
    search = SearchClient(
        SearchPlan(STRATEGIES["flux"]), session, near, memory.pair()[0], Decoder(), start=0.0, team=mate, tunnel=tunnel
    )
    clock = StepClock()
    mate.report(0.0, simulated.HOME, flying=True)
    far.write(Encoder(11, 1).pack(dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)))
    for system, id_ in ((12, 7), (99, 8)):
        far.write(Encoder(system, COMPONENT).pack(sent(replace(NEWS, found=(id_,)))))
    search.service(clock)
    assert mate.taken(7, own=False)
    assert not mate.taken(8, own=False)
    (told,) = [one for one in Parser().feed(far.read()) if one.msgid == dialect.MAVLINK_MSG_ID_TUNNEL]
    assert (told.system, told.component) == (11, COMPONENT)
    told_news = TeamTunnel(SYSTEMS, COMPONENT).on_packet(told, 0.0)
    assert (told_news.number, told_news.part) == (0, 0)
