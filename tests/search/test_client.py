"""The whole search, with bytes on both links and a clock that jumps: what it does when things go wrong."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import fields
from operator import mul
from typing import Any

import pytest

from arva_hil.autopilot.following.session import Session
from arva_hil.clock import Clock, StepClock
from arva_hil.events import Event
from arva_hil.events.reasons import Why, because
from arva_hil.events.words.reasons import in_words
from arva_hil.events.words.sentences import sentence
from arva_hil.links import Link, LinkError, memory
from arva_hil.links.reconnecting import ReconnectingLink
from arva_hil.mavlink.codec import Encoder, Packet, Parser, decode, dialect
from arva_hil.mavlink.dialect import MAVLINK_MSG_ID_CURRENT_MODE
from arva_hil.model.field import rotation
from arva_hil.model.field.dipole import one_field
from arva_hil.model.receiver.paper import INNER_M, MID_M, near, output
from arva_hil.runtime.loop import run
from arva_hil.search.flight.client import SearchClient
from arva_hil.search.flight.links import QUIET_S
from arva_hil.search.mission.outcome import SearchStep
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import Found, Observation, Position, Velocity, towards
from arva_hil.simulated import HOME, arducopter
from arva_hil.simulated.autopilot import Mode
from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator, Truth
from firmware_proto import INNER, MID, NOT_SEARCHING, SELF_TEST_FAULT, Channel, Decoder, Frame, encode
from tests.simulated_px4 import HOLD, LAND, OFFBOARD, STREAMS, Px4

VICTIM = (8.0, 3.0)  # north, east of home
KAPPA = 1.542  # of the receiver
US = 193
HEARTBEAT, GLOBAL_POSITION = dialect.MAVLINK_MSG_ID_HEARTBEAT, dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
INTERRUPTED = in_words(because(Why.INTERRUPTED))
GUIDED_ALONE = "it stops after 3 s (GUID_TIMEOUT), and hovers in GUIDED, armed, until the pilot takes control"
LEFT = "the vehicle is left to its own failsafe"
HARMLESS = {  # what may be sent without an influence on the flight
    dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
    dialect.MAV_CMD_REQUEST_MESSAGE,
    dialect.MAV_CMD_GET_HOME_POSITION,
}


class GoTo:
    """A strategy that knows: it flies to where `VICTIM` is, and has found it there."""

    def __init__(self, speed: float) -> None:
        self.found: Found | None = None
        self._speed = speed

    def observe(self, observation: Observation) -> None:
        if math.dist(observation.position[:2], VICTIM) < 0.5 and observation.heard:
            self.found = Found(*VICTIM)

    def velocity(self, time_s: float, position: Position) -> Velocity:
        return towards(position, VICTIM, self._speed)


class Port:
    """The far end of the receiver's link: says what it hears five times a second. A task. `came`: commands to it."""

    def __init__(self, link: Link, says: Callable[[float], bytes | None]) -> None:
        self.links = [link]
        self.says = says
        self.came = b""
        self._next = 0.0

    def service(self, clock: Clock) -> float:
        if self.links[0].ready():
            self.came += self.links[0].read()
        if clock.now() >= self._next:
            self._next = clock.now() + 0.2
            if said := self.says(clock.now()):
                self.links[0].write(said)
        return self._next


def frames(now: float, d_cm: int = 900, delta_deg: int = 20) -> bytes:
    """What a receiver says that hears two transmitters; the second one always 20 m away."""
    zone = INNER if d_cm <= 300 else MID
    return encode(Frame(round(now * 5) % 256, 1, (Channel(1, zone, d_cm, delta_deg), Channel(2, MID, 2000, 5))))


def read(truth: Truth, victim: tuple[float, float]) -> tuple[int, int, int]:
    """What a receiver shows of a transmitter on the ground, whose dipole points north: d [cm], δ [°] and the zone."""
    north, east, down = truth.ned
    _, *h = one_field(north - victim[0], east - victim[1], down, 1 / (4 * math.pi), 0.0, 0.0)
    x, y, z = (sum(map(mul, h, column)) for column in zip(*rotation.matrix(*truth.quaternion), strict=True))
    shown = output((x, y, z), math.cbrt(KAPPA / (4 * math.pi)), near(KAPPA, INNER_M), INNER_M, MID_M)
    assert shown is not None
    return shown


class World:
    """A search, its vehicle, its receiver. `told`: every message from the search to the vehicle, and when.

    `between`: what the vehicle says passes through it. `others`: a second link to the vehicle.
    """

    def __init__(self, vehicle: SimulatedVehicle | Px4, client: dict[str, Any] | None = None, **plan: Any) -> None:
        self.clock = StepClock()
        self.vehicle = vehicle
        self.rows: list[SearchStep] = []
        self.events: list[Event] = []
        self.told: list[tuple[float, Any]] = []
        self.between: Callable[[bytes], bytes] = bytes
        (self.autopilot, self.far), (self.receiver, port) = self._cables()
        self.others, others = memory.pair()
        self.port = Port(port, self.frames)
        self.session = Session(rate_hz=10, component=US)
        client = dict(client or {})
        settings = {field.name for field in fields(SearchPlan)} & client.keys()
        plan |= {name: client.pop(name) for name in settings}
        self.client = SearchClient(
            SearchPlan(**({"strategy": GoTo, "take_off": 2.0, "height": 1.0} | plan)),
            self.session,
            self.autopilot,
            self.receiver,
            Decoder(),
            start=0.0,
            emit=self.events.append,
            log=self.rows.append,
            **client,
        )
        self._tap()
        self._tasks = [Simulator([vehicle], [self.far, others]), self.port, self.client]  # type: ignore[arg-type]

    def _cables(self) -> tuple[tuple[Link, Link], tuple[Link, Link]]:
        """Both ends of the autopilot's link and of the receiver's."""
        return memory.pair(), memory.pair()

    def _tap(self) -> None:
        read, write, parser = self.far.read, self.far.write, Parser()

        def tapped() -> bytes:
            data = read()
            for packet in parser.feed(data):
                assert (packet.system, packet.component) == (1, US)
                self.told.append((self.clock.now(), decode(packet)))
            return data

        self.far.read = tapped  # type: ignore[method-assign]
        self.far.write = lambda data: write(self.between(data))  # type: ignore[method-assign]

    @property
    def said(self) -> list[str]:
        return [notice.text for event in self.events if (notice := sentence(event))]

    def until(self, condition: Callable[[], object], within_s: float = 240.0) -> None:
        end = self.clock.now() + within_s
        run(self._tasks, self.clock, until=end, stopped=lambda: bool(condition()))
        assert condition(), f"not in {within_s} s; {self.said}, {self.rows[-1:]}"

    def end(self, within_s: float = 240.0) -> tuple[str, str]:
        self.until(lambda: self.client.outcome, within_s)
        outcome = self.client.outcome
        return outcome.kind, in_words(outcome.how)

    def pass_s(self, seconds: float) -> None:
        end = self.clock.now() + seconds
        self.until(lambda: self.clock.now() >= end, seconds + 1)

    def after(self, seconds: float) -> World:
        self.pass_s(seconds)
        return self

    def reach(self, phase: str) -> None:
        self.until(lambda: self.client._commander.phase.name.lower() == phase)

    def hunt(self) -> None:
        self.until(lambda: self.client.mission and self.client.mission.choice.hunting and self.flown_m > 2)

    def fail(self, within_s: float = 240.0) -> str:
        """Go on until it fails, and return why."""
        kind, how = self.end(within_s)
        assert kind == "failed"
        return how

    def stay_silent(self, seconds: float, since: float) -> None:
        """Go on for so long: nothing is ordered from `since` on."""
        self.pass_s(seconds)
        assert self.orders(since) == []

    def stand_still(self, seconds: float, within_m: float = 0.1) -> None:
        before = self.ned
        self.pass_s(seconds)
        assert self.ned == pytest.approx(before, abs=within_m)

    def pilot(self, mode: int) -> None:
        """Somebody else changes the mode, on another link."""
        main, sub = (mode >> 16 & 255, mode >> 24) if isinstance(self.vehicle, Px4) else (mode, 0)
        set_mode = dialect.MAV_CMD_DO_SET_MODE
        order = dialect.MAVLink_command_long_message(1, 1, set_mode, 0, 1, main, sub, 0, 0, 0, 0)
        self.others.write(Encoder(255, 190).pack(order))

    def frames(self, now: float) -> bytes:
        """What the receiver hears at its true place of a transmitter at `VICTIM`, whose dipole points north."""
        d_cm, delta_deg, _ = read(self.vehicle.truth(now), VICTIM)
        return frames(now, d_cm, delta_deg)

    @property
    def ned(self) -> tuple[float, float, float]:
        return self.vehicle.truth(self.clock.now()).ned

    @property
    def flown_m(self) -> float:
        """How far from home the search believed to be at its last step."""
        return math.hypot(self.rows[-1].north_m, self.rows[-1].east_m) if self.rows else 0.0

    @property
    def mode(self) -> int:
        return self.vehicle.mode if isinstance(self.vehicle, Px4) else int(self.vehicle._pilot.mode)

    @property
    def on_the_ground(self) -> bool:
        return abs(self.ned[2]) < 0.05 and not self.armed

    @property
    def armed(self) -> bool:
        return self.session.vehicle.armed

    def orders(self, since: float = 0.0) -> list[Any]:
        """What was told that has an influence on the flight."""
        return [
            m
            for at, m in self.told
            if at >= since
            and m.get_type() not in ("HEARTBEAT", "REQUEST_DATA_STREAM", "PARAM_REQUEST_READ", "TIMESYNC", "TUNNEL")
            and getattr(m, "command", None) not in HARMLESS
        ]


class Plug(Link):
    """The far end of a link that can be pulled and plugged in again; `near` is the search's."""

    name = "plug"

    def __init__(self, clock: Clock, wanted: Callable[[], bool]) -> None:
        self.there = True
        self._far: Link | None = None
        self.near = ReconnectingLink(self._open(), self._open, clock, start=lambda job: job(), wanted=wanted)

    def _open(self) -> Link:
        if not self.there:
            raise LinkError(self.name, "is not there")
        near, self._far = memory.pair()
        near.name = self.name
        return near

    def pull(self) -> None:
        assert self._far
        self._far.close()
        self._far, self.there = None, False

    def ready(self) -> bool:
        return self._far is not None and self._far.ready()

    def read(self) -> bytes:
        return self._far.read() if self._far and self._far.ready() else b""

    def write(self, data: bytes) -> bool:
        return self._far is not None and self._far.write(data)

    def close(self) -> None: ...


class Plugged(World):
    """Both links come back, the autopilot's until the launch: `plugs` is their far ends."""

    def _cables(self) -> tuple[tuple[Link, Link], tuple[Link, Link]]:
        one = Plug(self.clock, lambda: not self.client.launched)
        two = Plug(self.clock, lambda: True)
        self.plugs = one, two
        return (one.near, one), (two.near, two)


def ardupilot(**options: Any) -> SimulatedVehicle:
    return SimulatedVehicle(HOME, streams=STREAMS, **options)


def px4(**options: Any) -> Px4:
    return Px4(HOME, **options)


def reaching(phase: str, vehicle: Any, client: dict[str, Any] | None = None, **plan: Any) -> World:
    """A search that has come so far."""
    world = World(vehicle, client, **plan)
    world.reach(phase)
    return world


def hunting(vehicle: Any, client: dict[str, Any] | None = None, **plan: Any) -> World:
    """A search that flies to a transmitter."""
    world = World(vehicle, client, **plan)
    world.hunt()
    return world


def changed(msgid: int, field: str, change: Callable[[Any], Any]) -> Callable[[bytes], bytes]:
    """What the vehicle says, with one field of one message changed."""
    parser, encoder = Parser(), Encoder(1, 1)

    def repacked(packet: Packet) -> bytes:
        message = decode(packet)
        setattr(message, field, change(getattr(message, field)))
        return encoder.pack(message)

    return lambda data: b"".join(repacked(p) if p.msgid == msgid else p.raw for p in parser.feed(data))


def modes_said(world: World) -> list[tuple[float, int]]:
    """What the vehicle says of its mode from now on, and when; filled while it flies."""
    said: list[tuple[float, int]] = []
    parser, pass_on = Parser(), world.between

    def listening(data: bytes) -> bytes:
        for packet in parser.feed(data):
            message: Any = decode(packet)
            if packet.msgid in (HEARTBEAT, 436):
                said.append((world.clock.now(), message.custom_mode))
        return pass_on(data)

    world.between = listening
    return said


@functools.cache
def flown(make: Callable[[], Any]) -> tuple[World, list[tuple[float, int]]]:
    """A search as it should be, flown once for several tests, and what the vehicle said of its mode."""
    world = World(make())
    modes = modes_said(world)
    assert world.end() == ("found", "found")
    return world, modes


def set_points(world: World) -> list[tuple[float, Any]]:
    return [(at, m) for at, m in world.told if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]


def widest_gap(times: Iterable[float]) -> float:
    return max(b - a for a, b in itertools.pairwise(times))


BOTH = pytest.mark.parametrize("make", [ardupilot, px4])


# -- as it should be ---------------------------------------------------------------------------------------


@BOTH
def test_the_nearer_victim_is_found_the_other_reported_and_the_vehicle_landed(make: Callable[[], Any]) -> None:
    world, _ = flown(make)
    outcome = world.client.outcome
    assert (outcome.id, outcome.found[:2]) == (1, VICTIM)
    assert outcome.found.covariance is not None  # the last check says how well it is known
    assert outcome.lat_lon == pytest.approx((46.0123 + 8 / 111_170, 7.7456 + 3 / 77_400), abs=1e-6)
    assert outcome.path_m == pytest.approx(math.hypot(*VICTIM), abs=1.5)
    assert 8 < outcome.time_s < 20
    assert outcome.frames >= outcome.time_s * 4
    assert [(other, heard.nearest_m) for other, heard in outcome.others] == [(2, 20.0)]
    assert world.ned == pytest.approx((*VICTIM, 0.0), abs=0.6)
    assert not world.armed
    assert world.said[-1] == "found; landing"


def test_it_can_be_left_hovering_at_the_end() -> None:
    world = World(ardupilot(), {"land": False})
    assert world.end() == ("found", "found")
    world.stay_silent(8, since=world.clock.now() + 0.01)
    assert world.armed
    assert world.ned == pytest.approx((*VICTIM, -1.0), abs=0.6)


@pytest.mark.parametrize(("make", "options"), [(px4, {"wind": (-3.0, 4.0, 0.0)}), (ardupilot, {"fix_after": 20.0})])
def test_these_change_nothing(make: Callable[..., Any], options: dict[str, Any]) -> None:
    world = World(make(**options))
    assert world.end() == ("found", "found")
    assert world.ned == pytest.approx((*VICTIM, 0.0), abs=1.5)


def test_the_log_has_a_row_for_every_step_and_the_readings_between() -> None:
    world, _ = flown(ardupilot)
    assert widest_gap(row.time_s for row in world.rows) < 0.31
    assert [key for key, _ in itertools.groupby(row.phase for row in world.rows)] == ["climbing", "flying", "landing"]
    heard = [(row.id, row.d_cm) for row in world.rows if row.phase == "flying" and row.d_cm]
    assert {id_ for id_, _ in heard} == {1}
    assert heard[0][1] > 700 > 300 > heard[-1][1]
    last = world.rows[-1]
    assert (last.north_m, last.east_m) == pytest.approx(VICTIM, abs=0.6)
    assert max(math.hypot(row.v_north, row.v_east) for row in world.rows) <= 1.0 + 1e-9


def test_it_is_an_onboard_computer_and_no_ground_station() -> None:
    beats = [(at, m) for at, m in flown(ardupilot)[0].told if m.get_type() == "HEARTBEAT"]
    onboard = (dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID)
    assert {(m.type, m.autopilot) for _, m in beats} == {onboard}
    assert widest_gap(at for at, _ in beats) < 1.2


def test_what_others_on_the_link_say_changes_nothing() -> None:
    world = World(px4())
    kinds = dialect.MAV_TYPE_QUADROTOR, dialect.MAV_TYPE_GCS, dialect.MAV_TYPE_ONBOARD_CONTROLLER
    others = [(Encoder(*source), kind) for source in [(2, 1), (1, 191), (255, 190), (1, 100)] for kind in kinds]

    def crowded(data: bytes) -> bytes:
        now = round(world.clock.now() * 1e3)
        for encoder, kind in others:
            for autopilot in (dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, dialect.MAV_AUTOPILOT_INVALID):
                data += encoder.pack(dialect.MAVLink_heartbeat_message(kind, autopilot, 0, 5, 3, 3))
            place = round(-33e7), round(151e7), 0, 0, 0, 0, 0, 0
            data += encoder.pack(dialect.MAVLink_global_position_int_message(now, *place))
            data += encoder.pack(dialect.MAVLink_attitude_message(0, 1, 1, 1, 0, 0, 0))
        return data

    world.until(lambda: world.session.vehicle)
    world.between = crowded
    assert world.end() == ("found", "found")
    assert world.ned == pytest.approx((*VICTIM, 0.0), abs=0.6)
    assert world.session.ignored > 1000


# -- on the ground -----------------------------------------------------------------------------------------


def armed_already() -> SimulatedVehicle:
    vehicle = ardupilot()
    vehicle.poll(0.0)
    vehicle._pilot.arm()
    return vehicle


def silent(world: World) -> None:
    world.port.says = lambda now: None


def deaf(world: World) -> None:
    world.between = lambda data: b""


def unplugged(world: World) -> None:
    world._tasks.pop(0)
    world.far.close()


def garbled(world: World) -> None:
    world.port.says = lambda now: b"$PARVA,1*"


def soon_silent(world: World) -> None:
    world.port.says = lambda now: frames(now) if now < 3 else b""


def winged(world: World) -> None:
    world.between = changed(HEARTBEAT, "type", lambda _: dialect.MAV_TYPE_FIXED_WING)


def unchanged(world: World) -> None: ...


def of_frames(why: str) -> str:
    return f"no frame from the receiver at memory:a: {why}"


A_FRAME = "a frame from the receiver"
NO_FIX = {"fix_after": 1e6}
ARMED_ALREADY = "the vehicle is armed already: a search starts on the ground, or with --take-over in a hover"


@pytest.mark.parametrize(
    ("vehicle", "change", "kind", "why", "after_s", "waits_for"),
    [
        (ardupilot, silent, "no link", of_frames("nothing came"), 60, A_FRAME),
        (
            ardupilot,
            garbled,
            "no link",
            of_frames(r"bytes came that are none, first b'$PARVA,1*$PARVA,': is the format right"),
            20,
            A_FRAME,
        ),
        ({"fix_after": 5.0}, soon_silent, "no link", of_frames("the last one came 17 s"), 20, A_FRAME),
        (ardupilot, deaf, "no link", "no autopilot:", 20, "an autopilot"),
        (ardupilot, unplugged, "no link", "memory:a: lost: closed by the far end", 0, ""),
        (NO_FIX, unchanged, "failed", "no pose: the position is all zeros: no GPS fix yet", 20, "a pose"),
        (armed_already, unchanged, "failed", ARMED_ALREADY, QUIET_S, ""),
        (ardupilot, winged, "failed", "ardupilotmega fixed_wing 1/1 is not a multirotor", 0, ""),
    ],
)
def test_nothing_is_armed(vehicle: Any, change: Any, kind: str, why: str, after_s: float, waits_for: str) -> None:
    world = World(ardupilot(**vehicle) if isinstance(vehicle, dict) else vehicle(), {"timeout_s": max(after_s, 20.0)})
    change(world)
    ended, how = world.end()
    assert ended == kind
    assert how.startswith(why)
    assert after_s <= world.clock.now() <= after_s + 3
    assert not waits_for or f"waiting for {waits_for}" in world.said
    assert world.orders() == []


def test_a_pose_that_is_old_is_none() -> None:
    world = World(ardupilot(), {"timeout_s": 5.0})
    world.port.says = lambda now: world.frames(now) if now > 3 else None
    world.until(lambda: world.session.navigation.track.newest)
    world.between = without(GLOBAL_POSITION)
    assert world.fail().startswith("no pose: no GLOBAL_POSITION_INT (")
    assert 5 < world.clock.now() < 6
    assert world.orders() == []


def test_one_that_does_not_arm_says_why() -> None:
    world = World(px4(healthy=False), {"arm_timeout_s": 10.0})
    why = "the vehicle does not arm: arming: TEMPORARILY_REJECTED; not healthy: 3d gyro, rc receiver"
    assert world.end() == ("failed", why)
    assert world.ned[2] == 0.0


def test_frames_that_stop_before_the_take_off_end_it_on_the_ground() -> None:
    world = reaching("arming", px4(healthy=False))
    silent(world)
    assert world.after(9).client.outcome is None
    assert world.end(4.0) == ("failed", of_frames("the last one came 10 s ago"))
    assert (world.orders()[-1].command, world.orders()[-1].param1) == (dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0)


def without(*ids: int) -> Callable[[bytes], bytes]:
    """What the vehicle says, but for some messages."""
    parser = Parser()
    return lambda data: b"".join(packet.raw for packet in parser.feed(data) if packet.msgid not in ids)


def delay(world: World, seconds: float) -> None:
    """What the vehicle says arrives so much later."""
    under_way: list[tuple[float, bytes]] = []

    def delayed(data: bytes) -> bytes:
        under_way.append((world.clock.now() + seconds, data))
        came = [data for at, data in under_way if at <= world.clock.now()]
        del under_way[: len(came)]
        return b"".join(came)

    world.between = delayed


# -- frames stop in the air --------------------------------------------------------------------------------


def test_frames_that_stop_make_it_hover_and_go_on_when_they_are_back() -> None:
    world = hunting(ardupilot())
    silent(world)
    world.pass_s(4)
    world.stand_still(4, within_m=0.2)
    world.port.says = world.frames
    assert world.end() == ("found", "found")
    assert "no frame for 2 s: hovering" in world.said
    assert "frames are back: the search goes on" in world.said


@pytest.mark.parametrize(("make", "gone"), [(ardupilot, False), (px4, True)])
def test_frames_that_stop_for_long_make_it_land(make: Callable[[], Any], gone: bool) -> None:
    world = hunting(make())
    stopped = world.clock.now()
    silent(world)
    if gone:
        world._tasks.remove(world.port)
        world.port.links[0].close()
    assert world.end() == ("failed", "no good frame from the receiver for 10 s")
    landing = min(row.time_s for row in world.rows if row.phase == "landing")
    assert 9.5 < landing - stopped < 11
    assert world.on_the_ground
    assert ("the receiver is gone: memory:a: lost: closed by the far end" in world.said) is gone
    ((_, one), (_, two)) = world.client.outcome.others  # type: ignore[union-attr]
    assert 1 < one.nearest_m < 9
    assert two.nearest_m == 20.0


UNFIT = {
    SELF_TEST_FAULT: "the receiver's self-test has failed: restart it away from transmitters and electronics",
    NOT_SEARCHING: "the receiver does not search: restart it away from transmitters and electronics",
}


@pytest.mark.parametrize("status", UNFIT)
def test_a_receiver_that_says_that_it_cannot_search_is_not_flown(status: int) -> None:
    world = World(ardupilot(), timeout_s=20.0)
    world.port.says = lambda now: encode(Frame(round(now) % 256, status, (Channel(7, MID, 500, 0),)))
    assert world.end() == ("no link", UNFIT[status])
    assert world.orders() == []


def test_one_that_says_so_in_flight_makes_it_hover_then_land() -> None:
    world = hunting(ardupilot())
    world.port.says = lambda now: encode(Frame(round(now) % 256, SELF_TEST_FAULT, (Channel(7, MID, 500, 0),)))
    world.pass_s(4.0)
    world.stand_still(4.0)
    assert world.end() == ("failed", "no good frame from the receiver for 10 s")
    assert world.on_the_ground


def test_frames_that_stop_in_the_take_off_make_it_land_too() -> None:
    world = reaching("climbing", ardupilot(), take_off=5.0)
    silent(world)
    assert world.end() == ("failed", "no good frame from the receiver for 10 s")
    assert math.hypot(*world.ned[:2]) < 2.5
    assert not world.armed


# -- cables that are pulled, and plugged in again -----------------------------------------------------------

LOST = "plug: lost: closed by the far end, searching for it"


def test_a_receiver_that_is_plugged_in_again_goes_on() -> None:
    world = Plugged(px4())
    world.hunt()
    world.plugs[1].pull()
    world.pass_s(4)
    world.stand_still(4, within_m=0.2)
    world.plugs[1].there = True
    assert world.end() == ("found", "found")
    lost, hovering, back, on = [
        text for text in world.said if "plug: " in text or ": hovering" in text or "go on" in text or "goes on" in text
    ]
    assert (lost, hovering, on) == (LOST, "no frame for 2 s: hovering", "frames are back: the search goes on")
    assert back.startswith("plug: back after 8.")


def test_on_the_ground_both_are_waited_for() -> None:
    vehicle = ardupilot(fix_after=20.0)
    world = Plugged(vehicle)
    for seconds in (5, 4, 9):
        world.pass_s(seconds)
        for plug in world.plugs:
            plug.pull()
        assert world.after(6).orders() == []
        if seconds == 4:
            vehicle.reboot(world.clock.now())
        for plug in world.plugs:
            plug.there = True
    back = world.clock.now()
    assert world.end() == ("found", "found")
    told = [m for at, m in world.told if at >= back]  # nothing could be told before, with the plugs out
    assert "HEARTBEAT" in {m.get_type() for m in told}
    assert dialect.MAV_CMD_SET_MESSAGE_INTERVAL in {getattr(m, "command", None) for m in told}
    assert world.said.count(LOST) == sum(text.startswith("plug: back after 6.") for text in world.said) == 6
    assert "waiting for the autopilot's link" in world.said


@pytest.mark.parametrize("pulled", [True, False])
def test_after_an_absence_the_parameters_are_asked_for_again(monkeypatch: pytest.MonkeyPatch, pulled: bool) -> None:
    world = Plugged(ardupilot())
    silent(world)
    world.pass_s(5)
    assert world.client._preflight.failsafes.done
    if pulled:
        world.plugs[0].pull()
    else:  # only the vehicle is switched off
        deaf(world)
    world.pass_s(2)
    world.vehicle.reboot(world.clock.now())
    world.pass_s(2)
    radio = {"RCMAP_THROTTLE": 1, "RSSI_TYPE": 2, "RSSI_CHANNEL": 8}
    for name, value in ({"FENCE_ENABLE": 1, "FENCE_TYPE": 2, "FENCE_RADIUS": 60} | radio).items():
        monkeypatch.setitem(arducopter._VALUES, name, value)
    world.plugs[0].there, world.between, world.port.says = True, bytes, world.frames
    world.reach("arming")
    assert [text for text in world.said if "beyond the vehicle's fence (FENCE_RADIUS 60)" in text]
    sticks = world.client._commander.sticks
    assert (sticks.throttle, sticks.quality) == (1, 8)


def test_an_autopilot_whose_link_stays_lost_on_the_ground_is_none() -> None:
    world = Plugged(ardupilot(fix_after=1e6))
    world.pass_s(29)
    world.plugs[0].pull()
    assert world.end() == ("no link", LOST)
    assert 60 < world.clock.now() < 61
    assert world.orders() == []


def test_who_had_the_vehicle_meanwhile_is_seen_before_anything_is_ordered() -> None:
    """After an absence the pose may be there before the first heartbeat is."""
    world = Plugged(ardupilot())
    silent(world)
    world.until(lambda: world.session.navigation.track.newest)
    world.plugs[0].pull()
    world.pass_s(3)
    world.vehicle._pilot.arm()  # type: ignore[union-attr]
    world.port.says = world.frames
    world.plugs[0].there = True
    world.between = without(HEARTBEAT)
    world.stay_silent(4, since=0.0)
    assert world.client._preflight.why_no_pose(world.clock.now()) is None
    assert world.client.outcome is None
    world.between = bytes
    assert world.end(3.0) == ("failed", ARMED_ALREADY)
    assert world.orders() == []


@pytest.mark.parametrize("phase", ["arming", "climbing", "flying"])
def test_from_the_launch_on_an_autopilot_whose_link_was_lost_is_let_go(phase: str) -> None:
    world = Plugged(px4(healthy=phase != "arming"), take_off=6.0)
    world.reach(phase)
    world.pass_s(1)
    pulled = world.clock.now()
    world.plugs[0].pull()
    world.plugs[0].there = True
    lost = f"plug: lost: closed by the far end; {LEFT}: it lands (COM_OBL_RC_ACT 4) after 1 s (COM_OF_LOSS_T)"
    assert world.end(1.0) == ("failed", lost)
    assert world.plugs[0].near.fileno() is None  # nobody looks for it
    assert [at for at, _ in world.told if at > pulled] == []


# -- the pilot, and other ends of an autopilot -------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "phase"), [(px4, "climbing"), (ardupilot, "flying"), (ardupilot, "landing"), (px4, "landing")]
)
def test_a_pilot_who_takes_over_hears_no_more_of_it(make: Callable[[], Any], phase: str) -> None:
    mode, name = (HOLD, "hold") if make is px4 else (Mode.LOITER, "LOITER")
    world = reaching(
        "climbing" if phase == "climbing" else "flying",
        make(),
        take_off=6.0,
        height=6.0,
        **({"patience_s": 3.0} if phase == "landing" else {}),
    )
    if phase == "landing":
        silent(world)
        world.reach("landing")
    world.pass_s(2)
    world.pilot(mode)
    taken = world.clock.now()
    assert world.end(1.5) == ("failed", f"the mode is {name}: the pilot or a failsafe has taken over")
    let_go = world.clock.now()
    world.pass_s(2)
    world.stand_still(10)
    assert world.orders(let_go) == []
    assert {m.get_type() for m in world.orders(taken)} <= {"SET_POSITION_TARGET_LOCAL_NED"}  # until it was noticed
    assert {m.get_type() for at, m in world.told if at > let_go} <= {"HEARTBEAT", "COMMAND_LONG"}
    assert world.ned[2] < -1.0
    assert world.armed


def test_a_pilot_who_takes_over_after_the_victim_was_found_does_not_undo_that() -> None:
    world = reaching("landing", ardupilot())
    world.pilot(Mode.LOITER)
    assert world.end(2.0) == ("found", "the mode is LOITER: the pilot or a failsafe has taken over")
    assert world.client.outcome.found[:2] == VICTIM


@BOTH
def test_a_vehicle_that_reboots_is_let_go(make: Callable[[], Any]) -> None:
    world = hunting(make())
    world.vehicle.reboot(world.clock.now())
    rebooted = world.clock.now()
    how = world.fail(10.0)
    assert "it was disarmed" in how or "rebooted" in how or "the mode is" in how
    world.stay_silent(10, since=world.clock.now())
    assert {m.get_type() for m in world.orders(rebooted)} <= {"SET_POSITION_TARGET_LOCAL_NED"}


def reboots_unseen(world: World) -> None:
    world.between = without(HEARTBEAT)
    world.vehicle.reboot(world.clock.now())


def jumps(world: World) -> None:
    world.between = changed(GLOBAL_POSITION, "lat", lambda lat: lat + 50_000)  # 556 m


def is_another(world: World) -> None:
    other = Encoder(1, 1).pack(dialect.MAVLink_heartbeat_message(2, dialect.MAV_AUTOPILOT_PX4, 128, 4, 4, 3))
    world.between = lambda data: data + (other if data else b"")


@pytest.mark.parametrize(
    ("happens", "within_s", "how"),
    [
        (
            reboots_unseen,
            4.0,
            "it has rebooted, or it is not the vehicle that was launched: its clock has gone back"
            f"; {LEFT}: {GUIDED_ALONE}",
        ),
        (unplugged, 1.0, f"memory:a: lost: closed by the far end; {LEFT}: {GUIDED_ALONE}"),
        (jumps, 1.0, f"its position has jumped by 555 m, or it is another vehicle; {LEFT}: {GUIDED_ALONE}"),
        (is_another, 1.0, "uses its ids"),
    ],
)
def test_one_that_is_lost_or_another_is_let_go(happens: Callable[[World], None], within_s: float, how: str) -> None:
    world = hunting(ardupilot())
    happened = world.clock.now()
    happens(world)
    assert how in world.fail(within_s)
    if happens is unplugged:  # nothing can be sent any more
        return
    world.stay_silent(10, since=world.clock.now())
    assert {m.get_type() for m in world.orders(happened)} <= {"SET_POSITION_TARGET_LOCAL_NED"}
    assert happens is not jumps or world.orders(happened + 0.2) == []


def test_an_autopilot_that_falls_silent_is_left_to_its_failsafe() -> None:
    world = hunting(ardupilot())
    deaf(world)
    fell_silent = world.clock.now()
    assert world.fail() == f"the vehicle has not reported its mode for 2.5 s; {LEFT}: {GUIDED_ALONE}"
    assert 2 < world.clock.now() - fell_silent < 3
    assert {(m.vx, m.vy, m.vz) for at, m in set_points(world) if at > fell_silent + 1.5} == {(0.0, 0.0, 0.0)}
    world.between = bytes
    world.stay_silent(10, since=world.clock.now())


@BOTH
def test_without_reports_of_the_mode_the_last_set_points_stop_the_vehicle(make: Callable[[], Any]) -> None:
    """It would fly on, or sink, for as long as its autopilot follows the last one."""
    world = hunting(make(), take_off=10.0, height=2.0)
    world.between = without(HEARTBEAT, MAVLINK_MSG_ID_CURRENT_MODE)
    fell_silent = world.clock.now()
    assert LEFT in world.fail(4.0)
    moving = [at for at, m in set_points(world) if (m.vx, m.vy, m.vz) != (0.0, 0.0, 0.0)]
    assert moving[-1] - fell_silent < 2.0
    world.stand_still(1.0)


@BOTH
def test_reports_of_the_mode_that_are_late_only_stop_the_vehicle_meanwhile(make: Callable[[], Any]) -> None:
    world = hunting(make(), take_off=10.0, height=2.0)
    for _ in range(3):
        world.between = without(HEARTBEAT, MAVLINK_MSG_ID_CURRENT_MODE)
        world.pass_s(1.9)
        world.between = bytes
        world.pass_s(1.2)
    assert world.end() == ("found", "found")


def test_an_autopilot_that_reports_its_mode_without_a_heartbeat_is_left_to_its_failsafe() -> None:
    world = hunting(px4())
    world.between = without(HEARTBEAT)
    fell_silent = world.clock.now()
    assert world.fail(10.0).startswith(f"the autopilot sends no heartbeat any more; {LEFT}: ")
    assert 4 < world.clock.now() - fell_silent < 6
    world.stay_silent(10, since=world.clock.now())


def test_a_far_end_that_was_gone_for_a_moment_may_be_another_vehicle() -> None:
    world = hunting(ardupilot())
    went = world.clock.now()
    world.autopilot.losses, world.autopilot.why = 1, "memory:a: closed by the far end"
    assert world.fail(1.0) == f"memory:a: closed by the far end; {LEFT}: {GUIDED_ALONE}"
    assert world.orders(went + 0.3) == []


def test_unplugged_while_it_lands_it_is_left_to_land() -> None:
    world = reaching("flying", ardupilot(), take_off=4.0, height=4.0, patience_s=3.0)
    silent(world)
    world.reach("landing")
    world.pass_s(1)
    unplugged(world)
    assert world.fail(1.0).endswith(f"memory:a: lost: closed by the far end; {LEFT}: it continues to land")


def goes_on_after_a_silence(world: World, silent_s: float) -> None:
    world.between = without(GLOBAL_POSITION, dialect.MAVLINK_MSG_ID_ATTITUDE)
    world.pass_s(silent_s)
    world.between = bytes
    world.pass_s(1.5)
    assert (world.client._commander.phase.name, world.client.mission.ended) == ("FLYING", None)


@pytest.mark.parametrize(("make", "silent_s"), [(ardupilot, 1.55), (px4, 1.75)])
def test_a_vehicle_that_stopped_without_a_pose_does_not_stand_on_the_ground(
    make: Callable[[], Any], silent_s: float
) -> None:
    """It was ordered to hover, and not to sink as before."""
    world = reaching("flying", make(), take_off=10.0, height=2.0).after(3.3)
    goes_on_after_a_silence(world, silent_s)
    assert world.ned[2] < -5.0


@pytest.mark.parametrize("silent_s", [0.7, 0.95])
def test_a_vehicle_that_began_to_sink_without_a_pose_does_not_stand_on_the_ground(silent_s: float) -> None:
    goes_on_after_a_silence(reaching("flying", ardupilot(), take_off=10.0, height=2.0).after(0.81), silent_s)


@BOTH
def test_without_a_pose_it_hovers_and_then_lands(make: Callable[[], Any]) -> None:
    world = hunting(make())
    world.between = without(GLOBAL_POSITION)
    stopped = world.clock.now()
    world.pass_s(3)
    world.stand_still(5)
    assert world.fail().startswith("no pose for 10 s: ")
    (landed,) = {at for at, m in world.told if getattr(m, "command", None) == dialect.MAV_CMD_NAV_LAND} or {0.0}
    assert 9 < landed - stopped < 13
    assert world.on_the_ground


def test_a_take_off_that_is_never_reached_ends_on_the_ground() -> None:
    vehicle = ardupilot()
    vehicle._pilot.take_off = lambda height: False  # type: ignore[method-assign]
    world = World(vehicle)
    assert world.fail() == "it was disarmed; the mode is GUIDED; take-off: FAILED"
    assert world.ned[2] == 0.0


class Broken(GoTo):
    def velocity(self, time_s: float, position: Position) -> Velocity:
        raise ZeroDivisionError("float division by zero")


def test_the_end_of_the_strips_lands() -> None:
    world = World(ardupilot(), area=(0.0, 0.0, 12.0, 10.0), strip_width=10.0)
    world.port.says = lambda now: encode(Frame(round(now * 5) % 256, 1, (Channel(),)))
    assert world.end() == ("not found", "no signal: all strips are flown")
    assert world.ned == pytest.approx((12.0, 5.0, 0.0), abs=1.5)
    assert "no signal: all strips are flown; landing" in world.said


# -- broken off --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("make", "phase"), [(ardupilot, "climbing"), (ardupilot, "flying"), (px4, "flying")])
def test_broken_off_it_is_left_hovering(make: Callable[[], Any], phase: str) -> None:
    world = reaching(phase, make(), take_off=6.0, height=6.0)
    world.pass_s(3)
    world.client.stop()
    assert "interrupted: the vehicle stays hovering" in world.said
    assert world.fail(3.0) == INTERRUPTED
    stopped = world.clock.now()
    world.pass_s(4)
    world.stand_still(8)
    assert world.ned[2] < -1.0
    assert world.armed
    assert world.orders(stopped + 0.01) == []
    assert world.mode == (HOLD if make is px4 else Mode.GUIDED)


def test_broken_off_while_it_lands_it_goes_on_landing_and_says_so() -> None:
    world = reaching("flying", px4(), take_off=4.0, height=4.0, patience_s=3.0)
    silent(world)
    world.reach("landing")
    world.pass_s(2)
    world.client.stop()
    assert "interrupted: the vehicle lands; the mode switch stops it" in world.said
    assert not any("hovering" in text for text in world.said if text.startswith("interrupted"))
    assert world.fail(30.0) == INTERRUPTED
    assert world.on_the_ground


def test_broken_off_before_anything_was_armed_it_ends_at_once() -> None:
    world = World(ardupilot(fix_after=1e6))
    world.pass_s(5)
    world.client.stop()
    assert world.fail(0.5) == INTERRUPTED
    assert world.orders() == []


def test_broken_off_while_it_arms_it_is_disarmed() -> None:
    world = reaching("arming", px4(healthy=False))
    world.client.stop()
    assert world.fail(3.0) == INTERRUPTED
    assert (world.orders()[-1].command, world.orders()[-1].param1) == (dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0)


# -- set-points --------------------------------------------------------------------------------------------


@BOTH
def test_set_points_never_pause_while_they_steer(make: Callable[[], Any]) -> None:
    world, modes = flown(make)
    times = [at for at, _ in set_points(world)]
    assert times[-1] - times[0] > 8
    assert widest_gap(times) < 0.25
    if make is px4:
        assert [mode for mode, _ in itertools.groupby(mode for _, mode in modes)][-3:] == [OFFBOARD, LAND, OFFBOARD]
