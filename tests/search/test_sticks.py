"""A stick or a switch that moves ends the search on both autopilots, and nothing else looks like one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from arva_hil.mavlink.codec import Encoder, Parser, dialect
from arva_hil.simulated.autopilot import Mode
from tests import simulated_px4
from tests.search.test_client import BOTH, World, ardupilot, hunting, px4, set_points
from tests.simulated_px4 import HOLD, OFFBOARD, POSITION, Px4

SET_MODE = dialect.MAV_CMD_DO_SET_MODE
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
    name, mode = ("hold", HOLD) if isinstance(world.vehicle, Px4) else ("LOITER", int(Mode.LOITER))
    assert world.fail(WITHIN_S) == f"the pilot has moved {why}; the pilot has it, in {name}"
    world.stay_silent(10, since=world.clock.now())
    assert world.mode == mode
    assert modes_ordered(world, moved) == [mode]


# -- what is a pilot ---------------------------------------------------------------------------------------


def sticks(world: World, *pulses: int) -> None:
    getattr(world.vehicle, "_vehicle", world.vehicle)._pilot.sticks = pulses


@pytest.mark.parametrize(
    ("make", "phase", "channel"), [(ardupilot, "climbing", 1), (px4, "climbing", 3), (px4, "flying", 1)]
)
def test_a_radio_that_px4_does_not_use_is_a_pilots_too(make: Callable[[], Any], phase: str, channel: int) -> None:
    world = World(make(), take_off=5.0, height=5.0)
    world.reach(phase)
    world.pass_s(2)
    sticks(world, *(1500 + 300 * (n == channel) for n in range(1, 5)))
    is_given_to_the_pilot(world, f"a stick (channel {channel}, by 300 µs)")


def test_ardupilot_gets_its_throttle_into_the_middle_first() -> None:
    world = World(ardupilot(), take_off=5.0, height=5.0)
    world.reach("climbing")
    world.pass_s(2)
    sticks(world, 1500, 1500, 1800, 1500)
    world.pass_s(2)
    sticks(world, 1500, 1800, 1500, 1500)
    world.end(WITHIN_S)


@pytest.mark.parametrize(
    ("before", "axes", "what"),
    [
        (None, (700, 0, 500, 0), "pitch"),
        ((0, 0, 500, 0), (0, -700, 500, 0), "roll"),
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


@BOTH
def test_a_switch_of_the_radio_is_a_pilots(make: Callable[[], Any]) -> None:
    """PX4 may report a mode of 12 ms, set between two reports and flown over, by nothing else."""
    world = World(make())
    radio = Radio(world, *AT_REST)
    world.hunt()
    radio.pulses = (*AT_REST[:4], 1500, AT_REST[5])
    is_given_to_the_pilot(world, "a switch (channel 5, by 500 µs)")


def test_a_hold_that_px4_was_not_asked_for_and_never_reported_is_the_pilots_by_the_switch() -> None:
    """The switch is moved 8 ms before OFFBOARD is ordered, which flies over it."""
    world = World(px4())
    radio = Radio(world, *AT_REST)
    world.until(lambda: any(order == OFFBOARD for order in modes_ordered_so_far(world)))
    radio.pulses = (*AT_REST[:4], 1500, AT_REST[5])
    is_given_to_the_pilot(world, "a switch (channel 5, by 500 µs)")


def modes_ordered_so_far(world: World) -> list[int]:
    return [int(m.param2) << 16 for _, m in world.told if getattr(m, "command", 0) == SET_MODE]


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


@BOTH
def test_a_stick_stops_the_vehicle_before_its_mode_changes(make: Callable[[], Any]) -> None:
    world = hunting(make())
    sticks(world, 1800, 1500, 1500, 1500)
    world.until(lambda: world.client._commander.phase.name == "YIELDING", 0.5)
    stopped = world.clock.now()
    world.end(1.0)
    assert {(m.vx, m.vy, m.vz) for at, m in set_points(world) if at > stopped} == {(0, 0, 0)}


def test_a_stick_that_moves_while_px4_still_stands_keeps_it_on_the_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(simulated_px4._COMMANDS, dialect.MAV_CMD_NAV_TAKEOFF, lambda *_: (0,))  # it is late
    vehicle = px4()
    world = World(vehicle)
    world.reach("climbing")
    vehicle.manual = (700, 0, 500, 0)
    assert world.fail(WITHIN_S) == "the pilot has moved a stick (pitch, by 70 %)"
    world.pass_s(5)
    assert world.ned[2] == pytest.approx(0.0, abs=0.01)


# -- what is none ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "axes",
    [
        [(0, 0, 500, 0), (70, -100, 560, 140), (-140, 100, 440, -140)],  # jitter
        [(-400, 300, 0, 200), (-400, 300, 0, 200)],  # not in the middle from the start, the throttle at its lowest
        [None, (0, 0, 0, 0)],  # a radio that is switched on in flight, with the throttle at its lowest
        [(0, 0, 0, 0), None, (20, 20, 0, 20)],  # and one that was lost meanwhile
        [(0, 0, 500, 0), (0, 0, 32767, 0)],  # an axis that is not used any more
    ],
)
def test_these_axes_are_no_pilot(axes: list[Any]) -> None:
    vehicle = px4()
    vehicle.manual = axes[0]
    world = hunting(vehicle)
    for there in axes[1:]:
        vehicle.manual = there
        world.pass_s(1.5)
    assert world.end() == ("found", "found")


@pytest.mark.parametrize(
    ("make", "pulses"),
    [
        (
            ardupilot,
            [
                *(AT_REST, (1560, 1440, 1560, 1440, 1010, 1490)),  # jitter
                *((*AT_REST[:5], 1500 + 40 * n) for n in range(1, 10)),  # a knob, or the quality of the link
            ],
        ),
        (ardupilot, [AT_REST, AT_REST[:4], AT_REST]),  # channels that go and come
        (ardupilot, [AT_REST, (1500, 1500, 900, 1500, 2000, 2000), AT_REST]),  # one that is lost: by FS_THR_VALUE
        (px4, [(1300, 1700, 1000, 1500, 2000, 1000)] * 2),  # not in the middle from the start
        (px4, [(0,) * 6, (0,) * 6, (1510, 1490, 1000, 1500, 2000, 1000)]),  # a radio that is switched on in flight
    ],
)
def test_these_pulses_are_no_pilot(make: Callable[[], Any], pulses: list[tuple[int, ...]]) -> None:
    world = World(make())
    radio = Radio(world, *pulses[0])
    world.hunt()
    for there in pulses[1:]:
        radio.pulses = there
        world.pass_s(0.3)
    assert world.end() == ("found", "found")


def test_a_switch_on_the_ground_is_no_reason_to_stay_there() -> None:
    """It may be what lets the vehicle arm."""
    world = World(ardupilot())
    radio = Radio(world, *AT_REST)
    world.reach("arming")
    radio.pulses = (*AT_REST[:4], 2000, AT_REST[5])
    assert world.end() == ("found", "found")


@BOTH
def test_only_the_autopilots_own_messages_count(make: Callable[[], Any]) -> None:
    """A ground station's MANUAL_CONTROL on the link is a request that the autopilot may ignore."""
    world = hunting(make())
    sources = [Encoder(255, 190), Encoder(2, 1), Encoder(1, 190), Encoder(1, 193)]
    sticks = dialect.MAVLink_manual_control_message(1, 1000, 1000, 1000, 1000, 0)
    radio = dialect.MAVLink_rc_channels_message(0, 4, *[2000] * 4, *[0xFFFF] * 14, 255)
    world.between = lambda data: b"".join(
        [data, *(source.pack(message) for source in sources for message in (sticks, radio) if data)]
    )
    assert world.end() == ("found", "found")


def test_a_radio_that_px4_has_lost_moves_no_stick() -> None:
    """Its receiver may put the sticks anywhere; PX4's own failsafe acts."""
    vehicle = px4()
    vehicle.manual = (0, 0, 500, 0)
    world = World(vehicle)
    radio = Radio(world, *AT_REST)
    world.hunt()
    vehicle.manual = None
    world.pass_s(1.5)
    radio.pulses = (1200, 1200, 1000, 1200, 1000, 1500)
    assert world.end() == ("found", "found")
