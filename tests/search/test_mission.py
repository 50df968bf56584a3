"""A search from the end of the take-off on: whom it goes for, its strips, what it believes of the receiver, its end."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.events import Event
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import (
    PlaceDoubted,
    PlaceFound,
    ReceiverGone,
    ReceiverTurned,
    SearchPaused,
    SearchResumed,
    TooLow,
    TransmitterChosen,
    TransmitterFaded,
    TransmitterHeard,
    TransmitterMoves,
)
from arva_hil.events.words.reasons import in_words
from arva_hil.links import memory
from arva_hil.model.field import LocalFrame, dipole_field, rotation
from arva_hil.search.flight.links import NewFrames, ReceiverLink
from arva_hil.search.mission.choice import NO_ID, StuckReadings, observations, pulses
from arva_hil.search.mission.ground import Height
from arva_hil.search.mission.mission import Mission
from arva_hil.search.mission.outcome import conclusion
from arva_hil.search.strategies.analysis import TransmitterReadings
from arva_hil.search.strategies.estimate import Estimate
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import STILL, Found, Observation, Position, Strategy, Velocity, towards
from arva_hil.search.strategies.strips import Area, Strips
from arva_hil.search.team.team import TeamField, Teammate
from arva_hil.search.team.team_tunnel import News
from firmware_proto import (
    INNER,
    MID,
    Channel,
    Decoder,
    Frame,
    LevelChannel,
    Measured,
    TextDecoder,
    VectorChannel,
    encode,
    encode_nmea,
)
from firmware_proto.measured import VECTOR
from tests.every import every

FOUND = in_words(because(Why.FOUND))
NOT_SURE = in_words(because(Why.NOT_SURE))

LEVEL = np.eye(3)
AT: Position = (3.0, 4.0, -1.0)
NORTH: Velocity = (0.5, 0.0)


class Scripted:
    """A strategy that remembers what it was told and says what a test wants. `made`: all of a test, in order."""

    made: list[Scripted]
    says: Any = NORTH
    finds: Found | None = None

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self.heard: list[Observation] = []
        self.made.append(self)

    @property
    def found(self) -> Found | None:
        return self.finds

    def observe(self, observation: Observation) -> None:
        self.heard.append(observation)

    def velocity(self, time_s: float, position: Position) -> Velocity:
        return self.says


@pytest.fixture
def believed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Any place agrees with the readings: of a few from one place none can be told."""
    monkeypatch.setattr(TransmitterReadings, "judged", lambda self, found, height_m: (found, True))


@pytest.fixture
def strategy() -> type[Scripted]:
    return type("Fresh", (Scripted,), {"made": []})


def mission(strategy: Callable[[float], Any], **options: Any) -> Told:
    return Told(SearchPlan(strategy, **({"height": 1.0} | options)), 100.0, (0.0, 0.0, -2.0))


@pytest.fixture
def m(strategy: type[Scripted]) -> Told:
    return mission(strategy)


def frame(*channels: Channel) -> Frame:
    return Frame(0, 1, channels or (Channel(),))


def beacon(id_: int | None, d_m: float, delta: int = 0, zone: int = MID) -> Channel:
    return Channel(id_, zone, round(d_m * 100), delta)


class Told(Mission):
    """One whose news are kept until they are taken."""

    def __init__(self, *given: Any, **options: Any) -> None:
        self.events: list[Event] = []
        super().__init__(*given, **options, emit=self.events.append)

    def news(self) -> list[Event]:
        events = self.events.copy()
        self.events.clear()
        return events


def heard(mission: Mission, *channels: Channel, at_s: float, position: Position = AT) -> Velocity:
    """A frame, and what is then flown, horizontally."""
    mission.on_frame(frame(*channels), at_s, position, LEVEL)
    north, east, _ = mission.fly(at_s, position)
    return north, east


# -- before the first signal -------------------------------------------------------------------------------


def test_a_strategy_may_have_hear_in_place_of_observe() -> None:
    class Old(Strategy):
        found = None

        def __init__(self, speed: float) -> None: ...

        def hear(self, observation: Observation) -> None:
            heard.append(observation.d_cm)

        def velocity(self, time_s: float, position: Position) -> Velocity:
            return NORTH

    heard: list[int] = []
    Mission(SearchPlan(Old), 100.0, AT).on_frame(frame(beacon(7, 12.34)), 101.0, AT, LEVEL)
    assert heard == [1234]


def test_strips_are_flown_until_something_is_heard(strategy: type[Scripted]) -> None:
    m = mission(strategy, area=(-50, -50, 50, 50))
    north, east = heard(m, at_s=101.0, position=(0.0, 0.0, -2.0))
    assert math.hypot(north, east) == pytest.approx(1.0)
    assert not m.choice.hunting
    assert heard(m, beacon(5, 30), at_s=102.0) == NORTH
    assert m.choice.hunting
    assert m.choice.target == 5
    assert [made.speed for made in strategy.made] == [1.0]


def test_the_end_of_the_strips_is_the_end_and_says_so(strategy: type[Scripted]) -> None:
    m = mission(strategy, area=(0, 0, 20, 10), strip_width=10)
    position, now = (0.0, 0.0, -1.0), 100.0
    while not m.ended:
        now += 0.5
        north, east = heard(m, at_s=now, position=position)
        position = position[0] + north * 0.5, position[1] + east * 0.5, -1.0
        assert now < 200
    assert (in_words(m.ended), m.broken, m.found) == ("no signal: all strips are flown", False, None)
    assert m.progress.path_m == pytest.approx(25, abs=3)
    assert m.progress.searched_s == pytest.approx(now - 100)
    assert heard(m, at_s=now + 1, position=position) == STILL


def test_a_transmitter_that_moves_is_passed_by_and_looked_at_once_more_at_the_end(strategy: type[Scripted]) -> None:
    """It may be a victim whose readings were taken for a walk."""
    strategy.track = ((90.0, 0.0, 0.0), (110.0, 15.0, 5.0))  # type: ignore[attr-defined]
    m = mission(strategy, area=(0, 0, 20, 10), strip_width=10)
    position, now, moved = (0.0, 0.0, -1.0), 100.0, list[int | None]()
    while not m.ended:
        now += 0.5
        north, east = heard(m, beacon(1, 20 + now % 7), at_s=now, position=position)
        position = position[0] + north * 0.5, position[1] + east * 0.5, -1.0
        moved += [event.transmitter for event in m.news() if isinstance(event, TransmitterMoves)]
        assert now < 300
    assert moved == [1, 1]
    assert m.found is None
    assert m.victims.aside.moving == {1: strategy.track}  # type: ignore[attr-defined]
    assert not m.others


# -- the last look ------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("believed")
def test_a_place_that_the_newest_readings_contradict_is_looked_for_again_and_in_the_end_not_sure(
    m: Told, strategy: type[Scripted], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(TransmitterReadings, "contradictions", lambda self, time_s: [True] * 9)
    for n in range(3):
        assert not m.ended
        strategy.finds = Found(2.0 * n, 4.0)
        heard(m, beacon(5, 30 + n), at_s=101.0 + n, position=(2.0 * n, 4.0, -1.0))
        assert len(strategy.made) == n + 1
    assert (in_words(m.ended), m.sure, m.found) == (NOT_SURE, False, strategy.finds)
    doubted = [event for event in m.news() if isinstance(event, PlaceDoubted)]
    assert [(event.transmitter, event.north_m, event.east_m) for event in doubted] == [(5, 0.0, 4.0), (5, 2.0, 4.0)]


@pytest.mark.usefixtures("believed")
def test_a_place_that_is_found_again_is_believed_whatever_the_readings_there(
    m: Told, strategy: type[Scripted], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An antenna that is saturated there says nothing of it."""
    monkeypatch.setattr(TransmitterReadings, "contradictions", lambda self, time_s: [True] * 9)
    strategy.finds = Found(*AT[:2])
    heard(m, beacon(5, 30), at_s=101.0)
    assert not m.ended
    heard(m, beacon(5, 30), at_s=102.0)
    assert (in_words(m.ended), m.sure, len(strategy.made)) == (FOUND, True, 2)


@pytest.mark.usefixtures("believed")
def test_while_only_the_last_readings_contradict_a_place_it_listens(
    m: Told, strategy: type[Scripted], monkeypatch: pytest.MonkeyPatch
) -> None:
    said = [[False] * 5 + [True], [False] * 4 + [True] * 2, [False] * 3 + [True] * 2 + [False]]
    monkeypatch.setattr(TransmitterReadings, "contradictions", lambda self, time_s: said.pop(0))
    strategy.finds = Found(*AT[:2])
    assert heard(m, beacon(5, 30), at_s=101.0) == heard(m, beacon(5, 30), at_s=101.1) == STILL
    assert not m.ended
    heard(m, beacon(5, 30), at_s=101.2)
    assert (in_words(m.ended), m.sure, len(strategy.made)) == (FOUND, True, 1)


@pytest.mark.usefixtures("believed")
def test_what_is_heard_near_the_ground_may_contradict_the_place_where_it_has_landed(
    m: Told, strategy: type[Scripted], monkeypatch: pytest.MonkeyPatch
) -> None:
    strategy.finds = Found(*AT[:2])
    heard(m, beacon(5, 30), at_s=101.0)
    assert in_words(m.ended) == FOUND
    monkeypatch.setattr(TransmitterReadings, "contradictions", lambda self, time_s: [True] * 9)
    m.confirm(120.0)
    assert (in_words(m.ended), m.sure, m.found) == (NOT_SURE, False, strategy.finds)
    assert conclusion(m)[0] == "not sure"


# -- whom it goes for --------------------------------------------------------------------------------------


def test_a_strategy_is_told_what_the_frames_say_of_its_transmitter_and_where(m: Told, strategy: type[Scripted]) -> None:
    turned = np.diag([1.0, -1.0, -1.0])
    m.on_frame(frame(beacon(7, 12.34, -15), beacon(3, 40)), 101.0, AT, turned)
    m.on_frame(frame(beacon(7, 2.5, 3, INNER), beacon(3, 40)), 102.0, (1.0, 2.0, 3.0), LEVEL)
    m.on_frame(frame(beacon(3, 40)), 103.0, AT, LEVEL)
    (only,) = strategy.made
    assert only.heard == [
        Observation(101.0, AT, turned, 1234, -15, False),
        Observation(102.0, (1.0, 2.0, 3.0), LEVEL, 250, 3, True),
        Observation(103.0, AT, LEVEL, -1, -1, False),
    ]
    assert [o.heard for o in only.heard] == [True, True, False]


def test_it_goes_for_the_nearest_and_not_for_another_at_each_whim(m: Told, strategy: type[Scripted]) -> None:
    heard(m, beacon(1, 30), beacon(2, 20), at_s=101.0)
    assert m.choice.target == 2
    heard(m, beacon(1, 15), beacon(2, 20), at_s=102.0)
    assert m.choice.target == 2
    heard(m, beacon(1, 13), beacon(2, 20), at_s=103.0)
    heard(m, beacon(1, 13), beacon(2, 15), at_s=103.9)
    heard(m, beacon(1, 13), beacon(2, 20), at_s=104.8)
    assert m.choice.target == 2  # it was farther only for a moment, as near a dead antenna
    heard(m, beacon(1, 13), beacon(2, 20), at_s=105.8)
    assert m.choice.target == 1
    heard(m, beacon(1, 13), beacon(2, 10), at_s=106.0)
    assert m.choice.target == 1
    assert len(strategy.made) == 2
    heard_2, heard_1, *chosen = m.news()
    assert isinstance(heard_1, TransmitterHeard)
    assert isinstance(heard_2, TransmitterHeard)
    assert (heard_1.transmitter, heard_1.distance_m, heard_1.north_m, heard_1.east_m) == (1, 30.0, 3.0, 4.0)
    assert (heard_2.transmitter, heard_2.distance_m) == (2, 20.0)
    choices = [(event.transmitter, event.distance_m) for event in chosen if isinstance(event, TransmitterChosen)]
    assert choices == [(2, 20.0), (1, 13.0)]


def test_a_new_strategy_is_told_all_that_was_heard_of_its_transmitter(m: Told, strategy: type[Scripted]) -> None:
    for n, d in enumerate([40, 30, 20, 10]):
        heard(m, beacon(1, 35), beacon(2, d), at_s=101.0 + n)
    first, second = strategy.made
    assert [o.d_cm for o in first.heard] == [3500, 3500, 3500]
    assert [o.d_cm for o in second.heard] == [4000, 3000, 2000, 1000]


def test_no_more_is_remembered_than_has_to_be(m: Told) -> None:
    for n in range(1000):
        heard(m, *(beacon((n + k) % 250, 20) for k in range(4)), at_s=101.0 + n)
    assert len(m.choice.heard) == 16
    record = TransmitterReadings()
    for n in range(1000):
        record.add(Observation(n, AT, LEVEL, 2000, 0, False))
    assert len(record.past) == 256


def test_of_too_many_transmitters_the_one_that_is_silent_for_longest_is_forgotten(m: Told) -> None:
    """As with a receiver that gives each signal that comes back a new id."""
    for n in range(16):
        heard(m, beacon(n, 40 - n), at_s=101.0 + n)
    heard(m, beacon(99, 9), at_s=150.0)
    assert 99 not in m.choice.heard  # all were received within a minute
    heard(m, beacon(99, 9), at_s=162.0)
    assert 99 in m.choice.heard
    assert sorted(m.choice.heard)[:2] == [1, 2]


def test_of_the_silent_ones_those_to_pass_by_are_forgotten_first(m: Told) -> None:
    for n in range(16):
        heard(m, beacon(n, 40 - n), at_s=101.0 + n)
    m.victims.known[2] = 0  # found
    heard(m, beacon(99, 9), at_s=170.0)
    assert sorted(m.choice.heard)[:3] == [0, 1, 3]
    assert 99 in m.choice.heard


def test_frames_without_numbers_are_of_one_transmitter_the_nearest(m: Told, strategy: type[Scripted]) -> None:
    heard(m, beacon(None, 9, 10), beacon(None, 30, 20), at_s=101.0)
    heard(m, beacon(None, 31, 20), beacon(None, 8, 11), at_s=102.0)
    assert m.choice.target == NO_ID
    assert [(o.d_cm, o.delta_deg) for o in strategy.made[0].heard] == [(900, 10), (800, 11)]
    chosen = [event for event in m.news() if isinstance(event, TransmitterChosen)]
    assert [(event.transmitter, event.distance_m) for event in chosen][-1:] == [(None, 9.0)]


def test_two_frames_at_once_are_two(m: Told, strategy: type[Scripted]) -> None:
    m.on_frame(frame(beacon(1, 20)), 101.0, AT, LEVEL)
    m.on_frame(frame(beacon(2, 40)), 101.0, AT, LEVEL)
    assert [o.d_cm for o in strategy.made[0].heard] == [2000, -1]


def test_a_transmitter_that_is_heard_no_more_is_looked_for_in_strips(strategy: type[Scripted]) -> None:
    m = mission(strategy, limit_s=1e9)
    heard(m, beacon(1, 20), at_s=101.0)
    for now in range(102, 162):
        assert heard(m, at_s=float(now)) == NORTH
    assert heard(m, at_s=162.0) != NORTH
    assert not m.choice.hunting
    assert [event.transmitter for event in m.news() if isinstance(event, TransmitterFaded)] == [1]
    assert heard(m, beacon(2, 50), at_s=163.0) == NORTH
    assert m.choice.target == 2


def test_a_transmitter_that_is_hardly_heard_is_put_off_until_it_is_nearer(strategy: type[Scripted]) -> None:
    m = mission(strategy, limit_s=1e9)
    heard(m, beacon(1, 69), at_s=101.0)
    for now in range(102, 142):  # at the limit of the range, in one frame of eight
        heard(m, *([beacon(1, 63)] if now % 8 == 0 else []), at_s=float(now))
    assert not m.choice.hunting
    assert [(event.transmitter, event.hardly) for event in m.news() if isinstance(event, TransmitterFaded)] == [
        (1, True)
    ]
    assert heard(m, beacon(1, 62), at_s=142.0) != NORTH
    assert heard(m, beacon(1, 50), at_s=143.0) == NORTH
    for now in range(144, 300):  # in each second frame it is flown to
        heard(m, *([beacon(1, 50)] if now % 2 else []), at_s=float(now))
    assert m.choice.hunting
    for now in range(300, 352):  # silent for a while, it is as near as it was
        heard(m, *([beacon(1, 50)] if now in (320, 351) else []), at_s=float(now))
    assert not m.choice.hunting
    for now in range(352, 357):
        heard(m, beacon(1, 50), at_s=float(now))
    assert m.choice.hunting


def test_readings_that_point_anywhere_are_noise_until_they_agree(strategy: type[Scripted]) -> None:
    m, anywhere = mission(strategy), random.Random(1)
    for now in range(101, 131):
        heard(m, beacon(1, 20, anywhere.randrange(-89, 90)), at_s=float(now))
    assert not m.choice.hunting
    (faded,) = (event for event in m.news() if isinstance(event, TransmitterFaded))
    assert faded.noise
    for now in range(131, 145):
        heard(m, beacon(1, 20, 30), at_s=float(now))
    assert m.choice.hunting
    for now in range(145, 160):  # so near that the flux line turns over each metre
        heard(m, beacon(1, 5, anywhere.randrange(-89, 90)), at_s=float(now), position=(now % 2, 4.0, -1.0))
    assert m.choice.hunting


@pytest.mark.usefixtures("believed")
@pytest.mark.parametrize("victims", [1, 2])
def test_a_place_that_fits_few_readings_among_many_frames_is_none(strategy: type[Scripted], victims: int) -> None:
    """As of ghost signals: above a transmitter nearly all frames have it."""
    m = mission(strategy, victims=victims)
    for now in range(101, 121):
        heard(m, *([beacon(1, 3)] if now % 6 == 5 else []), at_s=float(now))
    strategy.finds = Found(*AT[:2])
    heard(m, beacon(1, 3), at_s=121.0)
    assert (m.found, m.ended) == (None, None)
    for now in range(122, 125):
        heard(m, beacon(1, 3), at_s=float(now))
    assert (in_words(m.ended), len(m.victims.places)) == ((FOUND, 0) if victims == 1 else ("", 1))


def test_a_search_goes_back_to_the_lane_where_it_left_it(strategy: type[Scripted]) -> None:
    plan = SearchPlan(strategy, height=1.0, area=(0.0, 0.0, 60.0, 10.0))
    m, left = Told(plan, 100.0, (0.0, 5.0, -1.0)), (20.0, 5.0, -1.0)
    heard(m, at_s=101.0, position=(0.0, 5.0, -1.0))
    heard(m, beacon(1, 60), at_s=102.0, position=left)
    for now in range(103, 164):
        heard(m, at_s=float(now), position=(35.0, 9.0, -1.0))
    assert heard(m, at_s=164.0, position=(35.0, 9.0, -1.0)) == pytest.approx(
        towards((35.0, 9.0, -1.0), (20.0, 5.0), 1.0)
    )
    north, east = heard(m, at_s=180.0, position=left)
    assert (north, east) == pytest.approx((1.0, 0.0))


def test_a_transmitter_lost_before_it_came_nearer_is_put_off_too(strategy: type[Scripted]) -> None:
    """From the same place it would only be lost again."""
    m = mission(strategy, limit_s=1e9)
    heard(m, beacon(1, 60), at_s=101.0)
    for now in range(102, 163):
        heard(m, at_s=float(now))
    assert not m.choice.hunting
    assert heard(m, beacon(1, 60), at_s=163.0) != NORTH
    assert heard(m, beacon(1, 47), at_s=164.0) == NORTH
    for now in range(165, 227):  # nearer than when it was chosen before, not put off
        heard(m, *([beacon(1, 30)] if now == 165 else []), at_s=float(now))
    assert not m.choice.hunting
    assert heard(m, beacon(1, 45), at_s=227.0) == NORTH


@pytest.mark.usefixtures("believed")
def test_the_other_victim_is_reported_with_its_nearest_place(m: Told, strategy: type[Scripted]) -> None:
    heard(m, beacon(1, 20), beacon(2, 40), at_s=101.0, position=(1.0, 1.0, -1.0))
    heard(m, beacon(1, 10), beacon(2, 35), at_s=102.0, position=(2.0, 2.0, -1.0))
    heard(m, beacon(1, 10), beacon(2, 45), at_s=103.0, position=(3.0, 3.0, -1.0))
    assert set(m.others) == {1, 2}  # while none is found
    strategy.finds = Found(5.0, 6.0)
    heard(m, beacon(1, 5), beacon(2, 50), at_s=104.0, position=(5.0, 6.0, -1.0))
    assert (in_words(m.ended), m.choice.target, m.found) == (FOUND, 1, Found(5.0, 6.0))
    ((id_, other),) = m.others.items()
    assert (id_, other.nearest_m, other.nearest_at) == (2, 35.0, (2.0, 2.0))
    heard(m, beacon(2, 30), at_s=105.0, position=(4.0, 4.0, -1.0))  # on the way down
    assert m.others[2].nearest_m == 30.0
    assert m.progress.searched_s == pytest.approx(4.0)


def test_frames_that_hear_nothing_are_no_signal(m: Told) -> None:
    nothing = [Channel(), Channel(4, MID, 0, 0), Channel(5, MID, -1, -1), Channel(6, MID, -500, 10)]
    heard(m, *nothing, at_s=101.0)
    assert (m.choice.target, m.choice.heard, m.progress.frames) == (None, {}, 1)


# -- frames stop -------------------------------------------------------------------------------------------


def test_without_frames_it_hovers_and_goes_on_when_they_are_back(m: Told) -> None:
    heard(m, beacon(1, 20), at_s=101.0)
    m.news()
    assert m.fly(103.0, AT)[:2] == NORTH
    for now in (103.1, 105.0, 110.9):
        assert m.fly(now, AT)[:2] == STILL
    assert m.news() == [SearchPaused(103.1, "no frame", 2.0, 0.0)]
    assert heard(m, beacon(1, 20), at_s=110.95) == NORTH
    assert m.news() == [SearchResumed(110.95, "no frame")]
    assert not m.ended


@pytest.mark.parametrize("patience", [1.0, 10.0, 60.0])
def test_without_frames_for_long_it_ends(strategy: type[Scripted], patience: float) -> None:
    m = mission(strategy, patience_s=patience)
    m.fly(100.0 + patience, AT)
    assert not m.ended
    m.fly(100.1 + patience, AT)
    assert (in_words(m.ended), m.broken) == (f"no good frame from the receiver for {patience:g} s", True)


# -- other ends --------------------------------------------------------------------------------------------


def test_the_time_is_limited(strategy: type[Scripted]) -> None:
    m = mission(strategy, limit_s=50)
    assert heard(m, beacon(1, 20), at_s=150.0) == NORTH
    assert heard(m, beacon(1, 20), at_s=150.1) == STILL
    assert (in_words(m.ended), m.broken, m.found) == ("not found in 50 s", False, None)


@pytest.mark.parametrize("position", [(151, 0, -1), (-151, 0, -1), (0, 251, -1), (0, -101, -1), (math.nan, 0, -1)])
def test_far_outside_its_area_is_no_place_for_a_search(strategy: type[Scripted], position: Position) -> None:
    m = mission(strategy, area=(-50, 20, 50, 150))  # and the take-off point is inside
    assert heard(m, beacon(1, 20), at_s=101.0, position=(149, -99, -1)) == NORTH
    assert heard(m, beacon(1, 20), at_s=102.0, position=position) == STILL
    assert (in_words(m.ended), m.broken) == ("it is more than 100 m outside the area", True)


@pytest.mark.parametrize("found", [Found(math.nan, 0.0), Found(0.0, math.inf)])
def test_a_place_that_is_no_number_is_not_found(m: Told, strategy: type[Scripted], found: Found) -> None:
    strategy.finds = found
    assert heard(m, beacon(1, 20), at_s=101.0) == NORTH
    assert (in_words(m.ended), m.found) == ("", None)


@pytest.mark.parametrize("down", [math.nan, math.inf])
@pytest.mark.parametrize("covariance", [(math.nan, 0, 1), (1, math.inf, 1), (-1, 0, 1), (1, 0, -1)])
def test_what_else_is_no_number_is_not_told(strategy: type[Scripted], down: float, covariance: Any) -> None:
    m = mission(strategy)
    strategy.finds = Found(1.0, 2.0, down, covariance)
    heard(m, beacon(1, 20), at_s=101.0)
    assert m.found == Found(1.0, 2.0)
    strategy.finds = Found(1.0, 2.0, 3.0, (4.0, -1.0, 9.0))
    m = mission(strategy)
    heard(m, beacon(1, 20), at_s=101.0)
    assert m.found == strategy.finds
    assert m.found.sigma == pytest.approx(3.03, abs=0.01)


# -- whatever a strategy says ------------------------------------------------------------------------------

ANY = st.floats(allow_nan=True, allow_infinity=True)


@given(ANY, ANY, st.floats(0.2, 10))
def test_what_is_flown_is_finite_and_not_faster_than_planned(north: float, east: float, speed: float) -> None:
    fresh = type("Fresh", (Scripted,), {"made": [], "says": (north, east)})
    m = mission(fresh, speed=speed)
    flown = heard(m, beacon(1, 20), at_s=101.0)
    assert math.hypot(*flown) <= speed * (1 + 1e-9)
    if not math.isfinite(math.hypot(north, east)):
        assert flown == STILL
    elif math.hypot(north, east) <= speed:
        assert flown == (north, east)


@pytest.mark.parametrize("where", ["__init__", "hear", "velocity", "found"])
def test_a_strategy_that_fails_ends_the_search_and_not_the_flight(
    m: Told, strategy: type[Scripted], where: str
) -> None:
    def fail(*_: object) -> None:
        raise np.linalg.LinAlgError("Singular matrix")

    setattr(strategy, where, property(fail) if where == "found" else fail)
    assert heard(m, beacon(1, 20), at_s=101.0) == STILL
    assert in_words(m.ended).startswith("the strategy has failed: LinAlgError('Singular matrix') (test_mission.py:")
    assert in_words(m.ended).endswith("); fix the error, and fly it in arva-hil demo first")
    assert m.broken
    assert heard(m, beacon(1, 20), at_s=102.0) == STILL


@given(st.floats(-1000, 1000), st.floats(0.3, 100))
def test_the_height_is_held(height: float, wanted: float) -> None:
    m = mission(Scripted, height=wanted)
    down = m.fly(100.1, (0.0, 0.0, -height))[2]
    if height < wanted / 2:
        assert down == -1.0
    else:
        assert down == pytest.approx(max(-1.0, min(0.5, height - wanted)), abs=1e-9)


@given(st.lists(st.tuples(st.floats(0, 300), st.booleans(), st.integers(-5, 6000)), max_size=30))
def test_time_may_go_anywhere(steps: list[tuple[float, bool, int]]) -> None:
    fresh = type("Fresh", (Scripted,), {"made": []})
    m = mission(fresh)
    for now, comes, d_cm in steps:
        if comes:
            m.on_frame(frame(Channel(1, MID, d_cm, 0)), now, AT, LEVEL)
        flown = m.fly(now, AT)
        assert math.hypot(*flown[:2]) <= 1.0 + 1e-9
        assert in_words(m.ended) == "" or flown[:2] == STILL


# -- the place found ---------------------------------------------------------------------------------------


@pytest.mark.usefixtures("believed")
@pytest.mark.parametrize(("land", "near_m"), [(False, 0.5), (True, 2.0)])
def test_it_ends_at_the_place_found_and_a_descent_flies_the_rest(
    land: bool, near_m: float, strategy: type[Scripted]
) -> None:
    m = mission(strategy, land=land)
    strategy.finds = Found(3.0, 4.0)
    assert heard(m, beacon(1, 5), at_s=101.0, position=(0.0, 0.0, -1.0)) == pytest.approx((0.6, 0.8))
    assert in_words(m.ended) == ""
    assert m.fly(104.0, (3.0, 3.9 - near_m, -1.0))[:2] != STILL  # without a frame: it is known where to
    assert m.fly(105.5, (3.0, 4.1 - near_m, -1.0))[:2] == STILL
    assert (in_words(m.ended), m.progress.searched_s) == (FOUND, 5.5)


@pytest.mark.usefixtures("believed")
def test_a_receiver_turned_from_the_heading_is_told_with_the_place(m: Told, strategy: type[Scripted]) -> None:
    strategy.finds = Found(3.0, 4.0, turned_deg=-9.0)
    heard(m, beacon(1, 1), at_s=101.0)
    told = [event for event in m.news() if isinstance(event, (PlaceFound, ReceiverTurned))]
    assert [type(event) for event in told] == [PlaceFound, ReceiverTurned]
    assert told[1] == ReceiverTurned(101.0, 1, -9.0)


@pytest.mark.usefixtures("believed")
def test_a_place_found_that_is_not_reached_ends_at_the_limit(strategy: type[Scripted]) -> None:
    m = mission(strategy, limit_s=10)
    strategy.finds = Found(30.0, 40.0)
    heard(m, beacon(1, 50), at_s=101.0, position=(0.0, 0.0, -1.0))
    m.fly(109.0, (0.0, 0.0, -1.0))
    assert in_words(m.ended) == ""
    m.fly(110.5, (0.0, 0.0, -1.0))
    assert in_words(m.ended) == FOUND


def test_a_place_that_the_readings_do_not_agree_with_is_not_sure(m: Told, strategy: type[Scripted]) -> None:
    for k in range(10):
        heard(m, beacon(1, 20 - k), at_s=101.0 + k, position=(1.0 * k, 0.0, -1.0))  # it lies 20 m north
    strategy.finds = Found(9.0, 0.0)
    heard(m, beacon(1, 10), at_s=112.0, position=(9.0, 0.0, -1.0))
    assert (in_words(m.ended), m.sure, m.found) == (NOT_SURE, False, strategy.finds)


# -- on the ground -----------------------------------------------------------------------------------------


def test_what_is_heard_of_the_height_is_flown_by(strategy: type[Scripted]) -> None:
    m = mission(strategy, height=3.0)
    m.on_frame(frame(beacon(1, 20)), 101.0, AT, LEVEL)
    assert m.fly(101.0, (3.0, 4.0, -9.0), height=Height(3.0, True)) == (*NORTH, 0.0)
    assert m.fly(101.2, (3.0, 4.0, -9.0), height=Height(3.3, True))[2] == pytest.approx(0.3)


def test_too_low_it_flies_nowhere_but_up_and_says_so(strategy: type[Scripted]) -> None:
    m = mission(strategy, height=3.0)
    m.on_frame(frame(beacon(1, 20)), 101.0, AT, LEVEL)
    m.fly(101.0, AT, height=Height(3.0, True))
    m.news()
    assert m.fly(102.0, AT, height=Height(1.4, True)) == (0.0, 0.0, -1.0)
    assert m.news() == [TooLow(102.0, 1.4, 3.0)]
    m.on_frame(frame(beacon(1, 19)), 103.0, AT, LEVEL)
    assert m.fly(103.0, AT, height=Height(2.5, True)) == (*NORTH, -0.5)
    assert not m.ended


def test_what_stays_too_low_ends(strategy: type[Scripted]) -> None:
    m = mission(strategy, height=3.0, patience_s=60.0)
    m.fly(101.0, AT, height=Height(3.0, False))
    for k in range(12):
        m.fly(102.0 + k, AT, height=Height(0.7, False))
    assert (in_words(m.ended), m.broken) == ("it does not climb above 0.7 m", True)


def test_when_it_lands_it_comes_down_above_the_place_first(strategy: type[Scripted]) -> None:
    m = Mission(SearchPlan(strategy, height=3.0), 100.0, (0.0, 0.0, -3.0))
    assert m.progress.searched_s == 0.0
    strategy.finds = Found(3.0, 4.0)
    m.on_frame(frame(beacon(1, 3)), 101.0, (3.0, 4.0, -3.0), LEVEL)
    position, now = np.array([3.0, 4.4, -3.0]), 101.0
    while not m.over:
        position += 0.1 * np.array(m.fly(now, tuple(position)))
        now += 0.1
        assert now < 130
    assert m.ended
    assert math.dist(position[:2], (3.0, 4.0)) < 0.2
    assert -1.7 < position[2] < -1.5
    assert m.progress.searched_s == pytest.approx(1.0)


def test_what_does_not_land_is_over_at_once(strategy: type[Scripted]) -> None:
    m = mission(strategy, land=False)
    strategy.finds = Found(3.0, 4.0)
    heard(m, beacon(1, 1), at_s=101.0)
    assert m.over
    assert m.fly(102.0, AT)[:2] == STILL


# -- the receiver is not where the vehicle is --------------------------------------------------------------


def test_the_receiver_is_flown_to_the_signal_and_the_vehicle_to_the_victim(m: Told, strategy: type[Scripted]) -> None:
    def velocity(self: Scripted, time_s: float, position: Position) -> Velocity:
        return position[0] / 10, position[1] / 10

    strategy.velocity = velocity
    m.on_frame(frame(beacon(1, 20)), 101.0, AT, LEVEL)
    assert m.fly(101.0, AT, receiver=(5.0, 6.0, -1.0))[:2] == pytest.approx((0.5, 0.6))
    strategy.finds = Found(3.0, 4.0)
    m.on_frame(frame(beacon(1, 5)), 102.0, AT, LEVEL)
    m.fly(102.0, (3.0, 4.0, -1.0), receiver=(5.0, 6.0, -1.0))
    assert m.ended


# -- a receiver that says the same -------------------------------------------------------------------------


def test_a_reading_that_never_changes_is_not_flown_by(m: Told) -> None:
    for k in range(4):
        assert heard(m, beacon(1, 9, 20), at_s=101.0 + k, position=(1.0 * k, 0.0, -1.0)) == NORTH
    m.news()
    assert heard(m, beacon(1, 9, 20), at_s=105.0, position=(4.0, 0.0, -1.0)) == STILL
    assert m.news() == [SearchPaused(105.0, "same readings", 2.0, 4.0)]
    assert heard(m, beacon(1, 8, 20), at_s=106.0, position=(4.0, 0.0, -1.0)) == NORTH
    assert m.news() == [SearchResumed(106.0, "same readings")]
    for k in range(20):
        heard(m, beacon(1, 8, 20), at_s=107.0 + k, position=(4.0 + min(k, 4), 0.0, -1.0))
    assert (in_words(m.ended), m.broken) == ("the receiver repeats the same reading: it is stuck", True)


def test_what_the_receiver_says_again_elsewhere_tells_the_strategy_nothing(m: Told, strategy: type[Scripted]) -> None:
    """So nothing is found by it, and what was found is not judged by it."""
    heard(m, beacon(1, 9, 20), at_s=101.0, position=(0.0, 0.0, -1.0))
    strategy.finds = Found(3.0, 4.0)
    for k in range(1, 3):
        heard(m, beacon(1, 9, 20), at_s=101.0 + k, position=(1.0 * k, 0.0, -1.0))
    (told,) = strategy.made
    assert [o.position[0] for o in told.heard] == [0.0]
    assert m.found is None
    heard(m, beacon(1, 8, 20), at_s=104.0, position=(3.0, 0.0, -1.0))
    assert [o.position[0] for o in told.heard] == [0.0, 3.0]
    assert m.found == Found(3.0, 4.0)


def test_a_reading_said_again_elsewhere_tells_nothing_though_another_transmitter_s_changes(
    m: Told, strategy: type[Scripted]
) -> None:
    """Nor is that transmitter told as silent."""
    for k in range(4):
        heard(m, beacon(1, 9, 20), beacon(2, 30 - k, 20), at_s=101.0 + k, position=(1.0 * k, 0.0, -1.0))
    (told,) = strategy.made
    assert [(o.position[0], o.heard) for o in told.heard] == [(0.0, True)]
    heard(m, beacon(1, 8, 20), beacon(2, 26, 20), at_s=105.0, position=(4.0, 0.0, -1.0))
    assert [(o.position[0], o.heard) for o in told.heard] == [(0.0, True), (4.0, True)]
    assert m.choice.heard[2].last_m == 26.0


def test_a_stuck_receiver_whose_frames_stop_too_has_no_frames(m: Told) -> None:
    for k in range(6):
        heard(m, beacon(1, 9, 20), at_s=101.0 + k, position=(1.0 * k, 0.0, -1.0))
    for k in range(20):
        m.fly(107.0 + k, AT)
    assert in_words(m.ended) == "no good frame from the receiver for 10 s"


# -- The strips: their geometry, and that they are flown to their end -------------------------------------


ALONG = st.floats(-200, 200)
WIDTH = st.floats(1, 100)
SHARE = st.floats(0, 1)
AREA = st.tuples(ALONG, ALONG, st.floats(1, 300), st.floats(1, 300)).map(
    lambda a: (a[0], a[1], a[0] + a[2], a[1] + a[3])
)
PLACE = st.tuples(ALONG, ALONG, st.just(-1.0))

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


@given(AREA, PLACE, WIDTH, SHARE, SHARE)
def test_every_place_is_within_half_a_width_of_a_lane(area: Area, at: Point, width: float, n: float, e: float) -> None:
    south, west, north, east = area
    point = south + n * (north - south), west + e * (east - west)
    strips = Strips(area, 1.0, (*at[:2], -1.0), width=width)
    assert min(beside(point, *lane) for lane in lanes(strips)) <= width / 2 + 1e-6


@given(AREA, PLACE, WIDTH)
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


@given(AREA, PLACE, WIDTH)
def test_begins_at_the_nearest_corner(area: Area, at: tuple[float, float, float], width: float) -> None:
    strips = Strips(area, 1.0, at, width=width)
    corners = [end for lane in (lanes(strips)[0], lanes(strips)[-1]) for end in lane]
    assert math.dist(at[:2], strips.lanes[0]) <= min(math.dist(at[:2], corner) for corner in corners) + 1e-6


@given(AREA, PLACE, WIDTH, st.floats(0.5, 10))
def test_no_faster_than_allowed(area: Area, at: tuple[float, float, float], width: float, speed: float) -> None:
    assert math.hypot(*Strips(area, speed, at, width=width).velocity(0.0, at)) <= speed * (1 + 1e-9)


@every("speed", [1.0, 5.0])
@every("area", [(0, 0, 100, 70), (-50, -80, -20, 40)])
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


@every("area", [(0, 0, 0, 10), (10, 0, 0, 10), (0, 5, 10, 5), (math.nan, 0, 10, 10)])
def test_an_empty_area_is_refused(area: Area) -> None:
    with pytest.raises(ValueError, match="nothing to fly over"):
        Strips(area, 1.0, (0.0, 0.0, 0.0))


@every("width", [0.0, -40.0, math.nan])
def test_a_strip_has_a_width(width: float) -> None:
    with pytest.raises(ValueError, match="nothing to fly over"):
        Strips((0, 0, 10, 10), 1.0, (0.0, 0.0, 0.0), width=width)


# A search with nothing left to find ends, also with a team, and does not fly its strips until the limit


FRAME = LocalFrame(46.0, 7.0, 1000.0)
FIELD = (0.0, 0.0, 30.0, 20.0)


class Hover:
    """A strategy that finds nothing."""

    found: Found | None = None

    def __init__(self, speed: float) -> None: ...

    def observe(self, observation: Observation) -> None: ...

    def velocity(self, time_s: float, position: Position) -> Velocity:
        return STILL


def mate() -> Teammate:
    """The first of two; the other one has flown its part, found a transmitter and landed."""
    first = Teammate(0, lambda news: None, TeamField(FIELD, FRAME, 2))
    first.report(100.0, (46.0, 7.0, 1003.0), flying=True)
    first.on_news(News(1, 100.0, (46.0, 7.0003, 1000.0), False, found=(9,), flown=(1,)))
    return first


@every("team", [False, True])
@every("victims", [1, None])
def test_one_that_only_hears_a_transmitter_hardly_ends_after_two_rounds(team: bool, victims: int | None) -> None:
    plan = SearchPlan(Hover, height=3.0, speed=2.0, area=FIELD, strip_width=10.0, limit_s=1e9, victims=victims)
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
    assert in_words(m.ended).startswith("no signal agrees with a place: all strips are flown")
    assert in_words(m.ended).endswith(", twice")


# -- A receiver that repeats itself: frames that come again, and readings that stay the same --------------


def numbered(sequence: int, *channels: Channel) -> Frame:
    return Frame(sequence, 1, channels or (Channel(1, MID, 400, 20),))


@every(
    "came, new",
    [
        ([0, 1, 2, 3], [0, 1, 2, 3]),
        ([254, 255, 0, 1], [254, 255, 0, 1]),
        ([7, 7, 7, 8], [7, 8]),
        ([7, 9, 8, 10], [7, 9, 10]),  # one was overtaken
        ([255, 0, 255, 1], [255, 0, 1]),
        ([200, 0, 1], [200, 0, 1]),  # it has started anew
        ([5, 100, 101], [5, 100, 101]),
    ],
)
def test_a_frame_is_new_once(came: list[int], new: list[int]) -> None:
    fresh = NewFrames()
    assert [number for number in came if fresh.new(numbered(number))] == new


def test_a_receiver_that_repeats_one_frame_is_silent_and_that_is_explained() -> None:
    near, far = memory.pair()
    receiver = ReceiverLink(near, Decoder(), emit=lambda event: None)
    for n in range(50):
        far.write(encode(numbered(42)))
        assert len(receiver.read(100.0 + n * 0.1)) == (n == 0)
    assert receiver.silent(104.9)
    silence = in_words(receiver.why_silent(104.9))
    assert "the last one came 5 s ago, and its sequence number 42 again and again since" in silence


def test_lines_of_text_have_no_number_and_are_all_new() -> None:
    near, far = memory.pair()
    receiver = ReceiverLink(near, TextDecoder(), emit=lambda event: None)
    for n in range(5):
        far.write(b"900,20\r\n")
        assert len(receiver.read(100.0 + n)) == 1


def after(*frames: tuple[Frame, float], every_s: float = 1.0) -> StuckReadings:
    """What it knows after those frames, heard so far north."""
    standstill = StuckReadings()
    for n, (one, north) in enumerate(frames):
        standstill.observe([c for c in one.channels if c.valid], (north, 0.0, -1.0), 100.0 + n * every_s)
    return standstill


def test_the_same_reading_over_some_metres_is_stuck() -> None:
    assert after(*((numbered(n), 0.5 * n) for n in range(8)), every_s=0.1).whole.stuck


def test_the_same_reading_half_a_metre_farther_is_none_of_here() -> None:
    assert not after((numbered(0), 0.0), (numbered(1), 0.4)).whole.old
    assert after((numbered(0), 0.0), (numbered(1), 0.6)).whole.old
    assert after((numbered(0), 0.0), (numbered(1), 0.6), (numbered(2), 0.0)).whole.old  # back again


@every("d, same_m", [(810, 0.8), (1300, 1.3), (6000, 1.5)])
def test_farther_from_a_transmitter_the_same_reading_is_of_more_places(d: int, same_m: float) -> None:
    far = Channel(1, MID, d, 20)
    hovering = [(numbered(n, far), same_m * (n > 2)) for n in range(30)]
    assert (after(*hovering).whole.old, after(*hovering).whole.stuck) == (False, False)
    assert after((numbered(0, far), 0.0), (numbered(1, far), same_m + 0.1)).whole.old


def test_above_a_transmitter_the_same_d_without_a_direction_is_of_more_places() -> None:
    """d is shown in 10 cm, and is the same on both sides; a search that hovers there gets no other."""
    near = Channel(1, INNER, 260, 0)
    hovering = [(numbered(n, near), min(0.8 * n, 2.4)) for n in range(30)]
    assert (after(*hovering).whole.old, after(*hovering).whole.stuck) == (False, False)
    assert after((numbered(0, near), 0.0), (numbered(1, near), 2.6)).whole.old


def test_the_same_reading_for_long_off_the_place_where_it_was_right_is_stuck() -> None:
    """A search that believes itself above the transmitter hovers there."""
    places = [0.0, 0.6, 1.2, 1.3, 1.3, 1.3, 1.3, 1.3]
    assert not after(*((numbered(n), north) for n, north in enumerate(places[:-1]))).whole.stuck
    assert after(*((numbered(n), north) for n, north in enumerate(places))).whole.stuck


def test_it_is_not_while_the_vehicle_stands_or_anything_changes_or_nothing_is_heard() -> None:
    for standstill in (
        after(*((numbered(n), 0.002 * n) for n in range(200))),
        after(*((numbered(n, Channel(1, MID, 900 + n % 2, 20)), float(n)) for n in range(30))),
        after(*((numbered(n, Channel(1, MID, 900, n)), float(n)) for n in range(30))),
        after(*((numbered(n, Channel()), float(n)) for n in range(30))),
    ):
        assert not standstill.whole.old
        assert not standstill.whole.stuck
    assert not after((numbered(0), 0.0), (numbered(1), 50.0)).whole.stuck


def test_a_change_frees_it() -> None:
    same = [(numbered(n), 1.0 * n) for n in range(8)]
    standstill = after(*same, (numbered(9, Channel(1, MID, 901, 20)), 8.0))
    assert (standstill.whole.old, standstill.whole.stuck, standstill.whole.moved_m) == (False, False, 0.0)


def test_a_stuck_reading_is_noticed_though_another_transmitter_s_changes() -> None:
    frames = [(numbered(n, Channel(1, MID, 900, 20), Channel(2, MID, 1500 - n, 40)), 1.0 * n) for n in range(8)]
    standstill = after(*frames)
    assert standstill.repeats(1)
    assert not standstill.repeats(2)
    assert not standstill.repeats(3)
    assert not standstill.whole.old
    assert not standstill.whole.stuck


def test_an_empty_channel_that_changes_hides_no_stuck_reading() -> None:
    frames = [(numbered(n, Channel(1, MID, 900, 20), Channel(n, MID, -1, -1)), 1.0 * n) for n in range(8)]
    assert after(*frames).whole.stuck


# -- The receiver as a search has it: what came, and what there is to say when nothing does ---------------


THIRD = Frame(3, 1, (Channel(1, 1, 1234, -15),))


def test_frames_are_read_as_they_come() -> None:
    near, far = memory.pair()
    receiver = ReceiverLink(near, Decoder(), [].append)
    assert receiver.silent(100.0)
    far.write(encode(THIRD)[:7])
    assert receiver.read(100.0) == []
    next_one = THIRD._replace(sequence=4)
    far.write(encode(THIRD)[7:] + encode(next_one))
    assert receiver.read(100.01) == [THIRD, next_one]
    assert receiver.last == next_one
    assert not receiver.silent(102.0)
    assert receiver.silent(102.1)


@every(
    "came, why",
    [
        (b"", "nothing came"),
        (b"\x00", r"bytes came that are none, first b'\x00': is the format right, and the baud rate?"),
        (encode_nmea(THIRD), "bytes came that are none, first b'$PARVA,3,1,1,1,1': is the format right"),
        (encode(THIRD), "the last one came 60 s ago"),
    ],
)
def test_silence_is_explained(came: bytes, why: str) -> None:
    near, far = memory.pair()
    receiver = ReceiverLink(near, Decoder(), [].append)
    for byte in came:
        far.write(bytes([byte]))
        receiver.read(0.0)
    assert in_words(receiver.why_silent(60.0)).startswith("no frame from the receiver at memory:a: ")
    assert why in in_words(receiver.why_silent(60.0))


def test_one_that_is_unplugged_is_silent_and_says_so_once() -> None:
    near, far = memory.pair()
    events: list[Event] = []
    receiver = ReceiverLink(near, Decoder(), events.append)
    far.write(encode(THIRD))
    far.close()
    assert receiver.read(0.0) == [THIRD]
    for now in (1.0, 2.0, 3.0):
        assert receiver.read(now) == []
    assert events == [ReceiverGone(1.0, "memory:a: lost: closed by the far end")]
    assert not receiver.links
    assert receiver.silent(3.0)


# A search uses what the receiver has: integers, or the signed signals of its antennas and the age of the pulse


KAPPA_EQ = 1.542


@every("place", [(12.0, 5.0, -4.0), (2.0, -1.0, -1.5)])
@every("inner", [False, True])
def test_signals_tell_d_of_two_antennas_with_its_direction_and_d_of_three(
    place: tuple[float, float, float], inner: bool
) -> None:
    x, y, z = dipole_field(place, [[0, 0, 0]], [np.eye(3)], [1.0])[0].tolist()
    of_two, of_three = (math.cbrt(KAPPA_EQ / (4 * math.pi * h)) for h in (math.hypot(x, y), math.hypot(x, y, z)))
    shown = round(100 * (of_three if inner else of_two))
    o = Observation(0.0, place, np.eye(3), shown, 0, inner, signal=(1e5 * x, 1e5 * y, 1e5 * z))
    (d, delta, all_antennas), (d_3, _, all_3) = o.measurements
    assert (d, d_3) == pytest.approx((of_two, of_three), abs=0.01)
    assert (delta, all_antennas, all_3) == (pytest.approx(math.atan2(y, x)), False, True)


@every("signal", [None, (0.0, 0.0, 7.0), (3.0, 4.0, 0.0)])  # integers alone, no x and y, no antenna z
def test_otherwise_it_tells_what_its_integers_say(signal: tuple[float, float, float] | None) -> None:
    o = Observation(0.0, (0.0, 0.0, -3.0), np.eye(3), 250, 30, False, signal=signal)
    assert o.measurements == [(2.5, math.radians(30), False)]
    assert Observation(0.0, (0.0, 0.0, -3.0), np.eye(3), -1, -1, False, signal=signal).measurements[0][0] < 0


def test_what_was_measured_comes_with_the_reading_of_its_channel() -> None:
    channels = Channel(7, MID, 900, 10), Channel(9, INNER, 200, 0), Channel(None, 0, -1, -1)
    vectors = VectorChannel(7, MID, x=100, y=-20, z=3, age_ms=40), VectorChannel(9, INNER, age_ms=None), VectorChannel()
    sent = Frame(1, 0, channels, Measured(5000, vectors))
    (came,) = VECTOR.decoder().feed(VECTOR.encode(sent), 0.0)
    heard = observations(pulses(came), 8.0, (0.0, 0.0, -3.0), np.eye(3), None)
    assert list(heard) == [9, 7]
    assert (heard[7].signal, heard[7].age_s) == ((100, -20, 3), 0.04)
    assert (heard[9].signal, heard[9].age_s) == (None, 0.0)
    levels = sent._replace(measured=Measured(5000, tuple(LevelChannel(c.id, level=-100) for c in channels)))
    assert observations(pulses(levels), 8.0, (0.0, 0.0, -3.0), np.eye(3), None)[7].signal is None


@pytest.mark.parametrize("turn", [(0.0, 0.1, 0.4), (2.0, -0.5, 2.5)])
def test_the_same_readings_with_signals_tell_the_place_better(turn: tuple[float, float, float]) -> None:
    sent = [[0.0, 0.0, 1.0]], [rotation.to_matrix(rotation.from_euler(*turn))], [1.0]
    sigmas = []
    for with_signals in (True, False):
        strategy = Estimate(1.0)
        for k in range(8):
            at = (-14.0 + 1.5 * k, 4.0, -3.0)
            x, y, z = (1e6 * dipole_field(at, *sent)[0]).tolist()
            d_cm = round(100 * math.cbrt(1e6 * KAPPA_EQ / (4 * math.pi * math.hypot(x, y))))
            delta_deg = round(math.degrees(math.atan(y / x)))
            signal = (x, y, z) if with_signals else None
            strategy.observe(Observation(float(k), at, np.eye(3), d_cm, delta_deg, False, signal=signal))
        nn, _, ee = strategy.belief.covariance or (math.inf,) * 3
        sigmas.append(math.hypot(nn, ee) ** 0.5)
    assert sigmas[0] < 0.7 * sigmas[1]
