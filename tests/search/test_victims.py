"""Searches for more than one: who is noted and marked, who is passed by, how it ends, who has the vehicle meanwhile."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import pytest

from arva_hil.events import Event
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import (
    MarkLost,
    MarksNotTaken,
    PlaceDoubted,
    PlaceFound,
    ReceiverKnown,
    TransmitterChosen,
    VictimAgain,
    VictimNoted,
)
from arva_hil.events.words.reasons import in_words
from arva_hil.search.mission.choice import LOOK_AGAIN, LastLook
from arva_hil.search.mission.mission import Mission
from arva_hil.search.mission.outcome import conclusion
from arva_hil.search.mission.victims import ReceiverHost, Victim, probing_order
from arva_hil.search.strategies.analysis import TransmitterReadings
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import STILL, Found, Observation, Position, Velocity, towards
from arva_hil.simulated.autopilot import Mode
from firmware_proto import MORE_TRANSMITTERS, Channel, Command, CommandAnswer, Frame, encode
from firmware_proto.commands import BINARY_HOST, BUSY, DONE, IDENTIFY, MARK, REFUSED, UNKNOWN
from tests.every import every
from tests.search.test_client import BOTH, World, ardupilot, read
from tests.search.test_mission import AT, LEVEL, NORTH, Scripted, beacon
from tests.search.test_pilot import LOW, SYS_STATUS
from tests.search.test_pilot import says as says_of_the_battery
from tests.simulated_px4 import HOLD, Px4

FOUND = in_words(because(Why.FOUND))
NOT_SURE = in_words(because(Why.NOT_SURE))


class Receiver:
    """The other end of a receiver's port. `says`: its answers to marks, the last one again and again; None: silent."""

    def __init__(self, *says: str | None) -> None:
        self.says = list(says) or [DONE]
        self.host = ReceiverHost(BINARY_HOST, self.take)
        self.asked: list[Command] = []
        self._decoder = BINARY_HOST.commands()

    def take(self, data: bytes) -> bool:
        for command in self._decoder.feed(data, 0.0):
            self.asked.append(command)
            result = self.says.pop(0) if command.name == MARK and len(self.says) > 1 else self.says[0]
            result = DONE if command.name == IDENTIFY and result else result
            if result:
                answer = CommandAnswer(command.number, command.name, result, (4,), "pulsed 1")
                self.host.feed(BINARY_HOST.answer(answer), 0.0)
        return True

    @property
    def marks(self) -> list[int]:
        return [command.values[0] for command in self.asked if command.name == MARK]


class Rescue:
    """A mission for several, above `AT`, one second a step. `transmitters`: what a frame says."""

    def __init__(self, wanted: int | None, receiver: Receiver | None = None, **plan: Any) -> None:
        self.strategy: type[Scripted] = type("Fresh", (Scripted,), {"made": []})
        self.events: list[Event] = []
        self.now = 100.0
        host = receiver.host if receiver else None
        settings = SearchPlan(self.strategy, **({"height": 1.0, "victims": wanted, "land": False} | plan))
        self.mission = Mission(settings, self.now, (0.0, 0.0, -2.0), emit=self.events.append, host=host)

    def step(self, *channels: Channel, at: Position = AT, status: int = 1) -> Velocity:
        self.now += 1.0
        self.mission.on_frame(Frame(0, status, channels or (Channel(),)), self.now, at, LEVEL)
        north, east, _ = self.mission.fly(self.now, at)
        return north, east

    def find(self, *channels: Channel, after: Sequence[Channel] = (), place: Position = AT) -> None:
        """The strategy finds its transmitter at a place, and it is noted. `after`: what was heard a second before."""
        if after:
            self.step(*after)
        self.strategy.finds = Found(*place[:2])
        self.step(*channels, at=place)
        self.strategy.finds = None
        before = len(self.of(VictimNoted))
        for _ in range(24):
            if len(self.of(VictimNoted)) > before or self.mission.ended or self.mission.found is None:
                break
            self.step(*channels, at=place)

    def of(self, kind: type[Any]) -> list[Any]:
        return [event for event in self.events if isinstance(event, kind)]


def marked(id_: int, d_m: float) -> Channel:
    return beacon(id_, d_m)._replace(marked=True)


@pytest.fixture(autouse=True)
def agreeing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Places that are made up are believed: what is believed of places is promised elsewhere."""
    monkeypatch.setattr(TransmitterReadings, "judged", lambda self, found, height_m: (found, True))


# -- one after the other -----------------------------------------------------------------------------------


def test_one_is_found_and_marked_then_the_next_and_the_last_one_ends_it() -> None:
    receiver = Receiver()
    rescue = Rescue(2, receiver)
    assert rescue.step(beacon(1, 9), beacon(2, 20)) == NORTH
    rescue.find(beacon(1, 2), beacon(2, 18))
    assert receiver.marks == [1]
    assert rescue.mission.found is None
    assert rescue.step(marked(1, 2), beacon(2, 17)) == NORTH
    assert [event.transmitter for event in rescue.of(TransmitterChosen)] == [1, 2]
    assert not rescue.mission.ended
    rescue.find(beacon(2, 2), marked(1, 18), place=(20.0, 5.0, -1.0))
    assert (in_words(rescue.mission.ended), conclusion(rescue.mission)) == (FOUND, ("found", because(Why.FOUND)))
    first, second = rescue.of(VictimNoted)
    assert first == VictimNoted(first.time_s, 1, 1, 2, 3.0, 4.0, True, True, 1, False)
    assert (second.number, second.left, second.marked) == (2, 0, True)
    assert rescue.of(ReceiverKnown)[0].text == "pulsed 1"
    assert [victim.marked for victim in rescue.mission.victims.places] == [True, True]
    assert rescue.mission.others == {}


def test_the_time_of_a_victim_is_that_of_its_finding_not_of_the_arrival_above_it() -> None:
    rescue = Rescue(2)
    rescue.step(beacon(1, 9))
    rescue.strategy.finds = Found(AT[0] + 5.0, AT[1])
    for _ in range(4):
        rescue.step(beacon(1, 6))  # the vehicle flies there
    rescue.strategy.finds = None
    for _ in range(8):
        rescue.step(beacon(1, 2), at=(AT[0] + 5.0, AT[1], AT[2]))
    (found,), (victim,) = rescue.of(PlaceFound), rescue.mission.victims.places
    assert victim.time_s == found.time_s - 100.0 == 2.0


def test_one_that_is_searched_for_alone_asks_nothing_of_the_receiver() -> None:
    receiver = Receiver()
    rescue = Rescue(1, receiver)
    rescue.find(beacon(1, 2), beacon(2, 18), after=[beacon(1, 9), beacon(2, 20)])
    assert (in_words(rescue.mission.ended), receiver.asked, rescue.of(VictimNoted)) == (FOUND, [], [])


def test_it_hovers_above_the_place_while_pulses_overlap_and_the_mark_is_refused() -> None:
    receiver = Receiver(REFUSED, BUSY, REFUSED, DONE)
    rescue = Rescue(2, receiver)
    rescue.step(beacon(1, 9))
    rescue.strategy.finds = Found(*AT[:2])
    flown = [rescue.step(beacon(1, 2)) for _ in range(20) if rescue.mission.found or rescue.now < 103]
    assert set(flown) == {STILL}
    assert receiver.marks == [1, 1, 1, 1]
    assert rescue.of(VictimNoted)[0].marked


@every("says, tries", [(REFUSED, 6), (UNKNOWN, 1), (None, 0)])
def test_a_receiver_that_marks_nobody_holds_up_nothing(says: str | None, tries: int) -> None:
    receiver = Receiver(says)
    rescue = Rescue(2, receiver)
    rescue.find(beacon(1, 2), beacon(2, 20), after=[beacon(1, 9), beacon(2, 20)])
    assert [(event.marked, event.left) for event in rescue.of(VictimNoted)] == [(False, 1)]
    assert rescue.now < 130
    assert len(receiver.marks) == tries
    said = {REFUSED: [], UNKNOWN: [UNKNOWN], None: ["no answer"]}[says]
    assert [event.answer for event in rescue.of(MarksNotTaken)] == said
    rescue.step(beacon(1, 2), beacon(2, 20))
    assert rescue.mission.choice.target == 2  # it is passed by all the same


def test_without_a_receiver_that_takes_commands_it_is_noted() -> None:
    rescue = Rescue(2)
    rescue.find(beacon(1, 2), beacon(2, 20), after=[beacon(1, 9), beacon(2, 20)])
    rescue.step(beacon(1, 2), beacon(2, 19))
    assert rescue.mission.choice.target == 2


def test_who_is_hidden_by_others_is_not_silent() -> None:
    """A strategy would take silence for a transmitter out of reach."""
    rescue = Rescue(2)
    rescue.step(beacon(1, 9), Channel())
    rescue.step(Channel(), Channel())
    (one,) = rescue.strategy.made
    assert [o.heard for o in one.heard] == [True, False]
    rescue.step(Channel(1), Channel())  # its slot is blank
    rescue.step(beacon(2, 20))  # the only slot
    rescue.step(beacon(2, 20), Channel(), status=MORE_TRANSMITTERS)
    assert [o.heard for o in one.heard] == [True, False]


def test_who_was_heard_on_the_way_is_looked_for_where_that_was() -> None:
    rescue = Rescue(2)
    rescue.step(beacon(1, 9), beacon(2, 20), at=(-30.0, 4.0, -1.0))
    rescue.step(beacon(1, 9), at=(3.0, 4.0, -1.0))
    rescue.find(beacon(1, 2))
    place, now = AT, rescue.now
    while place[0] > -27.0:
        north, east = rescue.step(beacon(1, 9 + rescue.now % 7), at=place)
        place = place[0] + north, place[1] + east, -1.0
        assert rescue.now < now + 40


# -- marking fails as it does for rescuers -----------------------------------------------------------------


def test_a_mark_that_is_lost_is_said_and_made_again_near_by() -> None:
    receiver = Receiver()
    rescue = Rescue(2, receiver)
    rescue.find(beacon(1, 2), beacon(2, 18), after=[beacon(1, 9), beacon(2, 20)])
    for _ in range(4):
        rescue.step(marked(1, 3), beacon(2, 18))
    assert not rescue.of(MarkLost)
    for _ in range(3):
        rescue.step(beacon(1, 30), beacon(2, 18))  # too far away for a mark
    assert [(event.transmitter, event.number) for event in rescue.of(MarkLost)] == [(1, 1)]
    assert receiver.marks == [1]
    for _ in range(3):
        rescue.step(beacon(1, 3), beacon(2, 18))
    assert receiver.marks == [1, 1]
    rescue.step(marked(1, 3), beacon(2, 18))
    assert rescue.mission.victims.places[0].marked
    assert rescue.mission.choice.target == 2


def test_who_is_led_back_says_so_and_counts_nobody_twice() -> None:
    receiver = Receiver()
    rescue = Rescue(2, receiver)
    rescue.find(beacon(1, 2), after=[beacon(1, 9)])
    rescue.step(beacon(5, 2))  # the same transmitter under another number
    rescue.find(beacon(5, 2), place=(3.4, 4.3, -1.0))
    assert [(event.transmitter, event.number) for event in rescue.of(VictimAgain)] == [(5, 1)]
    assert rescue.of(VictimAgain)[0].apart_m == pytest.approx(0.5)
    rescue.step(beacon(5, 2))
    assert (len(rescue.mission.victims.places), in_words(rescue.mission.ended), rescue.mission.choice.hunting) == (
        1,
        "",
        False,
    )
    assert receiver.marks == [1, 1]


def test_a_slot_without_a_signal_does_not_make_two_of_one_that_has_another_number() -> None:
    rescue = Rescue(2)
    rescue.find(beacon(1, 2), after=[beacon(1, 9)])
    rescue.step(Channel(1), beacon(5, 2))  # the slot of the old number is blank
    rescue.find(Channel(1), beacon(5, 2), place=(3.4, 4.3, -1.0))
    assert [(event.transmitter, event.number) for event in rescue.of(VictimAgain)] == [(5, 1)]
    assert len(rescue.mission.victims.places) == 1


def test_one_that_was_found_without_an_id_is_marked_once_it_has_one() -> None:
    receiver = Receiver()
    rescue = Rescue(3, receiver)
    rescue.find(beacon(1, 2)._replace(id=None), after=[beacon(1, 9)._replace(id=None)])
    rescue.find(beacon(7, 2), after=[beacon(7, 9)])
    assert [(event.transmitter, event.number) for event in rescue.of(VictimAgain)] == [(7, 1)]
    for metres in range(4, 12):
        rescue.step(beacon(7, metres / 2))
    assert (len(rescue.mission.victims.places), set(receiver.marks)) == (1, {7})


def test_two_who_were_heard_together_are_two_however_near() -> None:
    rescue = Rescue(2)
    rescue.find(beacon(1, 2), beacon(2, 2), after=[beacon(1, 9), beacon(2, 9)])
    rescue.find(beacon(1, 2), beacon(2, 2), place=(3.2, 4.2, -1.0), after=[beacon(1, 2), beacon(2, 2)])
    assert in_words(rescue.mission.ended) == FOUND


# -- not sure, not found -----------------------------------------------------------------------------------


def test_a_place_that_is_doubted_is_looked_for_once_more_and_then_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(TransmitterReadings, "judged", lambda self, found, height_m: (found, False))
    rescue = Rescue(2)
    rescue.find(beacon(1, 2), after=[beacon(1, 9)])
    assert [event.transmitter for event in rescue.of(PlaceDoubted)] == [1]
    assert not rescue.mission.victims.places
    rescue.step(beacon(1, 9))
    assert [o.d_cm for o in rescue.strategy.made[-1].heard] == [900]  # nothing of before
    rescue.find(beacon(1, 2))
    assert [victim.sure for victim in rescue.mission.victims.places] == [False]
    monkeypatch.setattr(TransmitterReadings, "judged", lambda self, found, height_m: (found, True))
    for id_ in (2, 3):
        rescue.find(beacon(id_, 2), place=(9.0 * id_, 5.0, -1.0), after=[beacon(id_, 9)])
    assert in_words(rescue.mission.ended) == NOT_SURE  # two are sure, and a third place is not
    assert conclusion(rescue.mission)[0] == "not sure"


def test_a_place_that_is_not_sure_stays_so_when_another_is_left_to_be_found_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rescue = Rescue(None)
    monkeypatch.setattr(TransmitterReadings, "judged", lambda self, found, height_m: (found, False))
    rescue.step(beacon(1, 9))
    for _ in range(2):  # the first time it is doubted
        rescue.find(beacon(1, 2))
    assert [victim.sure for victim in rescue.mission.victims.places] == [False]
    monkeypatch.setattr(TransmitterReadings, "judged", lambda self, found, height_m: (found, True))
    monkeypatch.setattr(LastLook, "check", lambda self, found, time_s, *, last: LOOK_AGAIN)
    rescue.find(beacon(2, 2), place=(20.0, 5.0, -1.0), after=[beacon(2, 9)])
    assert rescue.mission.found is None
    assert not rescue.mission.sure


def test_a_sure_place_beside_one_that_is_not_sure_is_listed_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(TransmitterReadings, "judged", lambda self, found, height_m: (found, False))
    rescue = Rescue(2)
    for _ in range(2):  # the first time it is doubted
        rescue.find(beacon(1, 2), after=[beacon(1, 9)])
    monkeypatch.setattr(TransmitterReadings, "judged", lambda self, found, height_m: (found, True))
    rescue.find(beacon(2, 2), place=(3.5, 5.0, -1.0), after=[beacon(2, 9)])
    assert [(victim.id, victim.sure) for victim in rescue.mission.victims.places] == [(1, False), (2, True)]
    assert not rescue.of(VictimAgain)


def test_a_place_near_the_doubted_place_of_another_transmitter_is_doubted_as_well(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(TransmitterReadings, "contradictions", lambda self, time_s: [True] * 9)
    rescue = Rescue(2)
    for id_, place in ((1, AT), (2, (3.4, 4.0, -1.0))):
        rescue.find(beacon(id_, 2), place=place, after=[beacon(id_, 9)])
    assert [event.transmitter for event in rescue.of(PlaceDoubted)] == [1, 2]
    assert not rescue.mission.victims.places


def test_the_last_place_is_not_listed_as_sure_if_what_is_heard_near_the_ground_contradicts_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rescue = Rescue(2)
    rescue.find(beacon(1, 2), beacon(2, 18), after=[beacon(1, 9), beacon(2, 20)])
    rescue.find(beacon(2, 2), beacon(1, 18), place=(20.0, 5.0, -1.0))
    assert in_words(rescue.mission.ended) == FOUND
    monkeypatch.setattr(TransmitterReadings, "contradictions", lambda self, time_s: [True] * 9)
    rescue.mission.confirm(rescue.now + 9.0)
    assert conclusion(rescue.mission)[0] == "not sure"
    assert [victim.sure for victim in rescue.mission.victims.places] == [True, False]


def test_when_the_time_is_up_it_says_how_many() -> None:
    rescue = Rescue(3, limit_s=50)
    rescue.find(beacon(1, 2), beacon(2, 20), after=[beacon(1, 9), beacon(2, 20)])
    while not rescue.mission.ended:
        rescue.step(beacon(2, 20))
        assert rescue.now < 160
    kind, how = conclusion(rescue.mission)
    assert (kind, in_words(how)) == ("not found", "1 of 3 found in 50 s")
    assert list(rescue.mission.others) == [2]


def test_all_are_found_when_the_area_is_searched_and_nobody_is_left() -> None:
    rescue = Rescue(None, area=(0, 0, 20, 10), strip_width=10, height=1.0)
    rescue.step(beacon(1, 9), at=(0.0, 0.0, -1.0))
    rescue.find(beacon(1, 2), place=(1.0, 1.0, -1.0))
    place = (1.0, 1.0, -1.0)
    while not rescue.mission.ended:
        north, east = rescue.step(beacon(1, 9 + rescue.now % 7), at=place)
        place = place[0] + north, place[1] + east, -1.0
        assert rescue.now < 200
    assert (in_words(rescue.mission.ended), conclusion(rescue.mission)[0]) == (FOUND, "found")
    assert place[0] > 18  # it flew the strip


def test_who_takes_too_long_waits_for_the_others() -> None:
    rescue = Rescue(2, limit_s=2000.0)
    while rescue.mission.choice.target in (None, 1):
        rescue.step(beacon(1, 9), beacon(2, 20))
        assert rescue.now < 400
    assert rescue.mission.choice.target == 2
    assert rescue.now == pytest.approx(342, abs=3)


def test_a_receiver_that_falls_silent_ends_it_with_the_list_all_the_same() -> None:
    rescue = Rescue(2)
    rescue.find(beacon(1, 2), after=[beacon(1, 9)])
    for _ in range(12):
        rescue.now += 1.0
        rescue.mission.fly(rescue.now, AT)
    kind, how = conclusion(rescue.mission)
    assert (kind, in_words(how)) == ("failed", "no good frame from the receiver for 10 s")
    assert len(rescue.mission.victims.places) == 1


def test_the_surest_place_is_probed_first() -> None:
    def victim(id_: int, sigma: float | None, sure: bool = True) -> Victim:
        return Victim(id_, Found(0.0, 0.0, None, None if sigma is None else (sigma**2, 0.0, 0.01)), sure, 10.0 * id_)

    every = [victim(1, 0.1, sure=False), victim(2, None), victim(3, 0.9), victim(4, 0.2)]
    assert [one.id for one in probing_order(every)] == [4, 3, 2, 1]


# -- in the air: everybody has the vehicle back between two as well ----------------------------------------

PLACES = {1: (6.0, 2.0), 2: (-9.0, 4.0)}  # north, east of home


class GoToEach:
    """A strategy that knows: the direction of a reading says whose it is."""

    def __init__(self, speed: float) -> None:
        self.found: Found | None = None
        self._speed = speed
        self._place = PLACES[1]

    def observe(self, observation: Observation) -> None:
        if observation.heard:
            self._place = PLACES[observation.delta_deg]
            if math.dist(observation.position[:2], self._place) < 0.5:
                self.found = Found(*self._place)

    def velocity(self, time_s: float, position: Position) -> Velocity:
        return towards(position, self._place, self._speed)


def two(vehicle: Any, **plan: Any) -> World:
    """A flight to both, up to 3 s on the way from the first to the second."""
    world = World(vehicle, {"host": BINARY_HOST}, strategy=GoToEach, victims=2, **({"height": 2.0} | plan))
    commands, noted = BINARY_HOST.commands(), set[int]()

    def says(now: float) -> bytes:
        truth = world.vehicle.truth(now)
        out, channels = b"", []
        came, world.port.came = world.port.came, b""
        for command in commands.feed(came, now):
            noted.update(command.values if command.name == MARK else ())
            out += BINARY_HOST.answer(CommandAnswer(command.number, command.name, DONE))
        for id_, place in PLACES.items():
            d_cm, _, zone = read(truth, place)
            channels.append(Channel(id_, zone, d_cm, id_, id_ in noted))
        return out + encode(Frame(round(now * 5) % 256, 1, tuple(channels)))

    world.port.says = says
    return world


def between(world: World) -> None:
    """On the way from the first to the second."""
    mission = lambda: world.client.mission  # noqa: E731
    world.until(lambda: mission() and len(mission().victims.places) == 1 and mission().choice.hunting)
    world.pass_s(2)


def test_both_are_found_and_it_lands_on_the_last_one() -> None:
    world = two(ardupilot())
    assert world.end() == ("found", "found")
    outcome = world.client.outcome
    assert {victim.id for victim in outcome.victims} == {1, 2}
    assert all(victim.marked for victim in outcome.victims)
    assert world.ned == pytest.approx((*PLACES[2], 0.0), abs=0.6)
    started = min(row.time_s for row in world.rows if row.phase == "flying" and row.down_m < -1.8)
    landing = max(row.time_s for row in world.rows if row.phase == "flying")
    between_s = [row for row in world.rows if started < row.time_s < landing - 6 and row.phase == "flying"]
    assert all(row.down_m < -1.6 for row in between_s)  # it does not come down between the two


@BOTH
def test_a_pilot_who_takes_over_between_two_hears_no_more_of_it(make: Callable[[], Any]) -> None:
    world = two(make())
    between(world)
    world.pilot(HOLD if isinstance(world.vehicle, Px4) else Mode.LOITER)
    kind, how = world.end(1.5)
    assert (kind, how.endswith("the pilot or a failsafe has taken over")) == ("failed", True)
    let_go = world.clock.now()
    assert world.after(10).orders(let_go) == []
    outcome = world.client.outcome
    assert [victim.id for victim in outcome.victims] == [1]  # what was found is told all the same


def test_a_receiver_that_falls_silent_between_two_makes_it_land() -> None:
    world = two(ardupilot())
    between(world)
    world.port.says = lambda now: None
    stopped = world.clock.now()
    assert world.end() == ("failed", "no good frame from the receiver for 10 s")
    landing = min(row.time_s for row in world.rows if row.phase == "landing")
    assert 9.5 < landing - stopped < 11
    assert (world.ned[2], world.armed) == (pytest.approx(0.0, abs=0.05), False)


def test_a_battery_that_is_low_between_two_ends_it() -> None:
    world = two(ardupilot())
    between(world)
    world.between = says_of_the_battery(SYS_STATUS, LOW)
    assert world.end(2.0) == ("failed", "the battery is not healthy; the pilot has it, in LOITER")


def test_one_that_is_not_sure_is_told_and_not_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(TransmitterReadings, "judged", lambda self, found, height_m: (found, False))
    rescue = Rescue(2, limit_s=60.0)
    rescue.find(beacon(1, 2), beacon(2, 18))
    rescue.find(beacon(1, 2), beacon(2, 18))
    for _ in range(60):
        rescue.step(beacon(2, 18))
    assert [victim.sure for victim in rescue.mission.victims.places] == [False]
    assert in_words(rescue.mission.ended) == "0 of 2 found, 1 not sure in 60 s"
