"""The pilot's sticks and switches: which messages of a radio or of a joystick say that a person has moved one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from arva_hil.autopilot.commanding.sticks import Sticks
from arva_hil.events.words.reasons import in_words
from arva_hil.mavlink.codec import dialect
from tests.every import every

AT_REST = (1500, 1500, 1500, 1500, 1000, 1500)
RC = dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER


def radio(*pulses: int) -> Any:
    return dialect.MAVLink_rc_channels_message(0, len(pulses), *pulses, *[0xFFFF] * (18 - len(pulses)), 255)


def joystick(*axes: int) -> Any:
    return dialect.MAVLink_manual_control_message(1, *axes, 0)


def moved(sticks: Sticks, *messages: Any, flown: bool = True) -> str:
    """What has moved after these messages, each of them received twice."""
    for message in messages:
        for _ in range(2):
            sticks.on_message(message, 0.0, flown=flown)
    return in_words((sticks.moved,)) if sticks.moved else ""


def resting(*messages: Any) -> Sticks:
    """Sticks that have got these messages before the launch."""
    sticks = Sticks()
    assert moved(sticks, *messages, flown=False) == ""
    sticks.mark()
    return sticks


def changed(channel: int, us: int) -> Any:
    return radio(*(us if n == channel else rest for n, rest in enumerate(AT_REST, 1)))


def test_sticks_are_known_of_a_radio_that_is_there() -> None:
    sticks = Sticks()
    assert not sticks.known(0.0)
    sticks.remote = True
    assert not sticks.known(0.0)
    for now in (0.0, 0.2):
        sticks.on_message(radio(*AT_REST), now)
    assert sticks.throttle_in_middle(2.1)
    assert not sticks.throttle_in_middle(2.3)
    assert sticks.known(4.1)
    assert not sticks.known(4.3)
    sticks.mark()
    sticks.remote = False
    assert not sticks.known(2.0)


@every("channel", range(1, 5))
def test_each_stick_counts_and_trembling_does_not(channel: int) -> None:
    sticks = resting(radio(*AT_REST))
    assert moved(sticks, changed(channel, 1570), changed(channel, 1430)) == ""
    sticks.on_message(changed(channel, 1590), 0.0)  # a glitch
    assert moved(sticks, radio(*AT_REST)) == ""
    assert moved(sticks, changed(channel, 1590)).endswith(f"a stick (channel {channel}, by 90 µs)")


def test_a_stick_with_a_long_travel_counts_at_its_end() -> None:
    """With 150 % of travel a stick has 900 to 2100 µs."""
    for us in (900, 2100):
        assert moved(resting(radio(*AT_REST)), changed(1, us)).endswith("a stick (channel 1, by 600 µs)")


def test_a_switch_counts_once_it_flies() -> None:
    sticks = resting(radio(*AT_REST))
    assert moved(sticks, changed(5, 1500), flown=False) == ""
    assert moved(sticks, changed(5, 1700)) == ""
    assert moved(sticks, changed(5, 2000)).endswith("a switch (channel 5, by 300 µs)")


@every(
    "rest, axes, axis",
    [
        ((0, 0, 500, 0), (700, 0, 500, 0), "pitch"),
        ((0, -300, 500, 0), (0, 400, 500, 0), "roll"),
        ((0, 0, 500, 0), (0, 0, 850, 0), "throttle"),
        ((0, 0, 500, 0), (0, 0, 500, -700), "yaw"),
        ((0, 0, 500, 32767), (700, 0, 500, 32767), "pitch"),  # without a yaw
    ],
)
def test_each_axis_of_a_joystick_counts(rest: tuple[int, ...], axes: tuple[int, ...], axis: str) -> None:
    assert moved(resting(joystick(*rest)), joystick(*axes)).endswith(f"a stick ({axis}, by 70 %)")


@every(
    "rest, axes",
    [
        # jitter, and an axis that is not used any more
        ((0, 0, 500, 0), [(70, -100, 560, 140), (-140, 100, 440, -140), (0, 0, 32767, 0)]),
        ((-400, 300, 0, 200), [(-400, 300, 0, 200)]),  # not in the middle from the start, the throttle at its lowest
        (None, [(0, 0, 0, 0), (20, 20, 0, 20)]),  # switched on in flight, with the throttle at its lowest
    ],
)
def test_these_axes_are_no_pilot(rest: tuple[int, ...] | None, axes: Iterable[tuple[int, ...]]) -> None:
    sticks = resting(joystick(*rest)) if rest else Sticks()
    if not rest:
        sticks.on_message(joystick(0, 0, 500, 0), 0.0)  # PX4's answer when it is asked for sticks that it has not
        sticks.mark()
    assert moved(sticks, *(joystick(*there) for there in axes)) == ""


@every(
    "pulses",
    [
        [AT_REST, (1560, 1440, 1560, 1440, 1010, 1490)],  # jitter
        [AT_REST, AT_REST[:4], AT_REST],  # channels that go and come
        [AT_REST, (1500, 1500, 900, 1500, 2000, 2000), AT_REST],  # one that is lost: by FS_THR_VALUE
        [AT_REST, *((*AT_REST[:5], 1500 + 40 * n) for n in range(1, 10))],  # a knob
        [(1300, 1700, 1000, 1500, 2000, 1000)] * 2,  # not in the middle from the start
        [(0,) * 6, (0,) * 6, (1510, 1490, 1000, 1500, 2000, 1000)],  # a radio that is switched on in flight
        [AT_REST, (0, 0, 0, 0), (0xFFFF,) * 4, AT_REST],  # no pulses
    ],
)
def test_these_pulses_are_no_pilot(pulses: list[tuple[int, ...]]) -> None:
    sticks = resting(radio(*pulses[0]))
    assert moved(sticks, *(radio(*there) for there in pulses[1:])) == ""


def test_a_low_throttle_hides_no_stick_unless_the_radio_is_lost() -> None:
    sticks = resting(radio(1500, 1500, 990))
    sticks.lost_us = 910
    assert moved(sticks, radio(1900, 1500, 905)) == ""
    assert moved(sticks, radio(1900, 1500, 930)).endswith("a stick (channel 1, by 400 µs)")


def test_a_dip_of_the_radios_quality_is_no_switch() -> None:
    sticks = resting(radio(*AT_REST[:5], 1900))
    sticks.quality = 6
    assert moved(sticks, changed(6, 1600)) == ""
    assert moved(sticks, changed(5, 1300)).endswith("a switch (channel 5, by 300 µs)")
    sticks = resting(radio(*AT_REST))
    sticks.quality = 1  # a wrong parameter: it hides no stick
    assert moved(sticks, changed(1, 1900)).endswith("a stick (channel 1, by 400 µs)")


def test_a_radio_that_px4_has_lost_moves_no_stick() -> None:
    """Its receiver may put the sticks anywhere; PX4's own failsafe acts."""
    there, gone = (dialect.MAVLink_sys_status_message(RC, RC, health, *[0] * 10) for health in (RC, 0))
    sticks = resting(there, radio(*AT_REST))
    assert moved(sticks, gone, radio(1200, 1200, 1000, 1200, 1000, 1500)) == ""
    assert moved(sticks, there, radio(1200, 1500, 1500, 1500)).endswith("(channel 1, by 300 µs)")
