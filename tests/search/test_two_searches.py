"""Two searches of one vehicle: only one flies it, whichever begins first, and the other names it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from arva_hil.autopilot.following.session import Session
from arva_hil.events.words.reasons import in_words
from arva_hil.links import Link, memory
from arva_hil.mavlink.codec import Parser, decode, dialect
from arva_hil.search.flight.claim import CLAIM_TYPE, Claim, encode, parse
from arva_hil.search.flight.client import SearchClient
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.simulated.vehicle import Simulator
from firmware_proto import Decoder
from tests.search.test_client import BOTH, US, GoTo, Port, World, ardupilot

ORDERS = {
    dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
    dialect.MAVLINK_MSG_ID_COMMAND_LONG,
}
MOVES = {dialect.MAV_CMD_COMPONENT_ARM_DISARM, dialect.MAV_CMD_DO_SET_MODE, dialect.MAV_CMD_NAV_TAKEOFF}


class Pair(World):
    """A world with a second search on a second link of the vehicle."""

    def __init__(self, vehicle: Any, *, forwarded: bool = True, **plan: Any) -> None:
        super().__init__(vehicle, **plan)
        self.second: SearchClient | None = None
        self.second_port: Port | None = None
        self._plan = SearchPlan(**({"strategy": GoTo, "take_off": 2.0, "height": 1.0} | plan))
        self.moved = 0  # orders of the second search
        self.forward(forwarded)

    def forward(self, on: bool) -> None:
        """Let the autopilot forward messages for all from one link to the other, or not."""
        simulator = self._tasks[0]
        assert isinstance(simulator, Simulator)
        self._tasks[0] = Simulator(simulator.vehicles, simulator.links, relays=on)

    def begin_second(self) -> SearchClient:
        receiver, port = memory.pair()
        self.second_port = Port(port, self.frames)
        session = Session(rate_hz=10, component=US)
        start = self.clock.now()
        self.second = SearchClient(self._plan, session, self.others, receiver, Decoder(), start=start)
        self._tap_second(self.others)
        self._tasks += [self.second_port, self.second]
        return self.second

    def _tap_second(self, link: Link) -> None:
        write, parser = link.write, Parser()

        def tapped(data: bytes) -> bool:
            for packet in parser.feed(data):
                message: Any = decode(packet)
                set_point = packet.msgid == dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
                self.moved += set_point or getattr(message, "command", None) in MOVES
            return write(data)

        link.write = tapped  # type: ignore[method-assign]


@BOTH
def test_of_two_that_begin_at_once_one_flies_and_the_other_arms_nothing(make: Callable[[], Any]) -> None:
    world = Pair(make())
    second = world.begin_second()
    world.until(lambda: world.client.outcome or second.outcome, 10.0)
    refused, other = (world.client, second) if world.client.outcome else (second, world.client)
    assert refused.outcome is not None
    assert refused.outcome.kind == "failed"
    assert in_words(refused.outcome.how).startswith("another search (process ")
    assert in_words(refused.outcome.how).endswith(" has this vehicle; end one of the two")
    assert not (world.orders() if refused is world.client else world.moved)
    world.until(lambda: other.outcome)
    assert other.outcome is not None
    assert other.outcome.kind == "found"


@BOTH
@pytest.mark.parametrize("phase", ["idle", "climbing", "flying"])
def test_one_that_begins_later_is_refused_and_moves_nothing(make: Callable[[], Any], phase: str) -> None:
    world = Pair(make(), countdown_s=5.0 if phase == "idle" else 0.0)
    if phase == "idle":
        world.pass_s(3)
    else:
        world.reach(phase)
    second = world.begin_second()
    world.until(lambda: second.outcome, 3.0)
    assert second.outcome is not None
    assert "another search (process " in in_words(second.outcome.how)
    assert world.end() == ("found", "found")
    assert world.moved == 0


@BOTH
def test_of_two_that_fly_it_one_lets_go_as_soon_as_they_are_in_contact(make: Callable[[], Any]) -> None:
    world = Pair(make(), forwarded=False, take_off=4.0, height=4.0)
    second = world.begin_second()
    world.reach("flying")
    assert second.launched
    world.forward(True)
    world.until(lambda: world.client.outcome or second.outcome, 1.5)
    gone, other = (world.client, second) if world.client.outcome else (second, world.client)
    assert gone.outcome is not None
    assert in_words(gone.outcome.how).endswith(" flies this vehicle; this one sends nothing more; end one of the two")
    moved = world.moved
    world.until(lambda: other.outcome)
    assert other.outcome is not None
    assert other.outcome.kind == "found"
    assert gone is world.client or world.moved == moved


def test_without_contact_one_that_somebody_else_puts_in_guided_is_not_armed() -> None:
    world = Pair(ardupilot(), forwarded=False, countdown_s=2.0)
    world.pass_s(1)
    second = world.begin_second()
    world.until(lambda: second.outcome, 3.0)
    assert second.outcome is not None
    assert in_words(second.outcome.how).startswith("another program has set the mode that follows set-points")
    assert world.end() == ("found", "found")
    assert world.moved == 0


def test_without_contact_one_that_somebody_else_arms_is_not_flown() -> None:
    world = Pair(ardupilot(), forwarded=False)
    second = world.begin_second()
    second._flight.wait = lambda now: True  # type: ignore[method-assign]
    world.until(lambda: second.outcome, 20.0)
    assert second.outcome is not None
    assert in_words(second.outcome.how).startswith("another program or person has armed it")
    assert world.end() == ("found", "found")


def test_a_claim_is_passed_on_unchanged_and_nothing_else_is_a_claim() -> None:
    claim = Claim(True, 123_456, 2**64 - 1, "process 7 on drone-1")
    payload = encode(claim)
    assert parse(payload) == claim
    assert parse(encode(claim._replace(name="é" * 100))) == claim._replace(name="?" * 64)
    for wrong in (b"", payload[:17], b"\2" + payload[1:], payload[:1] + b"\2" + payload[2:], payload + bytes(60)):
        assert parse(wrong) is None
    assert parse(payload[:-1] + b"\n") is None


def test_who_flies_goes_first_then_who_began_first() -> None:
    old, new = Claim(False, 10, 9, "old"), Claim(False, 20, 1, "new")
    assert old.precedes(new)
    assert not new.precedes(old)
    assert new._replace(launched=True).precedes(old)
    assert old._replace(launched=True).precedes(new._replace(launched=True))
    assert old._replace(since_ms=20, number=0).precedes(new)


def test_its_own_claim_that_comes_back_is_none_of_another_search() -> None:
    world = World(ardupilot())
    claims: list[bytes] = []
    parser, read, between = Parser(), world.far.read, world.between

    def reading() -> bytes:
        data = read()
        for packet in parser.feed(data):
            message: Any = decode(packet)
            if packet.msgid == dialect.MAVLINK_MSG_ID_TUNNEL and message.payload_type == CLAIM_TYPE:
                claims.append(packet.raw)
        return data

    def echoed(data: bytes) -> bytes:
        data, claims[:] = between(data) + b"".join(claims), []
        return data

    world.far.read = reading  # type: ignore[method-assign]
    world.between = echoed
    assert world.end() == ("found", "found")
    assert math.dist(world.ned, (8.0, 3.0, 0.0)) < 1.0
