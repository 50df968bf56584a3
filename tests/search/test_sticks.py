"""A stick or a switch that moves ends the search on both autopilots, and nothing else looks like one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from arva_hil.mavlink.codec import Encoder, Parser, dialect
from arva_hil.simulated.autopilot import Mode
from tests import simulated_px4
from tests.search.test_client import BOTH, World, px4
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


def joystick(world: World, *axes: int) -> None:
    """x, y, z and r of the sticks that PX4 uses."""
    assert isinstance(world.vehicle, Px4)
    world.vehicle.manual = axes  # type: ignore[assignment]


def modes_ordered(world: World, since: float) -> list[int]:
    orders = [m for m in world.orders(since) if m.get_type() == "COMMAND_LONG"]
    assert all(m.command == SET_MODE for m in orders)
    return [int(m.param2) << 16 | int(m.param3) << 24 if m.param3 or m.param2 == 6 else int(m.param2) for m in orders]


def is_given_to_the_pilot(world: World, why: str) -> None:
    """The vehicle stops, its mode is ordered once, and then there is silence."""
    moved, ours = world.clock.now(), isinstance(world.vehicle, Px4)
    name, mode = ("hold", HOLD) if ours else ("LOITER", int(Mode.LOITER))
    assert world.end(WITHIN_S) == ("failed", f"the pilot has moved {why}; the pilot has it, in {name}")
    ended = world.clock.now()
    world.pass_s(10)
    assert (world.vehicle.mode if ours else world.vehicle._pilot.mode) == mode  # type: ignore[union-attr]
    assert modes_ordered(world, moved) == [mode]
    assert world.orders(ended) == []


# -- what is a pilot ---------------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize(("phase", "channel"), [("climbing", 3), ("flying", 1), ("flying", 3)])
def test_a_radio_that_px4_does_not_use_is_a_pilots_too(make: Callable[[], Any], phase: str, channel: int) -> None:
    world = World(make(), take_off=5.0, height=5.0)
    world.reach(phase)
    world.pass_s(2)
    pilot = getattr(world.vehicle, "_vehicle", world.vehicle)._pilot
    pilot.sticks = tuple(1500 + 300 * (n == channel) for n in range(1, 5))
    if not isinstance(world.vehicle, Px4) and channel == 3:
        world.pass_s(2)  # it hovers until the throttle is in the middle
        pilot.sticks = (1500, 1800, 1500, 1500)
        world.end(WITHIN_S)
        return
    is_given_to_the_pilot(world, f"a stick (channel {channel}, by 300 µs)")


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
    world = World(vehicle)
    world.hunt()
    joystick(world, *axes)
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
    world = World(px4())
    joystick(world, 0, 0, 500, 0)
    world.hunt()
    moved = world.clock.now()
    joystick(world, 400, 0, 500, 0)
    world.until(lambda: world.client._commander.phase.name == "YIELDING", 1.0)
    world.pilot(POSITION)
    taken = "the mode is position: the pilot or a failsafe has taken over"
    assert world.end(1.0) == ("failed", f"the pilot has moved a stick (pitch, by 40 %); {taken}")
    world.pass_s(5)
    assert modes_ordered(world, moved) == []
    assert world.vehicle.mode == POSITION  # type: ignore[union-attr]


@BOTH
def test_a_stick_stops_the_vehicle_before_its_mode_changes(make: Callable[[], Any]) -> None:
    world = World(make())
    world.hunt()
    getattr(world.vehicle, "_vehicle", world.vehicle)._pilot.sticks = (1800, 1500, 1500, 1500)
    world.until(lambda: world.client._commander.phase.name == "YIELDING", 0.5)
    stopped = world.clock.now()
    world.end(1.0)
    assert {(m.vx, m.vy, m.vz) for at, m in world.told if at > stopped and m.get_type().startswith("SET_POS")} == {
        (0, 0, 0)
    }


def test_a_stick_that_moves_while_px4_still_stands_keeps_it_on_the_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(simulated_px4._COMMANDS, dialect.MAV_CMD_NAV_TAKEOFF, lambda *_: (0,))  # it is late
    world = World(px4())
    world.reach("climbing")
    joystick(world, 700, 0, 500, 0)
    assert world.end(WITHIN_S) == ("failed", "the pilot has moved a stick (pitch, by 70 %)")
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
    world = World(vehicle)
    world.hunt()
    for there in axes[1:]:
        vehicle.manual = there
        world.pass_s(1.5)
    assert world.end() == ("found", "found")


@BOTH
@pytest.mark.parametrize(
    "pulses",
    [
        [
            *(AT_REST, (1560, 1440, 1560, 1440, 1010, 1490)),  # jitter
            *((*AT_REST[:5], 1500 + 40 * n) for n in range(1, 10)),  # a knob, or the quality of the link
        ],
        [(1300, 1700, 1000, 1500, 2000, 1000)] * 2,  # not in the middle from the start
        [AT_REST, AT_REST[:4], AT_REST],  # channels that go and come
        [(0,) * 6, (0,) * 6, (1510, 1490, 1000, 1500, 2000, 1000)],  # a radio that is switched on in flight
        [AT_REST, (1500, 1500, 900, 1500, 2000, 2000), AT_REST],  # one that is lost: by ArduPilot's FS_THR_VALUE
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


@BOTH
def test_a_switch_on_the_ground_is_no_reason_to_stay_there(make: Callable[[], Any]) -> None:
    """It may be what lets the vehicle arm."""
    vehicle = make()
    world = World(vehicle)
    radio = Radio(world, *AT_REST)
    world.reach("arming")
    radio.pulses = (*AT_REST[:4], 2000, AT_REST[5])
    assert world.end() == ("found", "found")


@BOTH
def test_only_the_autopilots_own_messages_count(make: Callable[[], Any]) -> None:
    """A ground station's MANUAL_CONTROL on the link is a request that the autopilot may ignore."""
    world = World(make())
    world.hunt()
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
