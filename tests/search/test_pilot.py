"""The pilot and the failsafes have the last word, a vehicle that does not follow is landed, another gets no order."""

from __future__ import annotations

import cmath
import itertools
import math
import random
import re
import struct
from collections.abc import Callable
from typing import Any

import pytest
from fastcrc import crc16

from arva_hil.autopilot.commanding.authority import BOUND_MS
from arva_hil.clock import Clock
from arva_hil.events.searches import SearchEnded
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.mavlink.dialect import CRC_EXTRA, MAVLINK_MSG_ID_CURRENT_MODE
from arva_hil.search.flight import links
from arva_hil.search.flight.airborne import Deviation, SetPointCheck
from arva_hil.simulated import arducopter
from arva_hil.simulated.arducopter import FAILSAFES
from arva_hil.simulated.autopilot import Mode
from arva_hil.simulated.vehicle import SimulatedVehicle
from firmware_proto import Channel, Frame, encode
from tests import simulated_px4
from tests.every import every
from tests.search.test_client import (
    BOTH,
    GLOBAL_POSITION,
    GUIDED_ALONE,
    HOME,
    LEFT,
    VICTIM,
    World,
    ardupilot,
    changed,
    delay,
    flown,
    hunting,
    modes_said,
    px4,
    reaching,
    set_points,
    widest_gap,
    without,
)
from tests.simulated_px4 import HOLD, OFFBOARD, POSITION, Px4

NAV_LAND, SET_MODE = dialect.MAV_CMD_NAV_LAND, dialect.MAV_CMD_DO_SET_MODE
TAKEN = "the mode is {}: the pilot or a failsafe has taken over"
HELD_UP = (
    TAKEN
    + " (this program was delayed, and sent no set-point for {} s before: PX4 leaves OFFBOARD after COM_OF_LOSS_T)"
)
PAUSED = "the search did nothing for"


def pilots(world: World) -> int:
    return POSITION if isinstance(world.vehicle, Px4) else int(Mode.LOITER)


def stopped(
    world: World, seconds: float, *, lost_from: float = math.inf, switch: float = math.inf, mode: int = 0
) -> float:
    """The search's process stands still, as by SIGSTOP; what is sent to it waits in its buffers. When it goes on.

    What comes later than `lost_from` is lost, as in a full buffer. `switch`: when somebody chooses `mode`.
    """
    stops, pass_on = world.clock.now(), world.between
    world._tasks.remove(world.client)
    world.between = lambda data: data if world.clock.now() < stops + lost_from else b""
    world.pass_s(min(switch, seconds))
    if switch < seconds:
        world.pilot(mode)
        world.pass_s(seconds - switch)
    world.between = pass_on
    world._tasks.append(world.client)
    return world.clock.now()


# -- pauses ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "seconds", "switch", "lost_from"),
    [
        (ardupilot, 14.0, 13.0, 2.0),
        (px4, 14.0, 0.5, 0.0),
        (px4, 3.0, 2.9, math.inf),
        (ardupilot, 1.2, 0.1, math.inf),
    ],
)
def test_after_a_pause_the_pilot_who_took_over_meanwhile_hears_nothing(
    make: Callable[[], Any], seconds: float, switch: float, lost_from: float
) -> None:
    """What is not lost may hold no heartbeat."""
    world = hunting(make(), take_off=5.0, height=5.0)
    goes_on = stopped(world, seconds, lost_from=lost_from, switch=switch, mode=pilots(world))
    how = world.fail(4.0)
    assert how.partition(" (this program was delayed")[0] == TAKEN.format("position" if make is px4 else "LOITER")
    world.stay_silent(5, since=goes_on)


def test_after_a_pause_that_nobody_used_the_search_goes_on() -> None:
    world = hunting(ardupilot())
    before = world.ned
    goes_on = stopped(world, 14.0)
    assert world.end() == ("found", "found")
    assert any(text.startswith(PAUSED) for text in world.said)
    assert not any("no frame" in text for text in world.said)
    assert world.ned == pytest.approx((*VICTIM, 0.0), abs=0.6)
    assert math.dist(before, world.ned) > 1
    (answered, *_) = [at for at, m in world.told if m.get_type() == "TIMESYNC" and at >= goes_on]
    assert answered <= min(at for at, _ in set_points(world) if at >= goes_on)


@BOTH
def test_after_a_pause_on_the_ground_it_flies(make: Callable[[], Any]) -> None:
    """It is launched later than the vehicle may be silent: before the launch nothing is asked."""
    world = World(make(), countdown_s=3.0)
    world.pass_s(1.0)
    stopped(world, 1.2)
    world.reach("flying")


def test_after_a_pause_old_words_of_the_mode_do_not_count() -> None:
    """They say GUIDED as long as they wait in some buffer; only what follows the answer to a question is news."""
    world = hunting(ardupilot())
    goes_on = stopped(world, 5.0)
    world.between = without(dialect.MAVLINK_MSG_ID_TIMESYNC)
    late = "the vehicle has not reported its mode for 2.5 s, or not within 0.5 s of a question"
    assert world.fail(4.0) == f"{late}; {LEFT}: {GUIDED_ALONE}"
    world.stay_silent(10, since=goes_on)


@pytest.mark.parametrize(
    ("seconds", "switch", "lost_from", "mode"),
    [(2.0, math.inf, math.inf, "position"), (14.1, 10.0, 4.0, "hold")],
)
def test_after_a_pause_the_mode_is_named_that_px4_is_in(
    seconds: float, switch: float, lost_from: float, mode: str
) -> None:
    """PX4 leaves OFFBOARD by itself, and then somebody may choose Hold. A person may look for a failure else."""
    world = hunting(px4(), take_off=5.0, height=5.0)
    goes_on = stopped(world, seconds, switch=switch, lost_from=lost_from, mode=HOLD)
    how = world.fail(4.0)
    (delayed,) = re.findall(r"sent no set-point for ([\d.]+) s before", how)
    assert how == HELD_UP.format(mode, delayed)
    assert seconds <= float(delayed) <= seconds + (0.7 if mode == "position" else 0.21)
    assert sum(text.startswith(PAUSED) for text in world.said) == 1
    assert not any("strategy" in text for text in world.said)
    world.stay_silent(5, since=goes_on)


def test_set_points_never_stop_while_the_link_lives() -> None:
    """From the climb until it hovers; orders wait for news of the mode, set-points do not."""
    world = hunting(px4())
    world.client.stop()
    world.end()
    assert widest_gap(at for at, _ in set_points(world)) <= 0.25


@BOTH
def test_set_points_wait_for_no_message_of_the_vehicle_and_no_step(make: Callable[[], Any]) -> None:
    """One that left a little after a step is due a little after the next step, and nothing else wakes the search."""
    world = hunting(make())
    due = world.client._due

    def slow(now: float) -> tuple[bytes, bytes]:
        world.clock.wait(world.clock.now() + 0.001)
        return due(now)

    world.client._due = slow  # type: ignore[method-assign]
    world.clock.wait(world.clock.now() + 0.3)
    begun = world.clock.now()
    world.pass_s(0.01)
    world.client._due = due  # type: ignore[method-assign]
    world.between = lambda data: b""
    world.pass_s(1.0)
    assert widest_gap(at for at, _ in set_points(world) if at >= begun) <= 0.21


@pytest.mark.parametrize("refused", ["late", "full"])
def test_a_set_point_that_did_not_leave_is_sent_again_at_once(refused: str) -> None:
    """On a loaded computer: every other look at the link is held up for 60 ms, or its buffer is full.

    Set-points are no farther apart than the computer itself makes them.
    """
    world = hunting(px4())
    load = random.Random(1)
    due, write = world.client._due, world.autopilot.write
    row = longest = 0

    def held_up() -> bool:
        nonlocal row, longest
        row = row + 1 if load.random() < 0.5 else 0
        longest = max(longest, row)
        return row > 0

    def slow(now: float) -> tuple[bytes, bytes]:
        out = due(now)
        if held_up():
            world.clock.wait(world.clock.now() + 0.06)
        return out

    if refused == "late":
        world.client._due = slow  # type: ignore[method-assign]
    else:
        world.autopilot.write = lambda data: not held_up() and write(data)  # type: ignore[method-assign]
    world.until(lambda: world.client.outcome or longest > 8)
    assert widest_gap(at for at, _ in set_points(world)) <= 0.25 + 0.06 * longest


def test_a_flood_that_cannot_be_read_to_its_end_gets_no_order_and_does_not_hold_it_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(links, "_AT_ONCE", 1 << 14)
    world = hunting(ardupilot())
    link, read, ready = world.autopilot, world.autopilot.read, world.autopilot.ready
    noise = b"\x00" * (1 << 12)
    serving: list[bool] = []
    service = world.client.service

    def served(clock: Clock) -> float:
        serving.append(True)
        due = service(clock)
        serving.clear()
        return due

    link.read = lambda: read() + noise  # type: ignore[method-assign]
    link.ready = lambda: bool(serving) or ready()  # type: ignore[method-assign]
    world.client.service = served  # type: ignore[method-assign]
    floods = world.clock.now()
    assert world.fail(6.0).startswith("the vehicle has not reported its mode for 2.5 s")
    world.stay_silent(1, since=floods + 0.05)


# -- the last moment ---------------------------------------------------------------------------------------


class Hand:
    """Switches at an instant. A task."""

    links = ()

    def __init__(self, world: World, mode: int, at: float) -> None:
        self._world, self._mode, self._at = world, mode, at

    def service(self, clock: Clock) -> float:
        if clock.now() >= self._at:
            self._at = math.inf
            self._world.pilot(self._mode)
        return self._at


@pytest.mark.parametrize(("make", "ms"), [(ardupilot, 0), (ardupilot, 150), (px4, 25), (px4, 250)])
def test_a_switch_just_before_the_search_ends_is_not_overridden(make: Callable[[], Any], ms: int) -> None:
    """Whenever the pilot switches: what the vehicle is in at the end is what the pilot has chosen."""
    world = World(make())
    said, wanted = modes_said(world), pilots(world)
    (ended,) = (event for event in flown(make)[0].events if isinstance(event, SearchEnded))
    switches = ended.time_s + 0.061 - ms / 1e3
    world._tasks.insert(0, Hand(world, wanted, switches))  # type: ignore[arg-type]
    world.end()
    assert world.after(5).mode == wanted
    heard = min(at for at, mode in said if at >= switches and mode == wanted)
    assert world.orders(heard + BOUND_MS / 1e3) == []
    assert heard - switches < 0.15


@BOTH
def test_a_link_that_becomes_slow_stops_the_vehicle_and_ends_the_search(make: Callable[[], Any]) -> None:
    """An order to land would arrive after a switch of the pilot that is not reported here yet, and override it."""
    world = hunting(make(), take_off=10.0, height=5.0)
    slow_since = world.clock.now()
    delay(world, 1.4)
    assert world.fail(4.0).startswith(f"the link is slow: an answer of the vehicle takes more than 0.5 s; {LEFT}")
    assert world.vehicle.truth(world.clock.now()).velocity == pytest.approx((0, 0, 0), abs=0.1)
    assert {type(m).id for m in world.orders(slow_since)} == {dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED}


@BOTH
def test_one_late_answer_ends_nothing(make: Callable[[], Any]) -> None:
    world = hunting(make(), take_off=10.0, height=5.0)
    delay(world, 0.8)
    world.pass_s(1.0)
    delay(world, 0.1)
    assert world.end() == ("found", "found")


def test_a_ground_station_that_sends_it_to_a_place_in_guided_gets_it() -> None:
    """The search would override it with its next set-point, and no mode changes."""
    world = hunting(ardupilot())
    there = dialect.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0xDF8, -9, 0, -5, *[0] * 8)
    for _ in range(2):  # a person tries again
        world.others.write(Encoder(255, 190).pack(there))
        world.pass_s(1.03)
    sent = "a ground station or another program has sent the vehicle to a place; send it there again"
    assert world.end() == ("failed", sent)
    world.others.write(Encoder(255, 190).pack(there))
    world.stay_silent(10, since=world.clock.now())
    assert world.ned == pytest.approx((-9, 0, -5), abs=0.5)


@BOTH
def test_orders_answer_news_of_the_mode(make: Callable[[], Any]) -> None:
    """So a pilot's switch after the news comes after the order too, and is not overridden."""
    world, said = flown(make)
    ordered = [at for at, m in world.told if getattr(m, "command", None) in (SET_MODE, NAV_LAND, 400, 22)]
    assert len(ordered) >= 4
    assert max(min(at - news for news, _ in said if news <= at) for at in ordered) <= 0.25


@BOTH
def test_the_mode_is_told_sooner_than_once_a_second(make: Callable[[], Any]) -> None:
    _, said = flown(make)
    assert sum(9 < at <= 13 for at, _ in said) > 8  # while it flies


# -- the sticks, and the battery ---------------------------------------------------------------------------


def test_a_throttle_stick_that_is_down_would_sink_it_in_loiter() -> None:
    vehicle = ardupilot()
    vehicle._pilot.sticks = (1500, 1500, 1000, 1500)
    world = hunting(vehicle)
    vehicle._pilot.sticks = (1700, 1500, 1000, 1500)
    assert world.after(5).client.outcome is None
    world.stand_still(3)
    assert vehicle._pilot.mode is Mode.GUIDED
    assert any("until the throttle stick is in the middle" in text for text in world.said)
    vehicle._pilot.sticks = (1500, 1500, 1480, 1500)
    assert world.fail(2.0).endswith("the pilot has it, in LOITER")


def test_a_stick_that_moves_before_it_flies_keeps_it_on_the_ground() -> None:
    vehicle = px4(healthy=False)
    world = reaching("arming", vehicle)
    world.pass_s(2)
    vehicle._vehicle._pilot.sticks = (1500, 1500, 1900, 1500)
    assert world.end(4.0) == ("failed", "the pilot has moved a stick (channel 3, by 400 µs)")
    assert not world.armed


LOW, UNHEALTHY = dialect.MAV_BATTERY_CHARGE_STATE_LOW, dialect.MAV_BATTERY_CHARGE_STATE_UNHEALTHY
SYS_STATUS, BATTERY_STATUS = dialect.MAVLINK_MSG_ID_SYS_STATUS, dialect.MAVLINK_MSG_ID_BATTERY_STATUS


def says(message: int, state: int = LOW, *, until: Callable[[], bool] = lambda: False) -> Callable[[bytes], bytes]:
    """The vehicle says by this message that a failsafe of its battery has triggered, or that it is not measured.

    From `until` on it says that all is well.
    """
    encoder = Encoder(1, 1)
    battery = dialect.MAV_SYS_STATUS_SENSOR_BATTERY

    def between(data: bytes) -> bytes:
        well = until()
        if message == SYS_STATUS:
            word = dialect.MAVLink_sys_status_message(battery, battery, battery * well, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)
        else:
            now = dialect.MAV_BATTERY_CHARGE_STATE_OK if well else state
            word = dialect.MAVLink_battery_status_message(0, 0, 0, 0, [0] * 10, 0, 0, 0, 20, charge_state=now)
        return data + (encoder.pack(word) if data else b"")

    return between


ILL = "the battery is not healthy"
WORDS = [(SYS_STATUS, LOW, ILL), (BATTERY_STATUS, LOW, "low battery"), (BATTERY_STATUS, UNHEALTHY, ILL)]


@pytest.mark.parametrize(
    ("make", "message", "state", "why", "mode"),
    [*((ardupilot, *words, Mode.LOITER) for words in WORDS), (px4, BATTERY_STATUS, LOW, "low battery", HOLD)],
)
def test_a_battery_ends_it_even_where_the_failsafe_only_warns(
    make: Callable[[], Any], message: int, state: int, why: str, mode: int
) -> None:
    world = hunting(make())
    world.between = says(message, state)
    assert world.fail(3.0) == why + ("; the pilot has it, in LOITER" if make is ardupilot else "")
    assert world.mode == mode


def test_a_throttle_that_was_in_the_middle_seconds_ago_orders_no_loiter() -> None:
    """The stick may be down by now, and LOITER would sink."""
    world = hunting(ardupilot())
    world.between = without(dialect.MAVLINK_MSG_ID_RC_CHANNELS)
    world.pass_s(3)
    low, quiet = says(BATTERY_STATUS), world.between
    world.between = lambda data: quiet(low(data))
    assert "low battery; the autopilot receives no radio, so the pilot cannot have it" in world.fail(2.0)
    assert world.mode == Mode.GUIDED


@pytest.mark.parametrize(("make", "message"), [(ardupilot, SYS_STATUS), (px4, BATTERY_STATUS)])
def test_a_battery_that_was_not_measured_yet_is_waited_for(make: Callable[[], Any], message: int) -> None:
    """ArduPilot's first words of a battery, behind its start, are that it is not healthy: no failsafe has triggered."""
    world = World(make())
    world.between = says(message, UNHEALTHY, until=lambda: world.clock.now() > 12.0)
    world.until(lambda: world.clock.now() > 11.0)
    assert not any(m.get_type() == "COMMAND_LONG" and m.command == 400 for _, m in world.told)
    assert any(text.startswith("waiting for the battery") for text in world.said)
    world.reach("climbing")


@pytest.mark.parametrize(
    ("make", "message", "why"),
    [
        (ardupilot, SYS_STATUS, f"{ILL}, or not measured: nothing was flown"),
        (px4, BATTERY_STATUS, "low battery: charge or change it, and restart the autopilot; nothing was flown"),
    ],
)
def test_with_a_bad_battery_nothing_is_armed(make: Callable[[], Any], message: int, why: str) -> None:
    """As ArduPilot has it after a flight that emptied it, until it is restarted."""
    world = World(make(), {"timeout_s": 20.0})
    world.between = says(message)
    assert world.fail(25.0) == why
    assert world.orders() == []


# -- another drone -----------------------------------------------------------------------------------------


class Changing:
    """One vehicle, and from `now` on another one with the same ids, on the same link."""

    def __init__(self, world: World, silence_s: float, other: SimulatedVehicle) -> None:
        self.told: list[bytes] = []
        self._other = other
        self._silent_until = world.clock.now() + silence_s
        self._clock = world.clock
        world.between = self._speak
        read = world.far.read
        world.far.read = lambda: self._hear(read())  # type: ignore[method-assign]

    def _hear(self, data: bytes) -> bytes:
        if data and self._clock.now() >= self._silent_until:
            self.told.append(data)
            self._other.feed(data, self._clock.now())
        return b""

    def _speak(self, data: bytes) -> bytes:
        return self._other.poll(self._clock.now()) if self._clock.now() >= self._silent_until else b""


def elsewhere(north_m: float, **options: Any) -> SimulatedVehicle:
    """A second drone, in the air and in GUIDED."""
    other = (
        ardupilot(**options)
        if not north_m
        else SimulatedVehicle(
            (HOME[0] + north_m / 111_200, *HOME[1:]),
            streams={dialect.MAVLINK_MSG_ID_ATTITUDE: 10, dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10},
            **options,
        )
    )
    other._pilot.ready = True
    other._pilot.set_mode(Mode.GUIDED)
    other._pilot.arm()
    other._pilot.take_off(2.0)
    return other


@pytest.mark.parametrize(
    ("north_m", "booted", "silence_s"),
    [
        (0.0, -5.0, 0.3),  # its clock is behind
        (0.0, 5.0, 1.0),
        (40.0, 0.0, 2.0),
        (400.0, 2.0, 1.0),
    ],
)
def test_another_drone_with_the_same_ids_is_not_flown(north_m: float, booted: float, silence_s: float) -> None:
    world = hunting(ardupilot(), take_off=2.0)
    other = elsewhere(north_m, boot_time=booted)
    other.poll(world.clock.now())
    before = other.truth(world.clock.now()).ned
    change = Changing(world, silence_s, other)
    assert LEFT in world.fail(5.0)
    world.pass_s(5)
    told = Parser().feed(b"".join(change.told))
    orders = [p for p in told if p.msgid in (84, 76)]
    assert [p for p in orders if p.msgid == 76 and decode(p).command in (SET_MODE, NAV_LAND)] == []  # type: ignore[union-attr]
    assert math.dist(before[:2], other.truth(world.clock.now()).ned[:2]) < 0.1


def test_one_lie_ends_nothing() -> None:
    world = hunting(ardupilot())
    encoder, lies = Encoder(1, 1), iter([1])

    def lying(data: bytes) -> bytes:
        lat, lon, alt = round((HOME[0] + 1) * 1e7), round(HOME[1] * 1e7), 0
        boot = round(world.clock.now() * 1e3)
        lie = dialect.MAVLink_global_position_int_message(boot, lat, lon, alt, 0, 0, 0, 0, 0)
        ahead = dialect.MAVLink_attitude_message(boot + 60_000, 0, 0, 0, 0, 0, 0)
        return data + (encoder.pack(lie) + encoder.pack(ahead) if data and next(lies, 0) else b"")

    world.between = lying
    assert world.end() == ("found", "found")


@pytest.mark.parametrize(("make", "message"), [(ardupilot, dialect.MAVLINK_MSG_ID_ATTITUDE), (px4, GLOBAL_POSITION)])
def test_one_stream_of_another_clock_ends_it(make: Callable[[], Any], message: int) -> None:
    world = hunting(make())
    world.between = changed(message, "time_boot_ms", lambda boot_ms: boot_ms - 5000)
    why = world.fail(3.0)
    assert "clock" in why
    assert LEFT in why


# -- at the end --------------------------------------------------------------------------------------------


def test_a_vehicle_that_is_still_armed_at_the_end_is_no_good_end() -> None:
    vehicle = ardupilot()
    world = reaching("landing", vehicle)
    vehicle._pilot.disarm = lambda force=False: False  # type: ignore[method-assign]
    world.client._commander._times.limit_s = 8.0
    why = "the vehicle is still armed, and does not report that it has landed. If it stands, keep away"
    assert world.fail(10.0).startswith(why)
    assert world.client.outcome.found[:2] == VICTIM


def test_each_try_of_arming_is_said() -> None:
    world = World(px4(healthy=False), {"arm_timeout_s": 8.0})
    world.end()
    said = [text for text in world.said if text.startswith("arming, try")]
    assert said[0] == "arming, try 1; next try in 3 s"
    refused = "the last one was refused: arming: TEMPORARILY_REJECTED"
    assert said[1:] == [f"arming, try {n}; next try in 3 s; {refused}" for n in (2, 3)]
    assert not any("landing" in text for text in world.said)


def test_frames_that_stop_for_a_moment_while_it_arms_only_delay_it() -> None:
    vehicle = px4(healthy=False)
    world = reaching("arming", vehicle)
    world.port.says = lambda now: None
    world.pass_s(5)
    vehicle.healthy = True
    silent = world.clock.now()
    world.pass_s(4)
    assert [m for m in world.orders(silent) if m.command == dialect.MAV_CMD_COMPONENT_ARM_DISARM] == []
    world.port.says = world.frames
    world.reach("climbing")


def test_a_pose_that_is_missing_while_it_arms_only_delays_it() -> None:
    vehicle = px4(healthy=False)
    world = reaching("arming", vehicle)
    world.between = without(GLOBAL_POSITION)
    world.pass_s(5)
    vehicle.healthy = True
    blind = world.clock.now()
    world.pass_s(4)
    assert not world.armed
    assert world.orders(blind) == []
    world.between = bytes
    world.reach("climbing")


def test_a_heartbeat_that_is_missing_before_arming_is_reported() -> None:
    vehicle = px4(healthy=False)
    world = reaching("arming", vehicle)
    world.between = lambda data: b""
    world.pass_s(8)
    assert any("no heartbeat" in text for text in world.said)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            ardupilot,
            f"without set-points {GUIDED_ALONE}; without a radio: RTL (FS_THR_ENABLE 1); "
            "without a ground station: nothing (FS_GCS_ENABLE 0)",
        ),
        (
            px4,
            "without set-points it lands (COM_OBL_RC_ACT 4) after 1 s (COM_OF_LOSS_T); without a radio: "
            "Return (NAV_RCL_ACT 2); without a ground station: nothing (NAV_DLL_ACT 0); if a stick moves: PX4 follows "
            "it in its auto modes, not in OFFBOARD, where the search orders Hold (COM_RC_OVERRIDE 1)",
        ),
    ],
)
def test_what_it_does_when_it_is_left_alone_is_said_before_it_arms(make: Callable[[], Any], words: str) -> None:
    world = reaching("arming", make())
    assert words in world.said


@pytest.mark.parametrize(
    ("manual", "then"),
    [(None, ", and sinks there and lands where it is, because it has no remote control"), ((0, 0, 0, 0), "")],
)
def test_what_px4_does_without_set_points_depends_on_a_remote_control(manual: Any, then: str) -> None:
    """Said before it arms, and when it is left alone."""
    vehicle = px4()
    vehicle.manual = manual
    vehicle.parameters["COM_OBL_RC_ACT"] = 0
    world = hunting(vehicle)
    does = f"it goes to Position mode (COM_OBL_RC_ACT 0) after 1 s (COM_OF_LOSS_T){then}"
    assert any(text.startswith(f"without set-points {does};") for text in world.said)
    world.between = without(dialect.MAVLINK_MSG_ID_HEARTBEAT, MAVLINK_MSG_ID_CURRENT_MODE)
    assert world.fail(6.0).endswith(f"{LEFT}: {does}")


@every(
    "parameter, value, text",
    [
        ("COM_RC_OVERRIDE", 2, "COM_RC_OVERRIDE is 2: without bit 0 PX4 ignores the sticks in LAND and Hold"),
        ("COM_RC_OVERRIDE", None, "COM_RC_OVERRIDE was not reported: without bit 0 PX4 ignores the sticks"),
        ("COM_OF_LOSS_T", 0.2, "COM_OF_LOSS_T is 0.2: the vehicle may stop between two set-points"),
        ("COM_OF_LOSS_T", 60.0, "COM_OF_LOSS_T is 60: the vehicle flies on for as many seconds"),
    ],
)
def test_a_parameter_that_makes_a_promise_impossible_is_named_before_it_arms(
    parameter: str, value: float | None, text: str
) -> None:
    vehicle = px4()
    vehicle.parameters.pop(parameter)
    if value is not None:
        vehicle.parameters[parameter] = value
    world = reaching("arming", vehicle)
    assert any(said.startswith(text) for said in world.said)
    assert world.orders() == []


def test_so_is_a_timeout_of_ardupilot() -> None:
    world = World(ardupilot())
    lie = Encoder(1, 1).pack(dialect.MAVLink_param_value_message(b"GUID_TIMEOUT", 30.0, 9, 1, 0))
    pass_on = without(dialect.MAVLINK_MSG_ID_PARAM_VALUE)
    world.between = lambda data: pass_on(data) + (lie if data else b"")
    world.reach("arming")
    assert any(said.startswith("GUID_TIMEOUT is 30: the vehicle flies on") for said in world.said)


def test_a_vehicle_that_does_not_tell_its_parameters_is_unknown_and_armed_all_the_same() -> None:
    world = World(ardupilot())
    world.between = without(dialect.MAVLINK_MSG_ID_PARAM_VALUE)
    world.reach("arming")
    (text,) = [text for text in world.said if text.startswith("without set-points")]
    assert "after an unknown time (GUID_TIMEOUT)" in text
    assert "without a radio: unknown (FS_THR_ENABLE)" in text


def test_the_last_seconds_on_the_ground_are_counted_down_and_begin_again_when_something_is_lacking() -> None:
    world = World(ardupilot(), {"countdown_s": 3.0})
    world.until(lambda: "arming in 3 s" in world.said)
    world.port.says = lambda now: None
    assert world.after(6).orders() == []
    world.port.says = world.frames
    back = world.clock.now()
    world.reach("arming")
    assert world.clock.now() - back > 2.9
    said = [text for text in world.said if text.startswith("arming in")]
    assert said[-3:] == [f"arming in {n} s" for n in (3, 2, 1)]


def test_who_arms_and_disarms_it_in_the_last_seconds_gets_all_of_them_again() -> None:
    world = World(ardupilot(), {"countdown_s": 3.0})
    world.until(lambda: "arming in 2 s" in world.said)
    for armed in (1, 0):
        order = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, armed, *[0] * 6)
        world.others.write(Encoder(255, 190).pack(order))
        world.pass_s(1.2 * armed)
    disarmed = world.clock.now()
    world.reach("arming")
    assert world.clock.now() - disarmed > 2.9


# -- At each failsafe of the built-in vehicle the search obeys: it ends, and orders nothing any more ------


@pytest.mark.parametrize(("name", "phase"), list(zip(FAILSAFES, itertools.cycle(["climbing", "flying"]))))
def test_in_the_air_it_ends_at_once(name: str, phase: str) -> None:
    world, at = struck(name, phase)
    assert world.end(2.0) == ("failed", TAKEN.format(FAILSAFES[name].mode.name))
    assert world.after(3).orders(at + BOUND_MS / 1000 + 0.1) == []  # 0.1 s: its mode is said at 10 Hz


def struck(name: str, phase: str) -> tuple[World, float]:
    """A search whose vehicle has its failsafe in this phase, and when that was."""
    high_m = 3.0 if phase == "landing" else 6.0
    world = reaching(phase, ardupilot(), take_off=high_m, height=high_m)
    if phase == "flying":
        world.hunt()
    elif phase == "landing":
        world.until(lambda: world.client._commander.lands_by_itself)
    at = world.clock.now()
    world.vehicle.trigger(FAILSAFES[name], at)  # type: ignore[union-attr]
    return world, at


@pytest.mark.parametrize("name", ["battery", "ekf"])
def test_while_it_lands_the_failsafe_lands_it_on(name: str) -> None:
    """One that lands too is no other mode: the landing goes on, and the place stays found."""
    world, at = struck(name, "landing")
    kind, how = world.end(90.0)
    mode = FAILSAFES[name].mode.name
    assert (kind, how) == ("found", "found" if mode == "LAND" else TAKEN.format(mode))
    world.until(lambda: not world.armed)
    assert world.after(5).orders(at + BOUND_MS / 1000 + 0.1) == []


@pytest.mark.parametrize("name", FAILSAFES)
def test_on_the_ground_nothing_takes_off_after_it(name: str) -> None:
    """Before it is armed a failsafe only speaks; an empty battery is not armed."""
    world = World(ardupilot(), {"countdown_s": 3.0, "timeout_s": 10.0})
    world.until(lambda: world.said and "arming in 3 s" in world.said)
    world.vehicle.trigger(FAILSAFES[name], world.clock.now())  # type: ignore[union-attr]
    if not FAILSAFES[name].empty:
        world.reach("climbing")
        return
    kind, how = world.end(30.0)
    assert (kind, how) == (
        "failed",
        "the battery is not healthy, or not measured: nothing was flown",
    )
    assert world.orders() == []


# -- Packets of the vehicle's ids that are too short for their message ------------------------------------


def short(msgid: int) -> bytes:
    """A whole MAVLink 1 packet of system 1 with one byte of payload, and the right checksum."""
    covered = bytes([1, 0, 1, 1, msgid, 7])
    return b"\xfe" + covered + struct.pack("<H", crc16.mcrf4xx(covered + CRC_EXTRA[msgid]))


def test_they_end_no_search_before_it_arms() -> None:
    vehicle = px4(healthy=False)
    world = reaching("arming", vehicle)
    every = (
        dialect.MAVLINK_MSG_ID_PARAM_VALUE,
        dialect.MAVLINK_MSG_ID_HEARTBEAT,
        dialect.MAVLINK_MSG_ID_COMMAND_ACK,
        dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    )
    world.between = lambda data: data + b"".join(map(short, every))
    assert world.after(3).client.outcome is None
    world.between = bytes
    vehicle.healthy = True
    world.reach("climbing")


# A stick or a switch that moves ends the search on both autopilots, and nothing else looks like one


RC_CHANNELS, MANUAL_CONTROL = dialect.MAVLINK_MSG_ID_RC_CHANNELS, dialect.MAVLINK_MSG_ID_MANUAL_CONTROL
AT_REST = (1500, 1500, 1500, 1500, 1000, 1500)
WITHIN_S = 1.5  # promised in docs/explanation/safety.md: from the stick to the pilot's mode


class Radio:
    """Replaces the pulses that the vehicle reports. `pulses` may change; the channels behind them are absent."""

    def __init__(self, world: World, *pulses: int) -> None:
        self.pulses = pulses
        self._parser = Parser()
        world.between = self._replace

    def _replace(self, data: bytes) -> bytes:
        return b"".join(
            packet.raw if packet.msgid != RC_CHANNELS else self._report() for packet in self._parser.feed(data)
        )

    def _report(self) -> bytes:
        pulses = [*self.pulses, *[0xFFFF] * (18 - len(self.pulses))]
        return Encoder(1, 1).pack(dialect.MAVLink_rc_channels_message(0, len(self.pulses), *pulses, 255))


def modes_ordered(world: World, since: float) -> list[int]:
    orders = [m for m in world.orders(since) if m.get_type() == "COMMAND_LONG"]
    assert all(m.command == SET_MODE for m in orders)
    return [int(m.param2) << 16 | int(m.param3) << 24 if m.param3 or m.param2 == 6 else int(m.param2) for m in orders]


def is_given_to_the_pilot(world: World, why: str) -> None:
    """The vehicle stops, its mode is ordered once, and then there is silence."""
    moved = world.clock.now()
    world.until(lambda: world.client._commander.phase.name == "YIELDING", WITHIN_S)
    stops = world.clock.now()
    name, mode = ("hold", HOLD) if isinstance(world.vehicle, Px4) else ("LOITER", int(Mode.LOITER))
    assert world.fail(WITHIN_S) == f"the pilot has moved {why}; the pilot has it, in {name}"
    world.stay_silent(10, since=world.clock.now())
    assert world.mode == mode
    assert modes_ordered(world, moved) == [mode]
    assert {(m.vx, m.vy, m.vz) for at, m in set_points(world) if at > stops} == {(0, 0, 0)}


# -- what is a pilot ---------------------------------------------------------------------------------------


def sticks(world: World, *pulses: int) -> None:
    getattr(world.vehicle, "_vehicle", world.vehicle)._pilot.sticks = pulses


@pytest.mark.parametrize(("make", "phase", "channel"), [(ardupilot, "climbing", 1), (px4, "flying", 3)])
def test_a_radio_that_px4_does_not_use_is_a_pilots_too(make: Callable[[], Any], phase: str, channel: int) -> None:
    world = reaching(phase, make(), take_off=5.0, height=5.0)
    world.pass_s(2)
    sticks(world, *(1500 + 300 * (n == channel) for n in range(1, 5)))
    is_given_to_the_pilot(world, f"a stick (channel {channel}, by 300 µs)")


def test_a_gap_of_the_link_is_no_lost_radio_while_the_throttle_is_awaited() -> None:
    world = hunting(ardupilot())
    sticks(world, 1500, 1500, 1200, 1500)
    world.until(lambda: world.client._commander.phase.name == "YIELDING", 1.0)
    world.pass_s(1)
    world.between = lambda data: b""
    world.pass_s(2.2)
    world.between = lambda data: data
    sticks(world, *(1500,) * 4)
    assert "; the pilot has it, in LOITER" in world.fail(WITHIN_S)


@pytest.mark.parametrize(
    ("before", "axes", "what"),
    [
        (None, (700, 0, 500, 0), "pitch"),
        ((0, 0, 500, 0), (0, 0, 500, 700), "yaw"),
    ],
)
def test_a_joystick_of_px4_is_a_pilots(before: Any, axes: tuple[int, ...], what: str) -> None:
    """It may appear in flight, already moved."""
    vehicle = px4()
    vehicle.manual = before
    world = hunting(vehicle)
    vehicle.manual = axes
    is_given_to_the_pilot(world, f"a stick ({what}, by 70 %)")


def test_a_radio_that_falls_silent_before_it_has_the_vehicle_does_not_get_it() -> None:
    """ArduPilot's mode waits for a throttle in the middle."""
    world = World(ardupilot())
    radio = Radio(world, *AT_REST)
    world.hunt()
    moved = world.clock.now()
    radio.pulses = (1800, 1500, 1900, 1500, *AT_REST[4:])
    world.until(lambda: world.client._commander.phase.name == "YIELDING", 1.0)
    radio.pulses = ()
    how = world.fail(3.0)
    assert "; the autopilot receives no radio, so the pilot cannot have it; " + LEFT in how
    assert modes_ordered(world, moved) == []
    world.stay_silent(10, since=world.clock.now())


def test_a_hold_that_px4_was_not_asked_for_and_never_reported_is_the_pilots_by_the_switch() -> None:
    """The switch is moved 8 ms before OFFBOARD is ordered, which flies over it."""
    world = World(px4())
    radio = Radio(world, *AT_REST)
    world.until(lambda: any(order == OFFBOARD for order in modes_ordered_so_far(world)))
    radio.pulses = (*AT_REST[:4], 1500, AT_REST[5])
    is_given_to_the_pilot(world, "a switch (channel 5, by 500 µs)")


def modes_ordered_so_far(world: World) -> list[int]:
    return [int(m.param2) << 16 for _, m in world.told if getattr(m, "command", 0) == SET_MODE]


def test_the_throttle_of_a_lost_radio_is_that_of_the_vehicles_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(arducopter._VALUES, "FS_THR_VALUE", 910)
    for enabled, us in ((1, 910), (0, 0)):
        monkeypatch.setitem(arducopter._VALUES, "FS_THR_ENABLE", enabled)
        assert reaching("arming", ardupilot()).client._commander.sticks.lost_us == us


def test_px4_may_give_the_vehicle_to_the_sticks_itself() -> None:
    """With COM_RC_OVERRIDE 3: then Hold would take it from them."""
    vehicle = px4()
    vehicle.manual = (0, 0, 500, 0)
    world = hunting(vehicle)
    moved = world.clock.now()
    vehicle.manual = (400, 0, 500, 0)
    world.until(lambda: world.client._commander.phase.name == "YIELDING", 1.0)
    world.pilot(POSITION)
    taken = "the mode is position: the pilot or a failsafe has taken over"
    assert world.fail(1.0) == f"the pilot has moved a stick (pitch, by 40 %); {taken}"
    world.pass_s(5)
    assert modes_ordered(world, moved) == []
    assert world.mode == POSITION


def test_a_stick_that_moves_while_it_lands_ends_nothing() -> None:
    """PX4 reports another mode when it has landed, before the heartbeat reports that it is disarmed."""
    world = reaching("landing", px4())
    world.pass_s(1)
    sticks(world, 1800, 1500, 1500, 1500)
    assert world.end() == ("found", "found")


def test_a_stick_that_moves_while_px4_still_stands_keeps_it_on_the_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(simulated_px4._COMMANDS, dialect.MAV_CMD_NAV_TAKEOFF, lambda *_: (0,))  # it is late
    vehicle = px4()
    world = reaching("climbing", vehicle)
    vehicle.manual = (700, 0, 500, 0)
    assert world.fail(WITHIN_S) == "the pilot has moved a stick (pitch, by 70 %)"
    assert world.after(5).ned[2] == pytest.approx(0.0, abs=0.01)


# -- what is none ------------------------------------------------------------------------------------------


def flies_on(world: World) -> None:
    """For as long as a pilot would wait for the vehicle at most."""
    world.pass_s(WITHIN_S)
    assert (world.client._commander.phase.name, world.client.outcome) == ("FLYING", None)


def test_a_switch_on_the_ground_is_no_reason_to_stay_there() -> None:
    """It may be what lets the vehicle arm."""
    world = World(ardupilot())
    radio = Radio(world, *AT_REST)
    world.reach("arming")
    radio.pulses = (*AT_REST[:4], 2000, AT_REST[5])
    world.reach("flying")


def test_only_the_autopilots_own_messages_count() -> None:
    """A ground station's MANUAL_CONTROL on the link is a request that the autopilot may ignore."""
    world = hunting(ardupilot())
    sources = [Encoder(255, 190), Encoder(2, 1), Encoder(1, 190), Encoder(1, 193)]
    sticks = dialect.MAVLink_manual_control_message(1, 1000, 1000, 1000, 1000, 0)
    radio = dialect.MAVLink_rc_channels_message(0, 4, *[2000] * 4, *[0xFFFF] * 14, 255)
    world.between = lambda data: b"".join(
        [data, *(source.pack(message) for source in sources for message in (sticks, radio) if data)]
    )
    flies_on(world)


# A vehicle that does not follow its set-points is noticed within seconds; one that is slow or blown about is not


SET_POINT = dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
NOT_FOLLOWED = "the vehicle does not follow its set-points"

Change = Callable[[World, Any], bool]  # of a set-point on its way up; returns whether it arrives


def uplink(world: World, change: Change) -> None:
    """Let `change` have each set-point before the vehicle gets it."""
    feed, parser, encoder = world.vehicle.feed, Parser(), Encoder(1, 193)

    def fed(chunk: bytes, now: float, link: int = 0) -> None:
        for packet in parser.feed(chunk):
            if packet.msgid != SET_POINT:
                feed(packet.raw, now, link)
                continue
            message: Any = decode(packet)
            if change(world, message):
                feed(encoder.pack(message), now, link)

    world.vehicle.feed = fed  # type: ignore[method-assign]


def nothing_heard(now: float) -> bytes:
    return encode(Frame(round(now * 5) % 256, 1, (Channel(),)))


def lost(world: World, message: Any) -> bool:
    return world.client._commander.phase.name != "FLYING"


def fence_ahead(world: World, message: Any) -> bool:
    """As AVOID_ENABLE stops it: 4 m north of the take-off point."""
    if world.ned[0] > 4.0:
        message.vx = min(message.vx, 0.0)
    return True


def turned(degrees: float, share: float = 1.0) -> Change:
    def turn(_: World, message: Any) -> bool:
        v = cmath.rect(share, math.radians(degrees)) * complex(message.vx, message.vy)
        message.vx, message.vy = v.real, v.imag
        return True

    return turn


def slower(share: float) -> Change:
    return turned(0.0, share)


@pytest.mark.parametrize(("make", "change"), [(ardupilot, lost), (ardupilot, fence_ahead), (px4, fence_ahead)])
def test_one_that_does_not_move_is_said_flown_another_way_once_and_landed(
    make: Callable[[], Any], change: Change
) -> None:
    world = reaching("flying", make())
    begun = world.clock.now()
    uplink(world, change)
    kind, how = world.end(60.0)
    assert kind == "failed"
    assert not world.armed
    if change is lost:  # the first order that is not followed may be one to sink
        assert how.startswith((NOT_FOLLOWED, "it is on the ground, or"))
        return
    assert how.startswith(NOT_FOLLOWED)
    (said,) = [text for text in world.said if text.startswith(NOT_FOLLOWED)]
    assert "a fence or an obstacle ahead" in said
    landing = min(row.time_s for row in world.rows if row.phase == "landing")
    assert landing - begun < 33.0  # it sinks first
    assert math.hypot(*world.ned[:2]) < 12.0


@pytest.mark.parametrize(("make", "degrees"), [(ardupilot, 90.0), (px4, -90.0), (ardupilot, 180.0)])
def test_one_that_flies_another_way_than_ordered_is_landed_at_once(make: Callable[[], Any], degrees: float) -> None:
    world = World(make())
    uplink(world, turned(degrees))
    how = world.fail(60.0)
    off = re.match(rf"{NOT_FOLLOWED}: it flies (\d+)° off \(", how)
    assert off, how
    assert float(off[1]) == pytest.approx(abs(degrees), abs=10.0)
    flown = [row for row in world.rows if row.phase == "flying"]
    assert flown[-1].time_s - flown[0].time_s < 10.0
    assert math.hypot(*world.ned[:2]) < 10.0
    assert not world.armed


FAR = {"area": (-30.0, -10.0, 30.0, 10.0), "limit_s": 25.0}


@pytest.mark.parametrize(
    ("make", "options", "change", "plan"),
    [
        pytest.param(ardupilot, {"wind": (-9.0, 6.0, 0.0)}, slower(0.5), {}, id="wind"),
        pytest.param(px4, {"gps_noise_m": 3.0, "seed": 3}, slower(0.6), {}, id="walk"),
        pytest.param(px4, {}, None, {"take_off": 2.0, "height": 12.0}, id="climb"),
    ],
)
def test_one_that_is_slow_blown_about_or_climbs_is_let_fly(
    make: Callable[..., Any], options: dict[str, Any], change: Change | None, plan: dict[str, Any]
) -> None:
    world = World(make(**options), **FAR | plan)
    world.port.says = nothing_heard
    if change:
        uplink(world, change)
    kind, how = world.end(300.0)
    assert kind == "not found", how
    assert NOT_FOLLOWED not in " ".join(world.said)


# -- The check of set-points against the motion reported, on motions made up ------------------------------


STEP_S = 0.2


def first(
    flown: Callable[[float, complex], complex],
    *,
    order: Callable[[float], complex] = lambda t: 1 + 0j,
    jump_m: float = 0.0,
    reported: float = 1.0,
    until_s: float = 60.0,
) -> tuple[float, Deviation] | None:
    """The first deviation of a vehicle that flies `flown(t, order)`, and when.

    `jump_m`: of its position, each 10 s. `reported`: the share of its velocity that it reports.
    """
    check, place = SetPointCheck(), 0j
    for step in range(round(until_s / STEP_S)):
        t = step * STEP_S
        ordered = order(t)
        moving = flown(t, ordered) if step else 0j
        place += moving * STEP_S + (jump_m if step % 50 == 49 else 0.0)
        velocity = reported * moving
        vectors = ((v.real, v.imag, 0.0) for v in (ordered, place, velocity))
        if deviation := check.observe(t, *vectors):
            return t, deviation
    return None


def aside(degrees: float, share: float = 1.0) -> Callable[[float, complex], complex]:
    return lambda t, order: order * cmath.rect(share, math.radians(degrees))


@every("degrees", [90.0, -90.0, 120.0, 180.0])
def test_a_vehicle_that_flies_elsewhere_is_known_after_its_window_with_its_direction(degrees: float) -> None:
    found = first(aside(degrees))
    after_s, deviation = found
    assert 5.0 <= after_s < 7.0
    assert deviation.off_deg == pytest.approx(degrees, abs=1.0)
    assert deviation.seconds == pytest.approx(5.0, abs=0.3)
    assert deviation.ordered_m == pytest.approx(5.0, abs=0.3)
    assert deviation.flown_m == pytest.approx(5.0, abs=0.3)


@every("speed, at_most_s", [(1.0, 7.0), (0.5, 12.0), (4.0, 10.0)])
def test_a_vehicle_that_stands_hardly_moves(speed: float, at_most_s: float) -> None:
    found = first(lambda t, order: 0j, order=lambda t: complex(0.0, speed))
    assert found[0] < at_most_s
    assert found[1].off_deg is None
    assert found[1].flown_m == pytest.approx(0.0)


def test_one_that_stops_later_is_known_too() -> None:
    found = first(lambda t, order: order if t < 30.0 else 0j)
    assert 33.5 < found[0] < 36.0


def ramp(acceleration: float) -> Callable[[float, complex], complex]:
    """The velocity of a vehicle whose acceleration is limited."""
    velocity = 0j

    def flown(t: float, order: complex) -> complex:
        nonlocal velocity
        lag = order - velocity
        velocity += lag * min(1.0, acceleration * STEP_S / max(abs(lag), 1e-9))
        return velocity

    return flown


@every(
    "flown, order",
    [
        pytest.param(aside(0.0), lambda t: 1 + 0j, id="follows"),
        pytest.param(aside(0.0, 0.3), lambda t: 1 + 0j, id="slow"),
        pytest.param(aside(0.0, 0.06), lambda t: 5 + 0j, id="limited to 0.3 m/s"),
        pytest.param(aside(45.0), lambda t: 1 + 0j, id="blown aside"),
        pytest.param(ramp(0.5), lambda t: complex(1.0 if t % 12 < 6 else -1.0), id="back and forth"),
        pytest.param(ramp(1.0), lambda t: complex(5.0 if t % 60 < 30 else -5.0), id="fast, back and forth"),
        pytest.param(ramp(0.5), lambda t: cmath.rect(1.0, t / 2), id="circle"),
        pytest.param(aside(0.0, 0.0), lambda t: 0j, id="hover"),
        pytest.param(lambda t, order: order + cmath.rect(0.4, t), lambda t: 0.4 + 0j, id="gusts"),
    ],
)
def test_no_vehicle_that_does_what_it_can_deviates(
    flown: Callable[[float, complex], complex], order: Callable[[float], complex]
) -> None:
    assert first(flown, order=order, until_s=120.0) is None


def test_a_position_that_jumps_and_a_velocity_that_is_not_reported_are_no_deviation() -> None:
    assert first(aside(0.0), jump_m=-9.0) is None
    assert first(aside(0.0), reported=0.0) is None


def test_after_a_gap_or_a_restart_it_begins_again() -> None:
    check = SetPointCheck()
    for gap, restarted in ((1.2, False), (STEP_S, True)):
        for begin in (0.0, 4.6 + gap):
            for step in range(24):
                assert check.observe(begin + step * STEP_S, (1.0, 0.0, 0.0), (0.0,) * 3, (0.0,) * 3) is None
            if restarted:
                check.restart()
        check.restart()
