"""Who may fly a vehicle: permission, one search of two, fences, take-over in the air, and the dry run."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from arva_hil.autopilot.following.session import Session
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import ConsentNeeded, CountDown, DryRunBegun, SetPointPlanned, WouldOrder
from arva_hil.events.words.reasons import in_words
from arva_hil.links import Link, memory
from arva_hil.mavlink.codec import Encoder, Parser, command, decode, dialect
from arva_hil.search.flight.client import SearchClient
from arva_hil.search.flight.links import CLAIM_TYPE, Claim
from arva_hil.search.flight.preflight import Permission
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.simulated import arducopter
from arva_hil.simulated.autopilot import Mode
from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator
from firmware_proto import Decoder
from tests import simulated_px4
from tests.search.test_client import (
    BOTH,
    HOME,
    US,
    VICTIM,
    Broken,
    GoTo,
    Plugged,
    Port,
    World,
    ardupilot,
    changed,
    delay,
    flown,
    px4,
    silent,
    unchanged,
    winged,
)
from tests.simulated_px4 import HOLD, POSITION, Px4

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


@pytest.mark.parametrize("line", ["", "y", "yes please"])
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


def test_nor_after_a_pause_in_which_it_may_have_become_another_one() -> None:
    world = world_of(SimulatedVehicle(HOME), 30.0)
    says, world.port.says = world.port.says, lambda now: None
    world.until(lambda: world.client._preflight._permission._check.answer)
    world.between = truthless
    world.clock.wait(world.clock.now() + 2.0)
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


def goes_on(world: World, client: SearchClient) -> None:
    """It flies towards its transmitter."""
    world.until(lambda: client.outcome or math.hypot(*world.ned[:2]) > 3.0, 30.0)
    assert client.outcome is None


@BOTH
def test_of_two_that_begin_at_once_one_flies_and_the_other_arms_nothing(make: Callable[[], Any]) -> None:
    world = Pair(make())
    second = world.begin_second()
    world.until(lambda: world.client.outcome or second.outcome, 10.0)
    refused, other = (world.client, second) if world.client.outcome else (second, world.client)
    assert refused.outcome.kind == "failed"
    assert in_words(refused.outcome.how).startswith("another search (process ")
    assert in_words(refused.outcome.how).endswith(" has this vehicle; end one of the two")
    assert not (world.orders() if refused is world.client else world.moved)
    goes_on(world, other)


@pytest.mark.parametrize(("make", "phase"), [(px4, "idle"), (ardupilot, "climbing"), (px4, "flying")])
def test_one_that_begins_later_is_refused_and_moves_nothing(make: Callable[[], Any], phase: str) -> None:
    world = Pair(make(), countdown_s=5.0 if phase == "idle" else 0.0)
    if phase == "idle":
        world.pass_s(3)
    else:
        world.reach(phase)
    second = world.begin_second()
    world.until(lambda: second.outcome, 3.0)
    assert "another search (process " in in_words(second.outcome.how)
    goes_on(world, world.client)
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
    assert in_words(gone.outcome.how).endswith(" flies this vehicle; this one sends nothing more; end one of the two")
    moved = world.moved
    goes_on(world, other)
    assert gone is world.client or world.moved == moved


def test_without_contact_one_that_somebody_else_puts_in_guided_is_not_armed() -> None:
    world = Pair(ardupilot(), forwarded=False, countdown_s=2.0)
    world.pass_s(1)
    second = world.begin_second()
    world.until(lambda: second.outcome, 3.0)
    assert in_words(second.outcome.how).startswith("another program has set the mode that follows set-points")
    goes_on(world, world.client)
    assert world.moved == 0


def test_without_contact_one_that_somebody_else_arms_is_not_flown() -> None:
    world = Pair(ardupilot(), forwarded=False)
    second = world.begin_second()
    second._flight.wait = lambda now: True  # type: ignore[method-assign]
    world.until(lambda: second.outcome, 20.0)
    assert in_words(second.outcome.how).startswith("another program or person has armed it")
    goes_on(world, world.client)


def test_a_claim_is_passed_on_unchanged_and_nothing_else_is_a_claim() -> None:
    claim = Claim(True, 123_456, 2**64 - 1, "process 7 on drone-1")
    payload = claim.encode()
    assert Claim.parse(payload) == claim
    assert Claim.parse(claim._replace(name="é" * 100).encode()) == claim._replace(name="?" * 64)
    for wrong in (b"", payload[:17], b"\2" + payload[1:], payload[:1] + b"\2" + payload[2:], payload + bytes(60)):
        assert Claim.parse(wrong) is None
    assert Claim.parse(payload[:-1] + b"\n") is None


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
        (
            ardupilot,
            ON | {"FENCE_ENABLE": 0, "FENCE_AUTOENABLE": 3, "FENCE_RADIUS": 60},
            "beyond the vehicle's fence (FENCE_RADIUS 60)",
        ),
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


def test_parameters_are_asked_for_again_after_a_loss_of_the_link(monkeypatch: pytest.MonkeyPatch) -> None:
    world = Plugged(ardupilot(), {"countdown_s": 3.0})
    world.until(lambda: "arming in 2 s" in world.said)
    world.plugs[0].pull()
    world.pass_s(3)
    for name, value in (ON | {"FENCE_ALT_MAX": 1.0}).items():
        monkeypatch.setitem(arducopter._VALUES, name, value)
    world.vehicle.reboot(world.clock.now())
    world.plugs[0].there = True
    assert "beyond the vehicle's fence (FENCE_ALT_MAX 1), 2 m needed" in world.fail(60.0)
    assert world.orders() == []


@pytest.mark.parametrize(
    ("make", "values", "plan", "how"),
    [
        (
            ardupilot,
            ON | {"FENCE_ALT_MAX": 10},
            {"height": 12.0},
            "the height is beyond the vehicle's fence (FENCE_ALT_MAX 10), 12 m needed; nothing was ordered",
        ),
        (
            px4,
            {"GF_MAX_VER_DIST": 5.0},
            {"take_off": 6.0},
            "the height is beyond the vehicle's fence (GF_MAX_VER_DIST 5), 6 m needed; nothing was ordered",
        ),
        (
            px4,
            {"GF_MAX_HOR_DIST": 30.0},
            {"area": (40.0, -10.0, 60.0, 10.0)},
            "the whole area is beyond the vehicle's fence (GF_MAX_HOR_DIST 30), 40 m needed; nothing was ordered",
        ),
        (
            ardupilot,
            ON | {"FENCE_TYPE": 8, "FENCE_ALT_MIN": 4.0},
            {"height": 3.0, "land": False},
            "the height is beyond the vehicle's fence (FENCE_ALT_MIN 4), 3 m needed; nothing was ordered",
        ),
        (
            ardupilot,
            ON | {"FENCE_TYPE": 8, "FENCE_ALT_MIN": 2.0},
            {"height": 3.0},
            "the height is beyond the vehicle's fence (FENCE_ALT_MIN 2), 0.5 m needed; nothing was ordered",
        ),
    ],
)
def test_beyond_the_fence_nothing_is_armed(
    monkeypatch: pytest.MonkeyPatch, make: Callable[[], Any], values: dict[str, float], plan: dict[str, Any], how: str
) -> None:
    world = fenced(monkeypatch, make, values, **plan)
    assert world.end() == ("failed", how)
    assert world.orders() == []


@pytest.mark.parametrize("values", [{"FENCE_ALT_MIN": 2.0}, {"FENCE_TYPE": 7, "FENCE_ALT_MIN": 9.0}])
def test_a_fence_below_the_flight_is_no_reason_against_it(
    monkeypatch: pytest.MonkeyPatch, values: dict[str, float]
) -> None:
    world = fenced(monkeypatch, ardupilot, ON | {"FENCE_TYPE": 15} | values, height=3.0, land=False)
    world.reach("arming")
    assert not [text for text in world.said if "fence" in text]


# -- A search that begins in the air: only on request, only from a hover, and by the pilot's leave --------


BEFORE_S = 25.0


def airborne(
    make: Callable[..., Any], *, height: float = 6.0, at: tuple[float, float] = (0.0, 0.0), mode: int | None = None
) -> Any:
    """A vehicle that somebody has flown there, up to second 0, and left in this mode; default: LOITER, or hold."""
    vehicle = make(boot_time=-BEFORE_S)
    now, encoder = -BEFORE_S, Encoder(255, 190)
    is_px4 = isinstance(vehicle, Px4)

    def tell(message: Any, then_s: float) -> None:
        nonlocal now
        vehicle.feed(encoder.pack(message), now)
        for _ in range(round(then_s * 2)):
            now += 0.5
            vehicle.poll(now)

    def order(number: int, *params: float, then_s: float = 0.5) -> None:
        tell(command(1, 1, number, *params), then_s)

    def enter(wanted: int, then_s: float = 0.5) -> None:
        main, sub = (wanted >> 16 & 255, wanted >> 24) if is_px4 else (wanted, 0)
        order(dialect.MAV_CMD_DO_SET_MODE, 1, main, sub, then_s=then_s)

    if is_px4:
        nowhere = (math.nan,) * 3
        order(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        order(dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, *nowhere, vehicle._ground_amsl + height, then_s=15)
    else:
        enter(Mode.GUIDED)
        order(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        order(dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height, then_s=9)
        place = (*at, -height)
        tell(
            dialect.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0xFF8, *place, 0, 0, 0, 0, 0, 0, 0, 0),
            14,
        )
    tell(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), -now - 0.5)
    enter((HOLD if is_px4 else Mode.LOITER) if mode is None else mode, then_s=0.5)
    return vehicle


def taking_over(vehicle: Any, **client: Any) -> World:
    return World(vehicle, {"take_over": True} | client)


@BOTH
def test_a_vehicle_that_hovers_is_taken_over_searches_and_lands(make: Callable[..., Any]) -> None:
    world = taking_over(airborne(make))
    assert world.end() == ("found", "found")
    assert not world.armed
    commands = {getattr(m, "command", None) for m in world.orders()}
    assert not commands & {dialect.MAV_CMD_COMPONENT_ARM_DISARM, dialect.MAV_CMD_NAV_TAKEOFF}
    assert "taking over" in " ".join(world.said)


def test_heights_are_above_home_and_places_from_where_it_hovered() -> None:
    world = taking_over(airborne(ardupilot, at=(10.0, -4.0)))
    world.reach("flying")
    world.until(lambda: len(world.rows) > 2)
    first = world.rows[0]
    assert (first.north_m, first.east_m) == pytest.approx((0.0, 0.0), abs=0.3)
    assert first.down_m == pytest.approx(-6.0, abs=0.3)
    world.until(lambda: world.ned[2] > -1.6)
    assert world.client.origin.lla([0.0, 0.0, 0.0])[2] == pytest.approx(1650.0, abs=0.1)


@pytest.mark.parametrize(("off_m", "north_m", "taken"), [(2, 0, False), (1, 0, True), (5, 3, False), (5, 5, True)])
def test_a_rangefinder_that_contradicts_the_height_above_home_leads_no_take_over(
    off_m: int, north_m: float, taken: bool
) -> None:
    """It would lead the vehicle to the ground. Far from home the ground may be lower."""
    world = taking_over(airborne(ardupilot, at=(north_m, 0.0)), height=3.0, timeout_s=4.0)
    message = dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR
    world.between = changed(message, "current_distance", lambda cm: cm + 100 * off_m)
    world.until(lambda: world.client.outcome or world.client.launched)
    assert (world.client.outcome is None) == taken
    if not taken:
        why = f"the rangefinder measures {6 + off_m}.0 m, but it is 6.0 m above home"
        assert world.fail() == f"the vehicle is not taken over: {why}"


@BOTH
def test_without_a_rangefinder_it_searches_no_lower_than_it_hovered(make: Callable[..., Any]) -> None:
    """The ground there may be higher than home, here by 5 m."""
    world = taking_over(airborne(partial(make, sensors=dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE)), height=3.0)
    world.between = changed(dialect.MAVLINK_MSG_ID_HOME_POSITION, "altitude", lambda mm: mm - 5000)
    lowest = math.inf

    def arrived() -> bool:
        nonlocal lowest
        lowest = min(lowest, -world.ned[2])
        return world.client.mission is not None and world.client.mission.ended is not None

    world.until(arrived)
    assert math.dist(world.ned[:2], VICTIM) < 2.5
    assert lowest > 5.5
    assert world.end() == ("found", "found")


@pytest.mark.parametrize(
    ("vehicle", "why"),
    [
        (lambda: airborne(ardupilot, mode=Mode.RTL), "it is in RTL"),  # a failsafe's
        (lambda: airborne(ardupilot, mode=Mode.STABILIZE), "it is in STABILIZE"),  # the pilot's
        (lambda: airborne(px4, mode=POSITION), "it is in position"),
        (lambda: airborne(ardupilot, height=0.7), "m above home, less than 1 m"),
        (ardupilot, "it is not armed"),
    ],
)
def test_it_is_not_taken_over(vehicle: Callable[[], Any], why: str) -> None:
    world = taking_over(vehicle(), timeout_s=4.0)
    how = world.fail()
    assert how.startswith("the vehicle is not taken over: ")
    assert why in how
    assert world.orders() == []


@pytest.mark.parametrize(
    ("values", "plan", "said"),
    [
        ({"FENCE_RADIUS": 60}, {"area": (0.0, -9.0, 50.0, 9.0)}, "the area reaches 61 m from the take-off point"),
        ({"FENCE_RADIUS": 50}, {"area": (45.0, -9.0, 49.0, 9.0)}, "the whole area is beyond the vehicle's fence"),
        ({"FENCE_ALT_MAX": 5}, {"height": 6.0}, "the height is beyond the vehicle's fence (FENCE_ALT_MAX 5)"),
        ({"FENCE_RADIUS": 60}, {"area": (-60.0, -9.0, 40.0, 9.0)}, ""),
    ],
)
def test_a_fence_is_compared_with_the_area_from_home(
    monkeypatch: pytest.MonkeyPatch, values: dict[str, float], plan: dict[str, Any], said: str
) -> None:
    for name, value in (ON | values).items():
        monkeypatch.setitem(arducopter._VALUES, name, value)
    world = World(airborne(ardupilot, at=(10.0, 0.0)), {"take_over": True}, **plan)
    world.until(lambda: world.client.outcome or world.client.launched)
    fences = [text for text in world.said if "fence" in text]
    if outcome := world.client.outcome:
        fences.append(in_words(outcome.how))
        assert world.orders() == []
    assert len(fences) == bool(said)
    assert all(said in text for text in fences)
    assert bool(outcome) == ("is beyond" in said)


def test_it_is_waited_for_until_it_hovers() -> None:
    world = taking_over(airborne(ardupilot, mode=Mode.GUIDED))
    onward = dialect.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0xDC7, 0, 0, 0, 1.5, 0, 0, 0, 0, 0, 0, 0)
    encoder = Encoder(1, 195)
    for _ in range(8):
        world.others.write(encoder.pack(onward))
        world.pass_s(1.0)
    assert world.orders() == []
    assert "waiting for a hover" in world.said
    world.until(world.orders)


@pytest.mark.parametrize(("make", "come"), [(ardupilot, True), (px4, False)])
def test_the_pilot_has_the_last_word_from_the_first_moment_on(make: Callable[..., Any], come: bool) -> None:
    world = taking_over(airborne(make))
    world.reach("flying")
    world.until(lambda: not come or world.client._commander.authority.in_mode)
    world.pilot(POSITION if make is px4 else Mode.RTL)
    assert "the pilot or a failsafe has taken over" in world.fail()
    assert come or {m.get_type() for m in world.orders()} <= {"SET_POSITION_TARGET_LOCAL_NED"}


@pytest.mark.parametrize("before_s", [0.1, 0.5])
def test_a_pilot_who_takes_px4_between_two_heartbeats_is_not_overridden(before_s: float) -> None:
    """CURRENT_MODE comes with each change of the mode, the heartbeat only once a second."""
    other = taking_over(airborne(px4))
    other.reach("flying")
    world = taking_over(airborne(px4))
    world.pass_s(other.clock.now() - before_s)
    world.pilot(POSITION)
    world.pass_s(5.0)
    assert world.mode == POSITION
    assert world.orders() == []


@BOTH
def test_a_slow_link_is_no_ground_below_a_hover(make: Callable[..., Any]) -> None:
    """It is ordered to sink at once, and reported to sink later."""
    world = taking_over(airborne(make), height=3.0)
    delay(world, 0.4)
    world.until(lambda: world.client.outcome or world.ned[2] > -3.5)
    assert world.client.outcome is None
    assert not world.client.mission.ended


@BOTH
@pytest.mark.parametrize("flies", [True, False])
def test_on_a_slower_link_it_is_not_taken_over_nor_armed(make: Callable[..., Any], flies: bool) -> None:
    """An order would arrive after a switch of the pilot that is not reported here yet, and override it."""
    world = taking_over(airborne(make)) if flies else World(make())
    delay(world, 0.6)
    slow = "the link is slow: an answer of the vehicle takes more than 0.5 s"
    assert world.fail() == slow + "; it was not taken over" * flies
    assert world.orders() == []


def test_on_a_slower_link_the_mode_that_was_reported_last_is_named() -> None:
    """It was in GUIDED already. The report of the pilot's mode does not count as news, but nothing hovers in GUIDED."""
    world = taking_over(airborne(ardupilot, mode=Mode.GUIDED))
    delay(world, 0.6)
    world.reach("flying")
    world.pilot(Mode.RTL)
    assert world.fail() == "the mode is RTL: the pilot or a failsafe has taken over"
    assert world.orders() == []


@pytest.mark.parametrize("stick_s", [0.7, None])
def test_an_order_that_is_in_transmission_is_undone(stick_s: float | None) -> None:
    """The pilot moves a stick, or the person stops the search, before the vehicle's new mode has arrived here."""
    vehicle = airborne(ardupilot)
    vehicle._pilot.sticks = (1500,) * 4
    world = taking_over(vehicle)
    delay(world, 0.15)
    world.reach("flying")
    world.pass_s(1.05 if stick_s is None else stick_s)
    if stick_s is None:
        world.client.stop()
        assert world.fail() == "interrupted"
    else:
        vehicle._pilot.sticks = (1800, *[1500] * 3)
        assert world.fail().endswith("the pilot has it, in LOITER")
    assert any(getattr(m, "command", None) == dialect.MAV_CMD_DO_SET_MODE for m in world.orders())
    world.pass_s(3.0)
    assert world.mode == (Mode.GUIDED if stick_s is None else Mode.LOITER)


@BOTH
def test_a_vehicle_that_does_not_come_is_left_to_whoever_has_it(make: Callable[..., Any]) -> None:
    vehicle = airborne(make)
    feed, parser = vehicle.feed, Parser()

    def deaf(chunk: bytes, now: float, link: int = 0) -> None:
        """It carries out no order for another mode."""
        for packet in parser.feed(chunk):
            if getattr(decode(packet), "command", None) != dialect.MAV_CMD_DO_SET_MODE:
                feed(packet.raw, now)

    vehicle.feed = deaf
    world = taking_over(vehicle)
    assert "the vehicle does not follow velocities" in world.fail()
    assert dialect.MAV_CMD_NAV_LAND not in {getattr(m, "command", None) for m in world.orders()}
    assert world.armed


@BOTH
def test_ctrl_c_before_it_has_come_leaves_it_where_it_was(make: Callable[..., Any]) -> None:
    world = taking_over(airborne(make))
    mode = world.mode
    world.reach("flying")
    world.client.stop()
    world.end()
    world.stay_silent(4.0, since=world.clock.now() + 0.01)
    assert world.mode == mode


# A dry run does everything but arm and move: it says what a search would order, and nothing of it leaves


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


@pytest.mark.parametrize(("make", "land"), [(ardupilot, True), (px4, True), (ardupilot, False)])
def test_it_says_in_order_what_a_search_orders_and_orders_nothing(make: Callable[[], Any], land: bool) -> None:
    world = dry(make(), {"countdown_s": 3.0, "land": land})
    assert world.end(60.0) == ("would fly", in_words(because(Why.WOULD_FLY)))
    world.pass_s(5)
    nothing_moves(world)
    searched = flown(make)[0] if land else World(make(), {"land": False})
    searched.end()
    commands = [(m.command, m.param2, m.param3) for m in searched.orders() if m.get_type() == "COMMAND_LONG"]
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


@pytest.mark.parametrize(
    ("change", "kind", "why", "plan"),
    [
        (silent, "no link", "no frame from the receiver at memory:a: nothing came", {}),
        (winged, "failed", "ardupilotmega fixed_wing 1/1 is not a multirotor", {}),
        (unchanged, "failed", "dry run: the strategy has failed: ZeroDivisionError(", {"strategy": Broken}),
    ],
)
def test_what_would_end_a_search_ends_it(change: Callable[[World], None], kind: str, why: str, plan: Any) -> None:
    world = dry(ardupilot(), **plan)
    change(world)
    ended, how = world.end(60.0)
    assert ended == kind
    assert how.startswith(why)
    assert how.endswith("; nothing was ordered") or not plan
    assert not planned(world) or plan
    nothing_moves(world)


@BOTH
def test_interrupted_nothing_has_to_be_undone(make: Callable[[], Any]) -> None:
    world = dry(make())
    world.until(lambda: planned(world))
    world.client.stop()
    assert world.end(1.0) == ("failed", "interrupted")
    nothing_moves(world)


# -- consent -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("make", "person"), [(ardupilot, None), (px4, Person("no"))])
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
