"""Transmitters that move: on timed waypoints, or with another vehicle that is heard on any of the links."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from arva_hil.autopilot.following.session import Session
from arva_hil.config import Follows, Noise, Path, ReceiverOptions, Scenario, Transmitter, parse_fault
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import VehicleSetup, one_vehicle
from arva_hil.events import FollowedSystemHeard, FollowedSystemSilent, FrameMade
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.model.field import Following, LocalFrame, MovingTransmitters, Transmitters, Waypoints, rotation
from arva_hil.simulated.vehicle import SimulatedVehicle
from tests.every import every
from tests.one_receiver import Diary, turn

HOME = (46.0123, 7.7456, 1650.0)
STREAMS = {33: 20.0, 30: 20.0}
AWAY_M = (30.0, 10.0, -2.0)  # of the vehicle that is followed
SQUARE = ((0.0, 0.0, 0.0, 0.0), (10.0, 20.0, 0.0, 0.0), (20.0, 20.0, 10.0, -1.0))


def at_rest(count: int = 2) -> Transmitters:
    ids = tuple(range(1, count + 1))
    return Transmitters(ids, np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)), np.ones(count))


def scenario(*transmitters: Transmitter, rate_hz: float = 5.0) -> Scenario:
    return Scenario(transmitters, receiver=ReceiverOptions(noise=Noise("off"), rate_hz=rate_hz))


class Bench:
    """A vehicle on the ground at home, system 1, and others that the emulator hears; each on its link.

    `others`: (link, vehicle).
    """

    def __init__(self, chosen: Scenario, *others: tuple[str, SimulatedVehicle], look_ahead_s: float = 0.0) -> None:
        self.vehicle = SimulatedVehicle(HOME, streams=STREAMS)
        self.others = list(others)
        self.now = 0.0
        self.diary = Diary()
        setups = [one_vehicle(chosen, Session(target_system=1, passive=True), link="autopilot")]
        plain = scenario(Transmitter(9, ned=(1.0, 0.0, 0.0)))
        setups += [
            VehicleSetup(link, link, Session(passive=True), plain, [])
            for link in {link for link, _ in others} - {"autopilot"}
        ]
        self.emulator = Emulator(setups, start=0.0, look_ahead_s=look_ahead_s)

    def run(self, seconds: float) -> None:
        until = self.now + seconds
        while self.now < until:
            self.now = round(self.now + 0.02, 6)
            for link, vehicle in [("autopilot", self.vehicle), *self.others]:
                if data := vehicle.poll(self.now):
                    self.emulator.receive(link, data, self.now, vehicle.system)
            turn(self.emulator, self.now, self.diary)

    @property
    def frames(self) -> list[FrameMade]:
        return [frame for frame in self.diary.frames if frame.pose is not None]

    def ranges(self) -> list[float | None]:
        return [frame.reading.channels[0].true_range_m for frame in self.frames]

    def told(self) -> list[object]:
        return [e for e in self.diary.events if isinstance(e, FollowedSystemSilent | FollowedSystemHeard)]


def there(ned: Sequence[float] = AWAY_M, system: int = 2) -> SimulatedVehicle:
    """A vehicle that stands there."""
    lat, lon, alt = LocalFrame(*HOME).lla(ned)
    return SimulatedVehicle((float(lat), float(lon), float(alt)), system, streams=STREAMS)


# -- where they are at a time ------------------------------------------------------------------------------


def test_between_waypoints_it_goes_straight_before_the_first_and_behind_the_last_it_stays() -> None:
    times, points = np.array([10.0, 20.0, 40.0]), np.array([[0.0, 0, 0], [10, 0, 0], [10, 40, -2]])
    path = Waypoints(times, points)
    expected = {0: (0, 0, 0), 12.5: (2.5, 0, 0), 20: (10, 0, 0), 30: (10, 20, -1), 99: (10, 40, -2)}
    for time_s, place in expected.items():
        assert path.at(time_s) == pytest.approx(place)


def test_a_loop_begins_anew_at_the_time_of_its_last_point() -> None:
    path = Waypoints(np.array([0.0, 10.0]), np.array([[0.0, 0, 0], [10, 0, 0]]), "loop")
    assert [path.at(t)[0] for t in (5, 10, 15, 27)] == pytest.approx([5, 10, 5, 7])
    later = Waypoints(np.array([2.0, 12.0]), np.array([[0.0, 0, 0], [10, 0, 0]]), "loop")
    assert [later.at(t)[0] for t in (0, 5, 12, 13, 25, 38)] == pytest.approx([0, 3, 10, 1, 3, 6])
    assert Waypoints(np.array([3.0]), np.array([[1.0, 2, 3]]), "loop").at(50.0) == pytest.approx([1, 2, 3])


def test_waypoints_may_be_as_close_in_time_as_wanted() -> None:
    path = Waypoints(np.array([0.0, 0.001]), np.array([[0.0, 0, 0], [1, 0, 0]]))
    assert path.at(0.0005) == pytest.approx([0.5, 0, 0])


@every("times", [[], [1.0, 1.0], [2.0, 1.0]])
def test_waypoints_whose_times_do_not_rise_are_an_error(times: list[float]) -> None:
    with pytest.raises(ValueError, match="later than the one before"):
        Waypoints(np.array(times), np.zeros((len(times), 3)))


def test_those_at_rest_are_never_copied() -> None:
    rest = at_rest()
    assert MovingTransmitters(rest, {}).at(1.0) is rest


def test_one_that_follows_is_off_its_vehicle_by_the_offset_and_turns_with_it() -> None:
    east = rotation.to_matrix(rotation.from_euler(0.0, 0.0, math.pi / 2))
    moving = MovingTransmitters(at_rest(), {1: Following(7, np.array([2.0, 0.0, 1.0]))})
    now = moving.at(1.0, {7: (np.array([10.0, 20.0, -5.0]), east)})
    assert now.positions[1] == pytest.approx([10.0, 22.0, -4.0])
    assert now.rotations[1] == pytest.approx(east)
    assert now.positions[0] == pytest.approx(np.zeros(3))


def test_one_whose_vehicle_is_not_heard_is_silent_and_nowhere() -> None:
    now = MovingTransmitters(at_rest(), {1: Following(7, np.zeros(3))}).at(1.0)
    assert now.strengths.tolist() == [1.0, 0.0]
    assert now.ranges(np.array([3.0, 4.0, 0.0])) == {1: 5.0}


# -- in the emulator ---------------------------------------------------------------------------------------


def test_a_receiver_at_rest_hears_a_transmitter_go_by() -> None:
    bench = Bench(scenario(Transmitter(1, path=Path(SQUARE, end="stay"))))
    bench.run(25.0)
    times, *axes = np.array(SQUARE).T
    instants = [frame.instant_s for frame in bench.frames]
    expected = np.linalg.norm([np.interp(instants, times, axis) for axis in axes], axis=0)
    assert len(expected) > 80
    assert bench.ranges() == pytest.approx(expected, abs=0.01)
    assert bench.frames[-1].reading.channels[0].d_cm > 1500


def test_faults_work_on_top_of_a_path() -> None:
    by = parse_fault("transmitter_moved=1,by_ned=[0,0,-7]@22-99")
    bench = Bench(replace(scenario(Transmitter(1, path=Path(SQUARE))), faults=(by,)))
    bench.run(25.0)
    assert bench.ranges()[-1] == pytest.approx(math.hypot(20, 10, 8), abs=0.01)


FOLLOWING = scenario(Transmitter(1, follows=Follows(2, (1.0, 0.0, 0.5))))
FAR = math.hypot(AWAY_M[0] + 1.0, AWAY_M[1], AWAY_M[2] + 0.5)


@pytest.mark.parametrize("link", ["autopilot", "elsewhere"])
@pytest.mark.parametrize("look_ahead_s", [0.0, 1.0])
def test_a_transmitter_follows_a_vehicle_heard_on_whatever_link(link: str, look_ahead_s: float) -> None:
    bench = Bench(FOLLOWING, (link, there()), look_ahead_s=look_ahead_s)
    bench.run(12.0)
    assert len(bench.frames) > 20
    assert bench.ranges()[-20:] == pytest.approx([FAR] * 20, abs=0.03)
    assert bench.frames[-1].reading.channels[0].id == 1
    assert bench.told() == []


def test_one_that_was_never_heard_is_said_once_and_its_transmitter_is_silent() -> None:
    bench = Bench(FOLLOWING)
    bench.run(20.0)
    (silent,) = bench.told()
    assert isinstance(silent, FollowedSystemSilent)
    assert (silent.system, silent.was_heard) == (2, False)
    assert silent.time_s == pytest.approx(2.0, abs=0.3)
    assert set(bench.ranges()) == {None}
    assert all(frame.reading.channels[0].id is None for frame in bench.frames)


def test_one_that_falls_silent_is_said_once_and_so_is_that_it_is_back() -> None:
    bench = Bench(FOLLOWING, ("elsewhere", there()))
    bench.run(12.0)
    gone = bench.others.pop()
    bench.run(10.0)
    assert bench.frames[-1].reading.channels[0].id is None
    gone[1].poll(bench.now)  # what it said meanwhile is lost
    bench.others.append(gone)
    bench.run(3.0)
    first, second = bench.told()
    assert isinstance(first, FollowedSystemSilent)
    assert first.was_heard
    assert first.time_s == pytest.approx(14.1, abs=0.4)
    assert isinstance(second, FollowedSystemHeard)
    assert bench.ranges()[-1] == pytest.approx(FAR, abs=0.03)


def test_only_the_component_that_tells_the_position_is_followed() -> None:
    bench = Bench(FOLLOWING, ("elsewhere", there()))
    bench.run(5.0)
    camera = Encoder(2, 100)
    for n in range(100):
        turned = dialect.MAVLink_attitude_message(5000 + 20 * n, 1.0, 1.0, 1.0, 0, 0, 0)
        bench.emulator.receive("elsewhere", camera.pack(turned), bench.now, 2)
        bench.run(0.02)
    assert bench.ranges()[-1] == pytest.approx(FAR, abs=0.03)
