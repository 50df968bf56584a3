"""`--gcs`: what a ground station decodes of a search, by pymavlink's own decoder."""

from __future__ import annotations

import math
from typing import Any

import pytest

from arva_hil.clock import StepClock
from arva_hil.config import DEFAULT
from arva_hil.events import Event, StatusReport
from arva_hil.events.searches import BeliefChanged, FrameHeard, FromSearch, PlaceFound, TakeOffPoint, TransmitterChosen
from arva_hil.links import Link, memory
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.model.field import LocalFrame
from arva_hil.observers.ground_station import GroundStation
from arva_hil.runtime.loop import run
from arva_hil.search.strategies.estimate import Estimate
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.simulated import HOME
from arva_hil.simulated.closed_loop import ClosedLoop, in_memory
from firmware_proto import MID, Channel, Frame

FRAME = Frame(1, 1, (Channel(9, MID, 4500, -40), Channel(4, MID, 2000, 10)))
TAKE_OFF = TakeOffPoint(0.0, *HOME)
BELIEF = BeliefChanged(3.0, 4, [(-20.0, -5.0, 0.25), (20.0, 5.0, 0.75)], (0.04, 0.0, 0.01), None)
FOUND = PlaceFound(9.0, 4, 18.0, 6.0, (0.04, 0.0, 0.01), True)


def decoded(link: Link) -> list[Any]:
    """All that has come, by pymavlink."""
    return dialect.MAVLink(None).parse_buffer(bytearray(link.read())) or []


def told(*events: Event, system: int | None = 7) -> list[Any]:
    ours, theirs = memory.pair()
    station = GroundStation(ours, lambda: system, 193)
    for event in events:
        station.observe(event)
    return decoded(theirs)


def heard(time_s: float, frame: Frame = FRAME) -> FrameHeard:
    return FrameHeard(time_s, frame, (0.0, 0.0, -3.0), 0.0)


def on_map(messages: list[Any]) -> list[Any]:
    return [message for message in messages if message.get_type() == "ADSB_VEHICLE"]


def values(messages: list[Any]) -> dict[str, float]:
    named = [message for message in messages if message.get_type() == "NAMED_VALUE_FLOAT"]
    return {message.name: message.value for message in named}


def test_the_place_found_is_on_the_map_fresh_and_with_valid_coordinates() -> None:
    (place,) = on_map(told(TAKE_OFF, FOUND))
    lat, lon, _ = (float(value) for value in LocalFrame(*HOME).lla([18.0, 6.0, 0.0]))
    assert (place.lat, place.lon) == (round(lat * 1e7), round(lon * 1e7))
    assert (place.callsign, place.tslc, place.altitude) == ("ARVA4", 0, 1_650_000)
    assert place.flags == dialect.ADSB_FLAGS_VALID_COORDS | dialect.ADSB_FLAGS_VALID_CALLSIGN
    assert place.emitter_type == dialect.ADSB_EMITTER_TYPE_POINT_OBSTACLE


def test_it_comes_from_the_vehicles_system_and_from_no_autopilot() -> None:
    messages = told(TAKE_OFF, FOUND)
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in messages} == {(7, 193)}
    heartbeat = messages[0]
    assert (heartbeat.type, heartbeat.autopilot) == (dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID)


def test_before_it_is_found_the_likeliest_place_is_shown_as_a_question() -> None:
    (place,) = on_map(told(TAKE_OFF, BELIEF))
    lat, _, _ = (float(value) for value in LocalFrame(*HOME).lla([20.0, 5.0, 0.0]))
    assert (place.callsign, place.lat) == ("ARVA4?", round(lat * 1e7))
    later = on_map(told(TAKE_OFF, BELIEF, FOUND, BeliefChanged(10.5, 4, [(0.0, 0.0, 1.0)], None, None)))
    assert [place.callsign for place in later] == ["ARVA4?", "ARVA4", "ARVA4"]


def test_the_reading_of_the_transmitter_searched_for_is_told_in_values() -> None:
    said = values(told(TAKE_OFF, BELIEF, heard(4.0)))
    assert said == pytest.approx({"arva_d": 20.0, "arva_delta": 10, "arva_zone": 1, "arva_id": 4, "arva_sigma": 0.2})
    said = values(told(heard(1.0)))
    assert said == pytest.approx({"arva_d": 45.0, "arva_delta": -40, "arva_zone": 1, "arva_id": 9})
    assert values(told(heard(1.0, Frame(1, 1, (Channel(),)))))["arva_d"] == -1


def test_all_is_told_once_a_second_and_what_is_found_at_once() -> None:
    messages = told(TAKE_OFF, *(heard(n / 10) for n in range(50)))
    assert sum(m.get_type() == "HEARTBEAT" for m in messages) == 5
    assert len(on_map(told(TAKE_OFF, heard(8.9), FOUND))) == 1


def test_nothing_is_told_while_the_vehicle_is_not_known_and_of_no_emulator() -> None:
    assert (told(TAKE_OFF, FOUND, system=None), told(StatusReport(0.0, []))) == ([], [])


def test_frames_without_ids_have_a_place_too() -> None:
    (place,) = on_map(told(TAKE_OFF, PlaceFound(9.0, None, 18.0, 6.0, None, True)))
    assert place.callsign == "ARVA"


def test_of_several_each_place_stays_on_the_map() -> None:
    chosen, second = TransmitterChosen(10.0, 5, 20.0), PlaceFound(20.0, 5, 1.0, 2.0, None, True)
    places = on_map(told(TAKE_OFF, FOUND, chosen, second))
    assert [place.callsign for place in places[-2:]] == ["ARVA4", "ARVA5"]


def test_a_search_that_finds_shows_where_and_the_vehicle_hears_nothing_of_it() -> None:
    ours, theirs = memory.pair()
    clock, commands = StepClock(), memory.pair()
    station = GroundStation(ours, lambda: 1, 193)
    to_vehicle = bytearray()
    write = commands[0].write
    commands[0].write = lambda data: to_vehicle.extend(data) or write(data)  # type: ignore[method-assign, func-returns-value]
    loop = ClosedLoop(
        DEFAULT,
        SearchPlan(Estimate),
        start=0.0,
        stream_hz=10.0,
        wires=[in_memory()._replace(commands=commands)],
        observers=[station],
    )
    run(loop.tasks, clock, until=200.0, stopped=lambda: loop.drones[0].search.outcome is not None)
    found = loop.drones[0].search.mission.found if loop.drones[0].search.mission else None
    places = on_map(decoded(theirs))
    lat, lon, _ = (float(value) for value in LocalFrame(*HOME).lla([found.north, found.east, 0.0]))
    assert math.dist((places[-1].lat / 1e7, places[-1].lon / 1e7), (lat, lon)) < 1e-6
    assert {place.callsign for place in places} == {"ARVA1?", "ARVA1"}
    ordered = dialect.MAVLink(None).parse_buffer(to_vehicle) or []
    assert ordered
    assert not {m.get_type() for m in ordered} & {"ADSB_VEHICLE", "NAMED_VALUE_FLOAT"}


def test_a_mark_that_somebody_forwards_to_the_autopilot_is_not_shown_any_more() -> None:
    ours, theirs = memory.pair()
    clock, commands = StepClock(), memory.pair()
    station, wires = GroundStation(ours, lambda: 1, 193), [in_memory()._replace(commands=commands)]
    loop = ClosedLoop(DEFAULT, SearchPlan(Estimate), start=0.0, stream_hz=10.0, wires=wires, observers=[station])
    shown: list[Any] = []

    def forwarded() -> bool:
        shown.extend(on_map(decoded(theirs)))
        return bool(shown)

    run(loop.tasks, clock, until=60.0, stopped=forwarded)
    assert len(shown) == 1
    other = Encoder(2, 193).pack(shown[0])  # of a search that flies another vehicle
    commands[1].write(other)
    run(loop.tasks, clock, until=clock.now() + 3.0, stopped=lambda: False)
    assert on_map(decoded(theirs)) != []
    commands[1].write(Encoder(1, 193).pack(shown[0]))  # the autopilot passes on what it gets on its other links
    run(loop.tasks, clock, until=clock.now() + 10.0, stopped=lambda: False)
    messages = decoded(theirs)
    assert on_map(messages) == []
    assert values(messages)["arva_id"] == 1  # readings are still told


def test_events_of_a_search_beside_an_emulator_count_too() -> None:
    assert len(on_map(told(FromSearch(0.0, TAKE_OFF), FromSearch(9.0, FOUND)))) == 1
