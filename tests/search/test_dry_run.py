"""A dry run does everything but arm and move: it says what a search would order, and nothing of it leaves."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import pytest

from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import ConsentNeeded, CountDown, DryRunBegun, SetPointPlanned, WouldOrder
from arva_hil.events.words.reasons import in_words
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.search.flight.preflight import Permission
from arva_hil.simulated.vehicle import SimulatedVehicle
from tests.search.test_client import BOTH, VICTIM, Broken, World, ardupilot
from tests.search.test_permission import Person, truthless
from tests.search.test_take_over import airborne
from tests.simulated_px4 import Px4

SENT = {  # all that a dry run may send
    "HEARTBEAT",
    "COMMAND_LONG",
    "PARAM_REQUEST_READ",
    "REQUEST_DATA_STREAM",
    "TIMESYNC",
}
QUESTIONS = {
    dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
    dialect.MAV_CMD_REQUEST_MESSAGE,
    dialect.MAV_CMD_GET_HOME_POSITION,
}


def dry(vehicle: SimulatedVehicle | Px4, client: dict[str, Any] | None = None, **plan: Any) -> World:
    return World(vehicle, {"dry_run": True, "timeout_s": 20.0} | (client or {}), **plan)


def planned(world: World) -> list[WouldOrder]:
    return [event for event in world.events if isinstance(event, WouldOrder)]


def nothing_moves(world: World) -> None:
    assert {message.get_type() for _, message in world.told} <= SENT
    assert {m.command for _, m in world.told if m.get_type() == "COMMAND_LONG"} <= QUESTIONS
    assert world.orders() == []
    assert not world.armed
    assert world.ned == pytest.approx((0.0, 0.0, 0.0), abs=0.01)


@BOTH
@pytest.mark.parametrize("land", [True, False])
def test_it_says_in_order_what_a_search_orders_and_orders_nothing(make: Callable[[], Any], land: bool) -> None:
    world = dry(make(), {"countdown_s": 3.0, "land": land})
    assert world.end(60.0) == ("would fly", in_words(because(Why.WOULD_FLY)))
    world.pass_s(5)
    nothing_moves(world)
    flown = World(make(), {"land": land})
    flown.end()
    commands = [(m.command, m.param2, m.param3) for m in flown.orders() if m.get_type() == "COMMAND_LONG"]
    ordered = [dialect.enums["MAV_CMD"][number].name for (number, *_), _ in itertools.groupby(commands)]
    assert [f"MAV_CMD_{event.order}" for event in planned(world)] == ordered
    (begun,) = (event for event in world.events if isinstance(event, DryRunBegun))
    assert begun.countdown_s == 3.0
    assert not [event for event in world.events if isinstance(event, CountDown)]  # nothing begins at its end


@BOTH
def test_its_set_points_are_those_for_the_readings_of_now(make: Callable[[], Any]) -> None:
    world = dry(make(), height=2.0)
    world.end(60.0)
    said = [event for event in world.events if isinstance(event, SetPointPlanned)]
    assert 4 <= len(said) <= 6
    share = 1 / math.hypot(*VICTIM)
    first, *others = said
    if first.v_down < 0:  # no barometer was heard yet: it would climb before all else
        assert (first.v_north, first.v_east) == (0.0, 0.0)
    else:
        others.append(first)
    for event in others:
        assert (event.v_north, event.v_east) == pytest.approx((VICTIM[0] * share, VICTIM[1] * share), abs=0.01)
    assert said[-1].v_down == pytest.approx(0.0, abs=0.1)  # as at the height of the take-off, not as on the ground
    assert said[-1].rate_hz == 5.0
    assert {row.phase for row in world.rows} == {"dry run"}
    assert [row.d_cm for row in world.rows if row.d_cm]


@BOTH
def test_a_vehicle_in_the_air_would_be_taken_over(make: Callable[..., Any]) -> None:
    world = dry(airborne(make, height=6.0), {"take_over": True}, height=6.0)
    assert world.end(60.0) == ("would fly", in_words(because(Why.WOULD_FLY)))
    assert world.orders() == []
    assert world.armed
    assert world.ned == pytest.approx((0.0, 0.0, -6.0), abs=0.9)
    assert [event.order for event in planned(world)] == ["DO_SET_MODE", "NAV_LAND"]
    last = [event for event in world.events if isinstance(event, SetPointPlanned)][-1]
    assert math.hypot(last.v_north, last.v_east) == pytest.approx(1.0, abs=0.01)


# -- it would not have flown -------------------------------------------------------------------------------


def test_no_frame_is_no_link() -> None:
    world = dry(ardupilot())
    world.port.says = lambda now: None
    kind, how = world.end(60.0)
    assert (kind, how.partition(":")[0]) == ("no link", "no frame from the receiver at memory")
    assert planned(world) == []
    nothing_moves(world)


def test_a_strategy_that_fails_would_fail() -> None:
    world = dry(ardupilot(), strategy=Broken)
    kind, how = world.end(60.0)
    assert kind == "failed"
    assert how.startswith("dry run: the strategy has failed: ZeroDivisionError(")
    assert how.endswith("; nothing was ordered")
    nothing_moves(world)


def test_a_vehicle_that_cannot_be_flown_so_is_refused_as_in_earnest() -> None:
    world = dry(ardupilot())
    parser, encoder = Parser(), Encoder(1, 1)

    def winged(data: bytes) -> bytes:
        messages: list[Any] = [decode(packet) for packet in parser.feed(data)]
        for message in messages:
            if message.get_type() == "HEARTBEAT":
                message.type = dialect.MAV_TYPE_FIXED_WING
        return b"".join(map(encoder.pack, messages))

    world.between = winged
    assert world.end(60.0) == ("failed", "ardupilotmega fixed_wing 1/1 is not a multirotor")
    nothing_moves(world)


@BOTH
def test_interrupted_nothing_has_to_be_undone(make: Callable[[], Any]) -> None:
    world = dry(make())
    world.until(lambda: planned(world))
    world.client.stop()
    assert world.end(1.0) == ("failed", "interrupted")
    nothing_moves(world)


# -- consent -----------------------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("person", [None, Person("no")])
def test_a_person_is_not_asked_but_it_is_said_that_they_would_be(
    make: Callable[[], Any], person: Person | None
) -> None:
    world = dry(make())
    world.client._preflight._permission = Permission(world.session, question=person, dry_run=True)
    world.between = truthless
    assert world.end(60.0) == ("would fly", in_words(because(Why.WOULD_FLY)))
    (needed,) = (event for event in world.events if isinstance(event, ConsentNeeded))
    assert needed.asked is (person is not None)
    assert person is None or person.asked == []
    nothing_moves(world)
