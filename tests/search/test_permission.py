"""A simulator is armed at once; any other vehicle only when a person has said yes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import pytest

from arva_hil.autopilot.following.session import Session
from arva_hil.events.words.reasons import in_words
from arva_hil.links import Link, memory
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.search.flight.claim import CLAIM_TYPE, Claim, encode, parse
from arva_hil.search.flight.client import SearchClient
from arva_hil.search.flight.preflight import Permission
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.simulated import arducopter
from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator
from firmware_proto import Decoder
from tests import simulated_px4
from tests.search.test_client import BOTH, HOME, US, GoTo, Port, World, ardupilot, px4
from tests.simulated_px4 import Px4

TRUTHS = (
    dialect.MAVLINK_MSG_ID_SIMSTATE,
    dialect.MAVLINK_MSG_ID_SIM_STATE,
    dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION,
)


class Person:
    """Sits at a terminal and types `line` when they have thought for so many looks of the program."""

    def __init__(self, line: str, looks: int = 0) -> None:
        self.asked: list[str] = []
        self._line = line
        self._looks = looks

    def ask(self, label: str) -> None:
        self.asked.append(label)

    def answer(self) -> str | None:
        self._looks -= 1
        return self._line if self._looks < 0 else None


def truthless(data: bytes) -> bytes:
    """What a vehicle says that is no simulator; it may well acknowledge what it was asked for."""
    return b"".join(packet.raw for packet in Parser().feed(data) if packet.msgid not in TRUTHS)


def world_of(vehicle: SimulatedVehicle | Px4, timeout_s: float = 5.0, **permission: Any) -> World:
    world = World(vehicle, {"timeout_s": timeout_s})
    permit = Permission(world.session, **permission)
    world.client._preflight._permission = permit
    return world


def real(make: Callable[[], Any], **permission: Any) -> World:
    world = world_of(make(), **permission)
    world.between = truthless
    return world


@BOTH
def test_a_simulator_is_armed_without_a_question(make: Callable[[], Any]) -> None:
    person = Person("no")
    world = world_of(make(), question=person)
    world.reach("climbing")
    assert person.asked == []
    assert sum("is a simulator: it answers with " in said for said in world.said) == 1


def is_refused(world: World, why: str) -> None:
    kind, how = world.end(90.0)
    assert kind == "refused"
    assert how.endswith(why)
    assert world.orders() == []


@BOTH
def test_without_a_word_and_a_terminal_nothing_else_is_armed(make: Callable[[], Any]) -> None:
    is_refused(real(make), "is not known to be a simulator: to let it fly, write --yes")


@BOTH
def test_a_yes_beforehand_is_enough(make: Callable[[], Any]) -> None:
    world = real(make, yes=True)
    world.reach("climbing")
    assert sum("is not known to be a simulator; --yes allows the flight" in said for said in world.said) == 1


@BOTH
def test_a_yes_at_the_terminal_is_waited_for_while_the_vehicle_hears_of_us(make: Callable[[], Any]) -> None:
    person = Person(" Yes ", looks=100)
    world = real(make, question=person)
    world.until(lambda: person.asked)
    asked = world.clock.now()
    world.until(lambda: world.orders())
    assert world.clock.now() - asked > 15  # longer than the time-out, which is for the vehicle
    beats = [at for at, message in world.told if message.get_type() == "HEARTBEAT"]
    assert max(b - a for a, b in itertools.pairwise(beats)) < 1.5
    assert len(person.asked) == 1
    world.reach("climbing")


@pytest.mark.parametrize("line", ["no", "", "y", "yes please", "\x1b[A"])
def test_any_other_answer_is_no(line: str) -> None:
    world = real(lambda: SimulatedVehicle(HOME), question=Person(line))
    is_refused(world, "the answer was not yes: nothing was done")


def test_a_person_who_is_not_there_does_not_hold_it_for_ever() -> None:
    world = real(lambda: SimulatedVehicle(HOME), question=Person("yes", looks=10**6))
    is_refused(world, "no person typed yes within 60 s: nothing was done")


def test_the_truth_of_a_simulator_elsewhere_is_not_this_vehicles() -> None:
    world = world_of(SimulatedVehicle(HOME))
    other = SimulatedVehicle((HOME[0] + 0.01, *HOME[1:]))

    def mixed(data: bytes) -> bytes:
        now = world.clock.now()
        told = Parser().feed(other.poll(now))
        return truthless(data) + b"".join(packet.raw for packet in told if packet.msgid in TRUTHS)

    ask = dialect.MAVLink_command_long_message(
        1, 1, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 0, dialect.MAVLINK_MSG_ID_SIMSTATE, 1e5, 0, 0, 0, 0, 0
    )
    other.feed(Encoder(255, 190).pack(ask), 0.0)
    world.between = mixed
    assert world.end()[0] == "refused"
    assert world.orders() == []


def test_what_held_for_a_vehicle_does_not_hold_after_it_has_rebooted() -> None:
    world = world_of(SimulatedVehicle(HOME), 30.0)
    says, world.port.says = world.port.says, lambda now: None
    world.until(lambda: world.client._preflight._permission._check.answer)
    world.pass_s(5.0)
    world.between = truthless
    world.vehicle.reboot(world.clock.now())
    world.until(lambda: world.session.navigation.reboots)
    world.port.says = says
    assert world.end()[0] == "refused"
    assert world.orders() == []


# -- Two searches of one vehicle: only one flies it, whichever begins first, and the other names it -------


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


# -- A fence inside the area is said before the vehicle is armed; beyond it there is no flight ------------


ON = {"FENCE_ENABLE": 1, "FENCE_TYPE": 3}


def fenced(patch: pytest.MonkeyPatch, make: Callable[[], Any], values: dict[str, float], **plan: Any) -> World:
    parameters = simulated_px4.PARAMETERS if make is px4 else arducopter._VALUES
    for name, value in values.items():
        patch.setitem(parameters, name, value)
    return World(make(), **plan)


@pytest.mark.parametrize(
    ("make", "values", "said"),
    [
        (
            ardupilot,
            ON | {"FENCE_RADIUS": 60},
            "71 m from the take-off point, beyond the vehicle's fence (FENCE_RADIUS",
        ),
        (ardupilot, ON | {"FENCE_TYPE": 4, "FENCE_TOTAL": 5}, "which is not compared with the area (FENCE_TOTAL 5)"),
        (px4, {"GF_MAX_HOR_DIST": 60.0}, "beyond the vehicle's fence (GF_MAX_HOR_DIST 60)"),
        (ardupilot, ON | {"FENCE_RADIUS": 80}, ""),
        (ardupilot, ON | {"FENCE_RADIUS": 60, "FENCE_TYPE": 1}, ""),
        (ardupilot, {"FENCE_RADIUS": 60}, ""),
        (px4, {"GF_MAX_HOR_DIST": 60.0, "GF_ACTION": 0}, ""),
    ],
)
def test_a_fence_inside_the_area_is_said_before_it_is_armed(
    monkeypatch: pytest.MonkeyPatch, make: Callable[[], Any], values: dict[str, float], said: str
) -> None:
    world = fenced(monkeypatch, make, values)
    world.reach("arming")
    found = [text for text in world.said if "fence" in text]
    assert len(found) == bool(said)
    assert all(said in text for text in found)


@pytest.mark.parametrize(
    ("make", "values", "plan", "how"),
    [
        (
            ardupilot,
            ON | {"FENCE_ALT_MAX": 10},
            {"height": 12.0},
            "the height is beyond the vehicle's fence (FENCE_ALT_MAX 10), 12 m needed; nothing was armed",
        ),
        (
            px4,
            {"GF_MAX_VER_DIST": 5.0},
            {"take_off": 6.0},
            "the height is beyond the vehicle's fence (GF_MAX_VER_DIST 5), 6 m needed; nothing was armed",
        ),
        (
            px4,
            {"GF_MAX_HOR_DIST": 30.0},
            {"area": (40.0, -10.0, 60.0, 10.0)},
            "the whole area is beyond the vehicle's fence (GF_MAX_HOR_DIST 30), 40 m needed; nothing was armed",
        ),
    ],
)
def test_beyond_the_fence_nothing_is_armed(
    monkeypatch: pytest.MonkeyPatch, make: Callable[[], Any], values: dict[str, float], plan: dict[str, Any], how: str
) -> None:
    world = fenced(monkeypatch, make, values, **plan)
    assert world.end() == ("failed", how)
    assert world.orders() == []
