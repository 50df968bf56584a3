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


def test_a_slow_vehicle_beside_a_fast_one_keeps_both_watched() -> None:
    fast, slow = [round(n / 50 + 0.01, 6) for n in range(150)], [round(n / 4 + 0.003, 6) for n in range(12)]
    far_ends, links, vehicles = [], {}, []
    for name in ("fast", "slow"):
        links[name], far = pair()
        far_ends.append(far)
        vehicles.append(one_vehicle(parse(TEN_HZ, "test"), Session(passive=True), link=name))
    live = Counted(Emulator(vehicles, start=0.0), links, {"port": pair()[0]}, Audience([]))
    autopilots = [Autopilot(far, times) for far, times in zip(far_ends, (fast, slow), strict=True)]
    run([*autopilots, live], StepClock(), until=SECONDS)
    assert {*fast, *slow} <= {round(at, 6) for at in live.calls}


class Stream:
    """Reads of 80 bytes, 50 times a second; each is a sample."""

    def __init__(self) -> None:
        self._taken = 0
        self.rests = Rests(lambda: [self._taken])

    def flow(self, since: float, until: float) -> list[float]:
        """When the stream is watched."""
        watched = []
        for n in range(round(since * 50), round(until * 50)):
            if not self.rests.rest(n / 50):
                watched.append(n / 50)
            self.rests.read(80, n / 50)
            self._taken += 1
        return watched


def test_in_every_second_some_packets_are_read_when_they_come() -> None:
    watched = Stream().flow(0.0, 10.0)
    assert max(b - a for a, b in pairwise(watched)) < 0.65  # the clock map remembers 1 s
    assert len(watched) < 0.4 * 500


def test_much_at_once_ends_the_rest() -> None:
    stream = Stream()
    stream.flow(0.0, 0.3)
    assert stream.rests.rest(0.3)
    stream.rests.read(3000, 0.3)
    assert not stream.rests.rest(0.3)
    stream.flow(0.3, 0.6)
    assert stream.rests.rest(0.6)
