"""A simulator is armed at once; any other vehicle only when a person has said yes."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import pytest

from arva_hil.mavlink.codec import Encoder, Parser, dialect
from arva_hil.search.flight.preflight import Permission
from arva_hil.simulated.vehicle import SimulatedVehicle
from tests.search.test_client import BOTH, HOME, World
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
