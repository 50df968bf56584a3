"""A busy stream is watched for a part of the time only. Frames stay the same, and so do poses."""

from __future__ import annotations

from itertools import pairwise

import pytest
from one_receiver import Diary
from test_busy_streams import SCENARIO, SECONDS, Autopilot, poses

from arva_hil.config import parse
from arva_hil.emulator.emulated_vehicle import one_vehicle
from arva_hil.emulator.engine import Emulator
from arva_hil.links.memory import pair
from arva_hil.observers.audience import Audience
from arva_hil.runtime.clock import Clock, StepClock
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.loop import run
from arva_hil.runtime.rests import Rests
from arva_hil.vehicle.session import Session

TEN_HZ = SCENARIO % 10


class Counted(Live):
    """Notes when it is called."""

    def service(self, clock: Clock) -> float:
        self.calls = [*getattr(self, "calls", []), clock.now()]
        return super().service(clock)


def flown(times: list[float], *, scenario: str = TEN_HZ, tell_packets: bool = False) -> tuple[Diary, list[float]]:
    """10 frames a second, packets at these times. Returns the events, and when the program woke up."""
    diary, (near, far), (port, _) = Diary(), pair(), pair()
    vehicle = one_vehicle(parse(scenario, "test"), Session(passive=True))
    emulator = Emulator([vehicle], start=0.0, tell_packets=tell_packets)
    live = Counted(emulator, {"autopilot": near}, {"port": port}, Audience([diary]))
    clock = StepClock()
    run([Autopilot(far, times), live], clock, until=SECONDS)
    live.finish(clock)
    return diary, live.calls


@pytest.mark.parametrize("phase_s", [0.001, 0.01, 0.017])
def test_a_program_that_rests_wakes_up_half_as_often_and_makes_the_same_frames(phase_s: float) -> None:
    times = [round(n / 50 + phase_s, 6) for n in range(150)]
    rested, seldom = flown(times)
    watched, often = flown(times, tell_packets=True)
    assert len(seldom) < 0.6 * len(often)
    assert rested.bytes == watched.bytes
    assert poses(rested) == poses(watched)
    assert None not in poses(rested)[1:]


@pytest.mark.parametrize("phase_s", [0.001, 0.012])
def test_a_truth_without_a_time_stamp_is_stamped_when_it_comes(phase_s: float) -> None:
    times = [round(n / 50 + phase_s, 6) for n in range(150)]
    _, calls = flown(times, scenario="spec: 2\npose: truth\n" + TEN_HZ)
    assert set(times) <= {round(at, 6) for at in calls}


def test_a_slow_stream_is_always_watched() -> None:
    times = [round(n / 10 + 0.033, 6) for n in range(30)]
    _, calls = flown(times)
    assert set(times) <= {round(at, 6) for at in calls}


def test_a_frame_is_late_by_nothing_and_has_the_pose_that_came_last_before_it() -> None:
    """One that comes 1 ms before the frame is in it, also in a rest."""
    diary, _ = flown([round(n / 50 - 0.001, 6) for n in range(1, 151)])
    assert all(frame.late_s == 0 for frame in diary.frames)
    ages = [frame.age_s for frame in diary.frames if frame.age_s is not None]
    assert len(ages) > 25
    assert max(ages[5:]) < 0.0011


def test_in_every_second_some_packets_are_read_when_they_come() -> None:
    rests, now = Rests(), 0.0
    watched = []
    for n in range(500):
        now = n / 50
        if not rests.rest(now):
            watched.append(now)
        rests.read(80, now)
    longest = max(b - a for a, b in pairwise(watched))
    assert longest < 0.65  # the clock map remembers 1 s
    assert len(watched) < 0.4 * 500


def test_much_at_once_ends_the_rest() -> None:
    rests = Rests()
    for n in range(12):
        rests.read(80, n / 50)
    assert rests.rest(0.25)
    rests.read(3000, 0.3)
    assert not rests.rest(0.3)
