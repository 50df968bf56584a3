"""Flying by orders: what is told to ArduPilot and to PX4, when, and when nothing is told any more."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import groupby, pairwise
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.generator.mavcrc import x25crc

from arva_hil.autopilot.commanding.authority import HOLDERS, Authority, Holder
from arva_hil.autopilot.commanding.commander import Commander, Phase, SetPoints
from arva_hil.autopilot.commanding.complaints import Complaints
from arva_hil.events.vehicles import AutopilotText
from arva_hil.events.words.reasons import in_words
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.simulated.autopilot import Mode
from arva_hil.simulated.vehicle import SimulatedVehicle
from tests.every import every
from tests.kept_events import KeepingSession
from tests.simulated_px4 import HOLD, LAND, OFFBOARD, POSITION, RETURN, STREAMS, TAKE_OFF, Px4

HOME = (46.5, 11.35, 1800.0)
US = 193  # our component
SET_MODE, ARM, NAV_TAKE_OFF, NAV_LAND = (
    dialect.MAV_CMD_DO_SET_MODE,
    dialect.MAV_CMD_COMPONENT_ARM_DISARM,
    dialect.MAV_CMD_NAV_TAKEOFF,
    dialect.MAV_CMD_NAV_LAND,
)
ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS = range(6)
ARDUPILOT, PX4 = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, dialect.MAV_AUTOPILOT_PX4
SILENT = (Phase.IDLE, Phase.ENDED, Phase.LOST)
MODES = {ARDUPILOT: (Mode.GUIDED, Mode.GUIDED, Mode.GUIDED, Mode.LAND), PX4: (HOLD, TAKE_OFF, OFFBOARD, LAND)}


def ardupilot(**options: Any) -> SimulatedVehicle:
    return SimulatedVehicle(HOME, streams=STREAMS, **options)


def px4(**options: Any) -> Px4:
    return Px4(HOME, **options)


BOTH = pytest.mark.parametrize("make", [ardupilot, px4])


class Flight:
    """A commander and a simulated vehicle, stepped together. `sent`: what the commander told it, and when.

    `deaf`: what it is told is lost on the way.
    """

    def __init__(self, vehicle: SimulatedVehicle | Px4, *, step: float = 0.05, **options: Any) -> None:
        self.vehicle = vehicle
        self.session = KeepingSession(rate_hz=10, component=US)
        self.commander = Commander(self.session, self.session.kept.append, **({"take_off_m": 2.0} | options))
        self.now = 0.0
        self.sent: list[tuple[float, Any]] = []
        self.deaf = False
        self._step = step
        self._parser = Parser()
        self.until(lambda: self.session.navigation.track.newest is not None)
        self.commander.launch(self.now)

    def step(self) -> None:
        self.now += self._step
        self.commander.on_packets(self.session.feed(self.vehicle.poll(self.now), self.now), self.now)
        self.vehicle.feed(self.session.poll(self.now)[0], self.now)
        told = self.commander.poll(self.now)
        self.commander.sent(self.now)
        for packet in self._parser.feed(told):
            assert (packet.system, packet.component) == (1, US)
            self.sent.append((self.now, decode(packet)))
        if not self.deaf:
            self.vehicle.feed(told, self.now)

    def until(self, condition: Callable[[], object], within_s: float = 60.0) -> None:
        end = self.now + within_s
        while not condition():
            assert self.now < end, f"in {self.commander.phase} {self.commander.why} after {self.orders}"
            self.step()

    def pass_s(self, seconds: float) -> None:
        end = self.now + seconds
        self.until(lambda: self.now >= end, seconds + 1)

    def reach(self, phase: Phase) -> None:
        self.until(lambda: self.commander.phase is phase, 300.0)

    @property
    def orders(self) -> list[tuple[int, ...]]:
        """The commands sent, with what they say; each once for as long as it was repeated."""
        said = [
            (m.command, *((int(m.param2), int(m.param3)) if m.command == SET_MODE else ())[:2])
            if m.command != ARM
            else (ARM, int(m.param1))
            for _, m in self.sent
            if m.get_type() == "COMMAND_LONG"
        ]
        return [order for n, order in enumerate(said) if n == 0 or order != said[n - 1]]

    @property
    def set_points(self) -> list[tuple[float, Any]]:
        return [(at, m) for at, m in self.sent if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]

    def pilot(self, mode: int) -> None:
        """Somebody else changes the mode."""
        main, sub = (mode >> 16 & 255, mode >> 24) if isinstance(self.vehicle, Px4) else (mode, 0)
        order = dialect.MAVLink_command_long_message(1, 1, SET_MODE, 0, 1, main, sub, 0, 0, 0, 0)
        self.vehicle.feed(Encoder(255, 190).pack(order), self.now)


def flying(vehicle: SimulatedVehicle | Px4, **options: Any) -> Flight:
    flight = Flight(vehicle, **options)
    flight.reach(Phase.FLYING)
    return flight


# -- a flight ----------------------------------------------------------------------------------------------


@BOTH
def test_it_takes_off_follows_a_velocity_with_its_heading_kept_and_lands(make: Callable[[], Any]) -> None:
    flight = flying(make())
    flight.pass_s(2)
    assert -flight.vehicle.truth(flight.now).ned[2] == pytest.approx(2.0, abs=2.0)
    flight.commander.steer((1.0, -0.5, 0.0))
    flight.pass_s(10)
    truth = flight.vehicle.truth(flight.now)
    assert truth.velocity == pytest.approx((1.0, -0.5, 0.0), abs=0.05)
    w, _, _, z = truth.quaternion
    assert 2 * math.atan2(z, w) == pytest.approx(0.0, abs=0.02)
    flight.commander.land(flight.now)
    flight.reach(Phase.ENDED)
    assert flight.vehicle.truth(flight.now).ned[2] == pytest.approx(0.0, abs=0.01)
    assert flight.commander.why == ()
    count = len(flight.sent)
    flight.pass_s(5)
    assert len(flight.sent) == count


@pytest.mark.parametrize(
    ("make", "orders"),
    [
        (ardupilot, [(SET_MODE, Mode.GUIDED, 0), (ARM, 1), (NAV_TAKE_OFF,), (NAV_LAND,)]),
        (px4, [(SET_MODE, 4, 3), (ARM, 1), (NAV_TAKE_OFF,), (SET_MODE, 6, 0), (NAV_LAND,)]),
    ],
)
def test_each_autopilot_gets_its_own_orders_in_its_own_order(make: Callable[[], Any], orders: list[Any]) -> None:
    flight = flying(make())
    flight.pass_s(5)
    flight.commander.land(flight.now)
    flight.reach(Phase.ENDED)
    assert flight.orders == orders


@pytest.mark.parametrize("step", [0.05, 0.13, 0.2])
def test_px4_is_told_to_follow_set_points_once_they_flow_and_they_never_pause(step: float) -> None:
    flight = flying(px4(), step=step)
    flight.until(lambda: flight.vehicle.mode == OFFBOARD)
    first, *_ = [at for at, m in flight.sent if m.get_type() == "COMMAND_LONG" and m.param2 == 6]
    assert flight.set_points[0][0] <= first - 0.9
    texts = [event.text for event in flight.session.take_events() if isinstance(event, AutopilotText)]
    assert not any("OFFBOARD" in text for text in texts)
    flight.commander.steer((1.0, 0.0, 0.0))
    flight.pass_s(5)
    flight.deaf = True  # the order to land is lost for a while
    flight.commander.land(flight.now)
    flight.pass_s(0.7)
    flight.deaf = False
    flight.reach(Phase.ENDED)
    times = [at for at, _ in flight.set_points]
    assert max(b - a for a, b in pairwise(times)) < 0.45
    assert flight.commander.why == ()


@every("now, stalled_s", [(5.75, 1.0), (6.25, 0.0), (11.0, 0.875)])
def test_a_gap_between_set_points_counts_for_five_seconds(now: float, stalled_s: float) -> None:
    set_points = SetPoints()
    for at in (0.0, *(1.0 + 0.5 * n for n in range(19)), 10.875):
        if at <= now:
            set_points.left(at)
    assert set_points.stalled_s(now) == stalled_s


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4])
def test_until_it_lands_it_is_told_to_stand_still(autopilot: int) -> None:
    told = at(Phase.FLYING, autopilot)
    told.commander.steer((1.0, 0.5, -0.25))
    told.commander.land(told.now)
    still = [(m.vx, m.vy, m.vz) for m in told.hear(3.0) if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
    assert len(still) > 10
    assert set(still) == {(0.0, 0.0, 0.0)}
    assert told.beat(told.land, armed=True).hear(10.0) == []


def test_no_set_point_breaks_off_the_take_off() -> None:
    flight = Flight(ardupilot())
    flight.commander.steer((1.0, 1.0, 1.0))
    flight.until(lambda: flight.commander.phase is Phase.FLYING or flight.set_points)
    assert flight.commander.phase is Phase.FLYING


def test_a_set_point_is_a_velocity_and_a_heading_and_nothing_else() -> None:
    flight = flying(ardupilot())
    flight.commander.steer((0.5, -0.25, 0.125))
    flight.pass_s(1)
    m = flight.set_points[-1][1]
    assert (m.vx, m.vy, m.vz, m.coordinate_frame) == (0.5, -0.25, 0.125, dialect.MAV_FRAME_LOCAL_NED)
    used = ~m.type_mask & 0xDFF  # bit 9 makes a force of an acceleration
    assert used == 0b010000111000
    assert (m.target_system, m.target_component) == (1, 1)


@BOTH
@pytest.mark.parametrize("height", [0.5, 20.0])
def test_any_height_is_climbed_to(make: Callable[[], Any], height: float) -> None:
    flight = flying(make(), take_off_m=height)
    flight.pass_s(3)
    climbed = -flight.vehicle.truth(flight.now).ned[2]
    assert climbed > 0.8 * height
    assert climbed < 1.15 * height + (2.5 if isinstance(flight.vehicle, Px4) else 0.2)  # PX4 is stopped on its way up


# -- what counts is what is done ---------------------------------------------------------------------------


class Told:
    """A commander whose vehicle is scripted: `say` what it says, `hear` what it is told.

    It says its mode ten times a second, as it was said last, unless it is `silent`.
    """

    def __init__(self, autopilot: int = ARDUPILOT, **options: Any) -> None:
        self.autopilot = autopilot
        self.hold, self.take_off, self.steer, self.land = MODES[autopilot]
        self.session = KeepingSession(component=US)
        self.commander = Commander(self.session, self.session.kept.append, **({"take_off_m": 5.0} | options))
        self.now = 100.0
        self._encoders: dict[tuple[int, int], Encoder] = {}
        self._parser = Parser()
        self.silent = False
        self._state: dict[str, Any] = {}
        self.beat(0)
        self.fly_at(0.0)

    def say(self, message: Any, source: tuple[int, int] = (1, 1)) -> None:
        encoder = self._encoders.setdefault(source, Encoder(*source))
        self.commander.on_packets(self.session.feed(encoder.pack(message), self.now), self.now)

    def launch(self) -> None:
        """Launch it, and answer its first question."""
        self.commander.launch(self.now)
        (question,) = self._parser.feed(self.commander.poll(self.now))
        self.commander.sent(self.now)
        self.say(dialect.MAVLink_timesync_message(1, decode(question).ts1))

    def beat(self, mode: int, *, armed: bool = False, source: tuple[int, int] = (1, 1), autopilot: int = -1) -> Told:
        if source == (1, 1) and autopilot < 0:
            self._state = {"mode": mode, "armed": armed}
        autopilot = self.autopilot if autopilot < 0 else autopilot
        kind = dialect.MAV_TYPE_QUADROTOR
        self.say(dialect.MAVLink_heartbeat_message(kind, autopilot, 128 * armed, mode, 4, 3), source)
        return self

    def fly_at(self, height: float) -> Told:
        boot = round(self.now * 1e3)
        lat, lon, alt = (round(v * s) for v, s in zip(HOME, (1e7, 1e7, 1e3), strict=True))
        self.say(dialect.MAVLink_attitude_message(boot, 0, 0, 0.3, 0, 0, 0))
        self.say(dialect.MAVLink_global_position_int_message(boot, lat, lon, alt + round(height * 1e3), 0, 0, 0, 0, 30))
        return self

    def ack(self, command: int, result: int, target: tuple[int, int] = (1, US)) -> Told:
        self.say(dialect.MAVLink_command_ack_message(command, result, 0, 0, *target))
        return self

    def hear(self, after_s: float = 0.0) -> list[Any]:
        """What it is told in the next `after_s` seconds."""
        said, end = [], self.now + after_s
        while True:
            if not self.silent:
                self.beat(**self._state)
            said += [decode(packet) for packet in self._parser.feed(self.commander.poll(self.now))]
            said = [message for message in said if message.get_type() != "TIMESYNC"]
            self.commander.sent(self.now)
            if self.now >= end - 1e-9:
                return said
            self.now = min(self.now + 0.1, end)

    def after(self, seconds: float) -> Told:
        self.hear(seconds)
        return self

    def commands(self, after_s: float = 0.0) -> list[tuple[int, float]]:
        return [(m.command, m.param1) for m in self.hear(after_s) if m.get_type() == "COMMAND_LONG"]

    @property
    def lost_by(self) -> str:
        """Why it is lost, in words."""
        assert self.commander.phase is Phase.LOST
        return in_words(self.commander.why)

    def reach(self, phase: Phase) -> None:
        """By what an autopilot says that does as it is told."""
        commander = self.commander
        self.launch()
        self.hear()
        self.beat(self.hold)
        self.fly_at(0.0)
        self.hear(0.5)
        if phase is Phase.ARMING:
            return
        self.hear(0.6)  # until the order to arm has left
        self.beat(self.hold, armed=True)
        self.hear(0.5)
        self.beat(self.take_off, armed=True)
        if phase is Phase.CLIMBING:
            return
        self.fly_at(4.9)
        self.hear(2.0)
        self.beat(self.steer, armed=True)
        if phase is Phase.LANDING:
            commander.land(self.now)
        elif phase is Phase.HOLDING:
            commander.hold(self.now)
        self.hear()
        assert commander.phase is phase


def at(phase: Phase, *given: Any, **options: Any) -> Told:
    """A commander that has come so far."""
    told = Told(*given, **options)
    told.reach(phase)
    return told


ON = (Phase.ARMING, Phase.CLIMBING, Phase.FLYING, Phase.LANDING, Phase.HOLDING)
PILOTS = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4])


def test_before_the_launch_nothing_is_ordered() -> None:
    told = Told()
    told.commander.steer((1.0, 0.0, 0.0))
    told.commander.land(told.now)
    told.commander.hold(told.now)
    assert told.hear(10.0) == []


@PILOTS
def test_an_acknowledgement_is_not_the_deed(autopilot: int) -> None:
    told = Told(autopilot)
    told.launch()
    for _ in range(3):
        assert told.commands(1.0)[0] == (SET_MODE, 1)
        told.ack(SET_MODE, ACCEPTED)
        told.beat(0)
    told.beat(told.hold)
    for _ in range(3):
        assert (ARM, 1) in told.commands(3.0)
        told.ack(ARM, ACCEPTED)
        told.beat(told.hold)
    assert told.commander.phase is Phase.ARMING
    assert told.beat(told.hold, armed=True).commands()[0][0] == NAV_TAKE_OFF
    assert told.ack(NAV_TAKE_OFF, ACCEPTED).commands(4.8) == []  # it may take its time to spin up
    assert NAV_TAKE_OFF in dict(told.commands(0.4))
    told.beat(told.take_off, armed=True)
    assert told.fly_at(0.6).commands(10.0) == []
    told.fly_at(5.0)
    told.hear(2.0)
    assert told.beat(told.steer, armed=True).commander.phase is Phase.FLYING
    told.commander.land(told.now)
    for _ in range(3):
        assert told.commands(1.0)[0] == (NAV_LAND, 0)
        told.ack(NAV_LAND, ACCEPTED)
        told.beat(told.steer, armed=True)
    assert told.beat(told.land, armed=True).hear(3.0) == []
    assert told.beat(told.land).commander.phase is Phase.ENDED


def test_the_second_acknowledgement_of_px4_is_the_one_that_is_told() -> None:
    told = Told(PX4, arm_timeout_s=5.0)
    told.launch()
    while told.commander.phase is Phase.ARMING:
        assert ARM not in dict(told.commands(1.0))
        told.ack(SET_MODE, ACCEPTED)
        told.ack(SET_MODE, DENIED)
        told.beat(POSITION)
    assert told.lost_by == "the vehicle does not arm: setting the mode: DENIED"


def test_a_refused_take_off_is_tried_again_at_once() -> None:
    told = at(Phase.CLIMBING)
    for _ in range(3):
        assert (NAV_TAKE_OFF, 0) in told.commands(1.0)
        told.ack(NAV_TAKE_OFF, FAILED)


@every(
    "targets, why",
    [
        ([(1, 191), (1, 190), (255, US), (255, 190), (2, US)], "it gives no reason"),
        ([(1, US)], "arming: DENIED"),
        ([(0, 0)], "arming: DENIED"),
    ],
)
def test_what_is_answered_to_us_or_to_all_counts_and_no_other_answer(targets: list[tuple[int, int]], why: str) -> None:
    told = at(Phase.ARMING, arm_timeout_s=5.0)
    for target in targets:
        told.ack(ARM, DENIED, target)
        told.ack(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, FAILED, target)
    told.hear(6.0)
    assert in_words(told.commander.why) == f"the vehicle does not arm: {why}"


# -- refusals ----------------------------------------------------------------------------------------------


def chunks(text: str, id_: int, severity: int = dialect.MAV_SEVERITY_CRITICAL) -> Iterator[Any]:
    raw = text.encode()
    for seq, at in enumerate(range(0, len(raw) + (len(raw) % 50 == 0), 50)):
        yield dialect.MAVLink_statustext_message(severity, raw[at : at + 50], id_, seq)


@every(
    "came, text",
    [
        ((0, 1, 2, 3), "0123"),
        ((0, 1, 1, 2, 2, 3), "0123"),
        ((0, 2, 3), "0…23"),
        ((0, 3), "0…3"),
        ((2, 3), "…23"),
        ((1, *[2] * 1000, 3), "…123"),
        ((0, 1, 0, 1, 2, 3), "0123"),
    ],
)
def test_a_text_in_chunks_that_come_twice_or_never(came: tuple[int, ...], text: str) -> None:
    complaints = Complaints()
    for seq in came:
        chunk = str(seq).encode() * (50 if seq < 3 else 9)
        whole = complaints.on_text(dialect.MAVLink_statustext_message(2, chunk, 7, seq))
    assert "".join(one for one, _ in groupby(whole)) == text
    assert len(whole) <= 2 + 3 * 50 + 9


def test_chunks_without_an_end_fill_no_memory() -> None:
    complaints = Complaints()
    for _ in range(10_000):
        assert complaints.on_text(dialect.MAVLink_statustext_message(2, b"x" * 50, 7, 1)) == ""
    assert len(str(complaints._open)) < 1000


def test_it_says_why_it_does_not_arm() -> None:
    told = Told(arm_timeout_s=20.0)
    told.say(dialect.MAVLink_statustext_message(4, b"PreArm: said before the launch"))
    told.reach(Phase.ARMING)
    reason = "PreArm: Compass not calibrated, see the wiki; and GPS 1 is still configuring this GPS"
    for _ in range(3):
        for chunk in chunks(reason, 7):
            told.say(chunk)
            told.fly_at(0.0)
            told.say(dialect.MAVLink_statustext_message(dialect.MAV_SEVERITY_INFO, b"EKF3 IMU0 is using GPS"))
            told.say(dialect.MAVLink_statustext_message(2, b"Arm: Throttle too high"))
        told.ack(ARM, FAILED)
        told.hear(3.0)
    texts = [event.text for event in told.session.take_events() if isinstance(event, AutopilotText)]
    assert texts == ["PreArm: said before the launch", "Arm: Throttle too high", reason]
    assert told.after(20.0).commander.phase is Phase.LOST
    why = f"arming: FAILED; PreArm: said before the launch; Arm: Throttle too high; {reason}"
    assert in_words(told.commander.why) == f"the vehicle does not arm: {why}"
    assert told.hear(100.0) == []


def test_a_refused_arming_is_not_repeated_in_a_hurry() -> None:
    told = at(Phase.ARMING, arm_timeout_s=60.0)
    sent = []
    for _ in range(50):
        sent += told.commands(1.0)
        told.ack(ARM, FAILED)
        told.beat(told.hold)
    assert 10 <= sent.count((ARM, 1)) <= 20


@BOTH
def test_a_take_off_that_comes_to_nothing_ends_on_the_ground(make: Callable[[], Any]) -> None:
    flight = Flight(make(), take_off_m=3.0)
    flight.until(lambda: (ARM, 1) in flight.orders)
    flight.deaf = True
    flight.reach(Phase.CLIMBING)
    flight.until(lambda: flight.commander.phase is not Phase.CLIMBING)
    assert flight.commander.phase is Phase.LOST  # it has disarmed itself, as autopilots do that stay on the ground
    assert in_words(flight.commander.why).startswith("it was disarmed")
    assert flight.vehicle.truth(flight.now).ned[2] == pytest.approx(0.0, abs=0.01)


@PILOTS
def test_a_climb_that_does_not_end_is_landed(autopilot: int) -> None:
    told = Told(autopilot)
    told.say(dialect.MAVLink_statustext_message(2, b"PreArm: of before"))
    told.reach(Phase.CLIMBING)
    told.ack(NAV_TAKE_OFF, FAILED)
    told.fly_at(3.0)  # and there it stays
    assert NAV_LAND not in dict(told.commands(34.0))
    assert (NAV_LAND, 0) in told.commands(2.0)
    told.beat(told.land, armed=True)
    assert told.beat(told.land).commander.phase is Phase.ENDED
    assert in_words(told.commander.why) == "the vehicle does not take off: take-off: FAILED"


def test_px4_that_does_not_follow_set_points_is_landed() -> None:
    told = at(Phase.CLIMBING, PX4)
    told.fly_at(5.0)
    told.hear(2.0)
    for _ in range(12):
        told.ack(SET_MODE, ACCEPTED)
        told.ack(SET_MODE, REJECTED)
        told.beat(TAKE_OFF, armed=True)
        told.hear(1.0)
    assert told.commander.phase is Phase.LANDING
    assert (
        in_words(told.commander.why) == "the vehicle does not follow velocities: setting the mode: TEMPORARILY_REJECTED"
    )


@PILOTS
def test_a_landing_that_does_not_end_is_given_up(autopilot: int) -> None:
    told = at(Phase.LANDING, autopilot)
    told.beat(told.land, armed=True)
    assert told.after(95.0).commander.phase is Phase.LANDING  # 4.9 m take a little longer
    assert told.after(10.0).lost_by == "the vehicle does not land: it gives no reason"


@every(
    "autopilot, kind, why",
    [
        (ARDUPILOT, dialect.MAV_TYPE_FIXED_WING, "ardupilotmega fixed_wing 1/1 is not a multirotor"),
        (PX4, dialect.MAV_TYPE_GROUND_ROVER, "is not a multirotor"),
        (dialect.MAV_AUTOPILOT_GENERIC, dialect.MAV_TYPE_QUADROTOR, "generic quadrotor 1/1 is neither ArduPilot nor"),
    ],
)
def test_what_cannot_be_flown_is_not_armed(autopilot: int, kind: int, why: str) -> None:
    session = KeepingSession()
    session.feed(Encoder(1, 1).pack(dialect.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 3, 3)), 0.0)
    commander = Commander(session, session.kept.append, take_off_m=2.0)
    with pytest.raises(ValueError, match=why):
        commander.launch(0.0)
    assert [packet.msgid for packet in Parser().feed(commander.poll(1.0))] == [dialect.MAVLINK_MSG_ID_TIMESYNC]


# -- the pilot has the last word ---------------------------------------------------------------------------

TAKE_OVERS = [
    *((ARDUPILOT, mode, name) for mode, name in [(0, "STABILIZE"), (5, "LOITER"), (6, "RTL"), (17, "BRAKE")]),
    *((PX4, mode, name) for mode, name in [(POSITION, "position"), (RETURN, "return"), (2 << 16, "altitude")]),
    (ARDUPILOT, 99, "mode 99"),
    (PX4, 77 << 24 | 4 << 16, "mode 4/77"),
]


@pytest.mark.parametrize("phase", ON)
@every("autopilot, mode, name", TAKE_OVERS)
def test_a_mode_that_was_not_ordered_ends_all_orders(phase: Phase, autopilot: int, mode: int, name: str) -> None:
    told = at(phase, autopilot)
    assert (
        told.beat(mode, armed=phase is not Phase.ARMING).lost_by
        == f"the mode is {name}: the pilot or a failsafe has taken over"
    )
    told.commander.steer((1.0, 0.0, 0.0))
    told.commander.land(told.now)
    told.commander.hold(told.now)
    told.beat(told.hold, armed=True)
    assert told.beat(told.steer, armed=True).hear(10.0) == []


@pytest.mark.parametrize("pinned", [False, True])
def test_a_heartbeat_of_another_kind_of_autopilot_does_not_reach_the_commander(pinned: bool) -> None:
    flight = Flight(ardupilot())
    if pinned:
        flight.session.pin()
    beat = Encoder(1, 1).pack(dialect.MAVLink_heartbeat_message(2, PX4, 128, HOLD, 4, 3))
    received = flight.session.feed(beat, flight.now)
    assert (len(received.own), len(received.others)) == (0, 1)


def test_a_vehicle_whose_home_is_not_known_is_not_taken_over() -> None:
    flight = Flight(ardupilot())
    flight.session.navigation.home = None
    with pytest.raises(ValueError, match="its pose, its home or its mode is not known"):
        flight.commander.take_over(flight.now)


@pytest.mark.parametrize("phase", [Phase.FLYING, Phase.LANDING])
def test_hold_is_a_take_over_of_px4_too(phase: Phase) -> None:
    told = at(phase, PX4)
    told.beat(HOLD, armed=True)
    assert "the mode is hold" in told.lost_by


@every("height", [0.2, 0.7, 2.5, 4.3])
def test_hold_is_a_take_over_in_the_climb_at_any_height(height: float) -> None:
    told = at(Phase.CLIMBING, PX4)
    assert told.fly_at(height).hear(0.3) is not None
    assert told.beat(HOLD, armed=True).lost_by == "the mode is hold: the pilot or a failsafe has taken over"
    assert told.hear(60.0) == []


def test_before_px4_has_said_that_it_takes_off_hold_is_the_mode_that_it_armed_in() -> None:
    told = at(Phase.ARMING, PX4)
    told.hear(0.6)
    told.beat(HOLD, armed=True)
    assert NAV_TAKE_OFF in dict(told.commands(2.0))
    assert told.commander.phase is Phase.CLIMBING
    told.fly_at(0.7)
    assert told.beat(HOLD, armed=True).commander.phase is Phase.LOST


@every("height", [0.5, 2.0, 5.0])
def test_px4_never_ends_its_take_off_by_itself(height: float) -> None:
    flight = Flight(px4(), take_off_m=height)
    modes = []
    flight.until(lambda: modes.append(flight.vehicle.mode) or flight.vehicle.mode == OFFBOARD)  # type: ignore[union-attr]
    assert [mode for mode, _ in groupby(modes)] == [POSITION, HOLD, TAKE_OFF, OFFBOARD]


@every("phase", ON)
def test_what_others_say_changes_nothing(phase: Phase) -> None:
    told = at(phase, arm_timeout_s=60.0)
    before = repr({k: v for k, v in vars(told.commander).items() if k != "_session"})
    text = dialect.MAVLink_statustext_message(2, b"PreArm: not mine")
    ack = dialect.MAVLink_command_ack_message(ARM, DENIED, 0, 0, 1, US)
    status = dialect.MAVLink_sys_status_message(0, 7, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)
    for source in [(2, 1), (1, 2), (1, 191), (1, US), (255, 190), (255, 1), (0, 0)]:
        for mode in (0, told.land, told.hold):
            for armed in (False, True):
                told.beat(mode, armed=armed, source=source)
        for message in (text, ack, status):
            told.say(message, source)
    told.beat(0, autopilot=dialect.MAV_AUTOPILOT_INVALID)  # a companion that calls itself 1/1
    assert repr({k: v for k, v in vars(told.commander).items() if k != "_session"}) == before


def test_somebody_else_arms_it() -> None:
    told = Told()
    told.launch()
    told.hear()
    assert told.beat(Mode.STABILIZE, armed=True).lost_by == "another program or person has armed it, in STABILIZE"
    assert told.hear(10.0) == []


@every("phase", [Phase.CLIMBING, Phase.FLYING, Phase.HOLDING])
def test_it_is_disarmed(phase: Phase) -> None:
    told = at(phase)
    assert told.beat(told.steer).lost_by == "it was disarmed; the mode is GUIDED"
    assert told.hear(10.0) == []


@every("phase", ON)
def test_let_go_is_for_good(phase: Phase) -> None:
    told = at(phase)
    told.commander.let_go()
    told.beat(told.hold, armed=True)
    told.commander.land(told.now)
    assert told.hear(60.0) == []


# -- broken off --------------------------------------------------------------------------------------------


def test_a_hold_that_is_refused_is_given_up() -> None:
    told = at(Phase.HOLDING, PX4)
    for _ in range(6):
        told.ack(SET_MODE, DENIED)
        told.beat(OFFBOARD, armed=True)
        told.hear(1.0)
    assert told.lost_by == "the vehicle does not hover: setting the mode: DENIED"


@pytest.mark.parametrize("order", [Commander.hold, Commander.land])
def test_on_the_ground_it_is_disarmed(order: Callable[[Commander, float], None]) -> None:
    told = at(Phase.ARMING)
    order(told.commander, told.now)
    assert told.commands() == [(ARM, 0)]
    told.beat(told.hold, armed=True)  # the order to arm was on its way
    assert told.commands(1.1) == [(ARM, 0)]
    assert told.beat(told.hold).commander.phase is Phase.ENDED
    assert told.hear(10.0) == []


def test_it_is_disarmed_in_whatever_mode_it_still_is() -> None:
    told = Told(PX4)
    told.launch()
    told.beat(POSITION)
    told.commander.hold(told.now)
    assert told.commands(0.3) == [(ARM, 0)]
    assert told.after(1.0).commander.phase is Phase.ENDED


# -- whatever comes ----------------------------------------------------------------------------------------

HEARD = [0, 1, 77, 253]


@given(st.sampled_from(ON), st.lists(st.tuples(st.sampled_from(HEARD), st.binary(max_size=60)), max_size=8))
def test_no_values_of_the_vehicle_make_it_raise(phase: Phase, said: list[tuple[int, bytes]]) -> None:
    told = at(phase, PX4)
    for msgid, payload in said:
        told.now += 0.7
        head = bytes([len(payload), 0, 0, 0, 1, 1]) + msgid.to_bytes(3, "little")
        crc = x25crc(head + payload + bytes([dialect.mavlink_map[msgid].crc_extra])).crc
        received = told.session.feed(b"\xfd" + head + payload + crc.to_bytes(2, "little"), told.now)
        told.commander.on_packets(received, told.now)
        told.hear()
        told.session.take_events()
    if told.commander.phase in SILENT:
        assert told.hear(5.0) == []


def test_an_answer_to_another_program_is_no_late_one() -> None:
    """The vehicle sends its answers on all its links; the numbers of two programs have nothing in common."""
    authority = Authority()
    authority.on_timesync(SimpleNamespace(tc1=1, ts1=5), 1.0, 1.0)
    assert not authority.slow(5.0)
    authority.on_timesync(SimpleNamespace(tc1=1, ts1=authority.question(2.0).ts1), 3.0, 3.0)
    assert authority.slow(5.0)


def test_who_has_the_vehicle_follows_from_the_reports_of_its_mode() -> None:
    authority, holders = Authority(), [Holder.UNKNOWN]

    def now_has(holder: Holder) -> None:
        assert authority.holder is holder
        assert holder in (holders[-1], *HOLDERS[holders[-1]].then)
        holders.append(holder)

    now_has(Holder.UNKNOWN)
    authority.on_mode(5, 0.0, 0.1)
    now_has(Holder.SEARCH)  # nothing is ordered yet
    authority.want(4)
    now_has(Holder.OTHER)
    authority.on_mode(4, 0.2, 0.3)
    now_has(Holder.SEARCH)
    authority.doubt(1.0)
    authority.on_mode(4, 1.0, 1.1)
    now_has(Holder.UNKNOWN)  # until the vehicle has answered
    authority.on_timesync(SimpleNamespace(tc1=1, ts1=authority.question(1.1).ts1), 1.1, 1.2)
    authority.on_mode(5, 1.2, 1.3)
    now_has(Holder.OTHER)
