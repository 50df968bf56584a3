"""The pose track against scipy and pymap3d, and the map of the two clocks."""

from __future__ import annotations

import math
import random
import tracemalloc
from itertools import accumulate
from typing import NamedTuple

import numpy as np
import pymap3d
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from arva_hil.autopilot.following.navigation import AttitudeSample, ClockMap, PoseTrack, PositionSample, VehicleState
from arva_hil.model.field import LocalFrame

Vector = NDArray[np.float64]

HOME = (46.5, 11.35, 1800.0)
FRAME = LocalFrame(*HOME)
SEEDS = st.integers(0, 2**32 - 1)
few = settings(max_examples=20)  # each one is a whole flight


class Flight(NamedTuple):
    """Random samples, as a track takes them and as scipy does."""

    track: PoseTrack
    positions: list[PositionSample]
    attitudes: list[AttitudeSample]
    ned: Vector
    turned: Rotation

    @property
    def start(self) -> float:
        return max(self.positions[0].boot, self.attitudes[0].boot)

    @property
    def end(self) -> float:
        return min(self.positions[-1].boot, self.attitudes[-1].boot)


@pytest.fixture
def track() -> PoseTrack:
    return PoseTrack()


@pytest.fixture
def clock() -> ClockMap:
    return ClockMap()


def flight(seed: int, position_gap: float = 0.25, attitude_gap: float = 0.25) -> Flight:
    rng = np.random.default_rng(seed)

    def times(gap: float) -> Vector:
        return np.round(5 + np.cumsum(rng.uniform(0.2 * gap, gap, int(4 / gap))), 3)

    positions = [
        PositionSample(
            float(t),
            float(HOME[0] + rng.normal(0, 1e-3)),
            float(HOME[1] + rng.normal(0, 1e-3)),
            float(HOME[2] + rng.normal(0, 20)),
            tuple(rng.normal(0, 5, 3)),
        )
        for t in times(position_gap)
    ]
    attitudes = [
        AttitudeSample(float(t), tuple(rng.uniform((-3.1, -1.5, -3.1), (3.1, 1.5, 3.1))), tuple(rng.normal(0, 1, 3)))
        for t in times(attitude_gap)
    ]
    track = PoseTrack()
    for position in positions:
        track.positions.add(position)
    for attitude in attitudes:
        track.attitudes.add(attitude)
    lla = np.array([p[1:4] for p in positions]).T
    ned = np.array(pymap3d.geodetic2ned(*lla, *HOME)).T
    return Flight(track, positions, attitudes, ned, turned([a.angles for a in attitudes]))


def turned(angles: list[tuple[float, ...]]) -> Rotation:
    return Rotation.from_euler("ZYX", np.array(angles)[:, ::-1])


def pose(track: PoseTrack, boot: float) -> VehicleState:
    state = track.at(boot, FRAME)
    assert state.boot_s == boot
    return state


def angle(state: VehicleState, expected: Rotation) -> float:
    """Between two attitudes, radians."""
    w, x, y, z = state.attitude
    return float((Rotation.from_quat([x, y, z, w]).inv() * expected).magnitude())


@pytest.mark.parametrize(("position_gap", "attitude_gap"), [(1.0, 0.05), (0.05, 1.0)])
@few
@given(seed=SEEDS)
def test_between_samples_it_is_what_scipy_makes_of_them(position_gap: float, attitude_gap: float, seed: int) -> None:
    from scipy.interpolate import CubicHermiteSpline

    f = flight(seed, position_gap, attitude_gap)
    position = CubicHermiteSpline([p.boot for p in f.positions], f.ned, [p.velocity for p in f.positions])
    attitude = Slerp([a.boot for a in f.attitudes], f.turned)
    for boot in np.linspace(f.start, f.end, 23):
        state = pose(f.track, float(boot))
        np.testing.assert_allclose(state.position, position(boot), atol=1e-6)
        np.testing.assert_allclose(state.velocity, position(boot, 1), atol=1e-6)
        assert angle(state, attitude(boot)) < 1e-6


TILT_S, HEADING_S = 0.15, 0.5


@few
@given(SEEDS, st.floats(0, 3))
def test_after_the_newest_it_goes_on_with_velocity_and_for_a_while_with_rates(seed: int, ahead: float) -> None:
    f = flight(seed)
    boot = max(f.positions[-1].boot, f.attitudes[-1].boot) + ahead
    position, attitude = f.positions[-1], f.attitudes[-1]
    state = pose(f.track, boot)
    velocity = np.array(position.velocity)
    np.testing.assert_allclose(state.position, f.ned[-1] + velocity * (boot - position.boot), atol=1e-6)
    np.testing.assert_array_equal(state.velocity, velocity)
    tilting = min(boot - attitude.boot, TILT_S)
    turning = min(boot - attitude.boot, HEADING_S) - tilting
    body = np.array(attitude.rates)
    rates = Rotation.from_rotvec(body * min(tilting, np.radians(30) / np.linalg.norm(body)))  # on the right
    turn = float(f.turned[-1].apply(body)[2]) * turning
    heading = Rotation.from_euler("Z", np.clip(turn, -np.radians(60), np.radians(60)))  # of the world: on the left
    assert angle(state, heading * f.turned[-1] * rates) < 1e-6


@pytest.mark.parametrize("ahead", [0.3, 1.0, 1.9])
def test_in_a_stall_a_roll_that_ended_is_not_rolled_on(track: PoseTrack, ahead: float) -> None:
    """The vehicle levels out from 12° at 40° a second; nothing more is heard of it."""
    track.positions.add(at(1.0))
    track.attitudes.add(AttitudeSample(1.0, (math.radians(12), 0.0, 0.0), (math.radians(-40), 0.0, 0.0)))
    state = pose(track, 1.0 + ahead)
    assert math.degrees(angle(state, Rotation.identity())) < 12
    assert state.age_s == pytest.approx(ahead)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("rate", [99.0, -99.0])
def test_no_rate_turns_it_by_more_than_a_bound(track: PoseTrack, axis: int, rate: float) -> None:
    track.positions.add(at(1.0))
    rates = [0.0, 0.0, 0.0]
    rates[axis] = rate
    track.attitudes.add(AttitudeSample(1.0, (0.0, 0.0, 0.0), tuple(rates)))
    turns = [math.degrees(angle(pose(track, 1.0 + ahead), Rotation.identity())) for ahead in (0.01, 0.2, 1.0, 2.0)]
    assert max(turns) <= (90.001 if axis == 2 else 30.001)


def test_positions_can_be_forgotten_and_the_attitude_stays(track: PoseTrack) -> None:
    for boot in (1.0, 2.0):
        track.positions.add(at(boot))
        track.attitudes.add(yawed(boot, 0.1))
    track.positions.clear()
    assert track.at(1.5, FRAME) is track.last_position is None
    track.positions.add(at(2.1, 5000.0))
    assert track.at(2.05, FRAME) is None
    state = pose(track, 2.2)
    assert state.position[0] == pytest.approx(5000, abs=0.01)
    assert yaw(state) == pytest.approx(0.1)


@few
@given(SEEDS)
def test_at_a_sample_it_is_the_sample(seed: int) -> None:
    f = flight(seed)
    for sample, ned in zip(f.positions, f.ned, strict=True):
        if f.start <= sample.boot <= f.end:
            state = pose(f.track, sample.boot)
            np.testing.assert_allclose(state.position, ned, atol=1e-6)
            np.testing.assert_allclose(state.velocity, sample.velocity, atol=1e-9)


@few
@given(SEEDS)
def test_age_is_that_of_the_older_sample_below(seed: int) -> None:
    f = flight(seed, 0.4, 0.1)
    for boot in np.linspace(f.start, f.end + 3, 17):
        latest = [max(s.boot for s in samples if s.boot <= boot) for samples in (f.positions, f.attitudes)]
        assert pose(f.track, float(boot)).age_s == pytest.approx(boot - min(latest))


@few
@given(SEEDS)
def test_a_quaternion_says_the_same_as_its_angles(seed: int) -> None:
    f = flight(seed)
    other = PoseTrack()
    for position in f.positions:
        other.positions.add(position)
    for attitude, (x, y, z, w) in zip(f.attitudes, f.turned.as_quat(), strict=True):
        sign = -1 if attitude.boot * 1000 % 2 < 1 else 1  # q and −q are the same attitude
        other.attitudes.add(attitude._replace(angles=(sign * w, sign * x, sign * y, sign * z)))
    for boot in np.linspace(f.start, f.end + 1, 17):
        w, x, y, z = pose(other, float(boot)).attitude
        assert angle(pose(f.track, float(boot)), Rotation.from_quat([x, y, z, w])) < 1e-6


# -- what is not there -------------------------------------------------------------------------------------


def at(boot: float, north: float = 0.0, velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> PositionSample:
    lat, lon, alt = FRAME.lla([north, 0.0, 0.0])
    return PositionSample(boot, float(lat), float(lon), float(alt), velocity)


def yawed(boot: float, yaw: float = 0.0, rate: float = 0.0) -> AttitudeSample:
    return AttitudeSample(boot, (0.0, 0.0, yaw), (0.0, 0.0, rate))


def yaw(state: VehicleState) -> float:
    w, _, _, z = state.attitude
    return 2 * math.atan2(z, w)


def test_an_empty_track_knows_nothing(track: PoseTrack) -> None:
    assert track.at(1.0, FRAME) is None
    assert track.newest is None
    assert not track.positions


def test_one_half_of_a_pose_is_none() -> None:
    one, other = PoseTrack(), PoseTrack()
    one.positions.add(at(1.0))
    other.attitudes.add(yawed(1.0))
    for track in (one, other):
        assert track.at(1.0, FRAME) is None
        assert track.newest is None


@pytest.mark.parametrize(("position", "attitude"), [(1.0, 2.0), (2.0, 1.0)])
def test_before_the_first_of_either_there_is_none(track: PoseTrack, position: float, attitude: float) -> None:
    track.positions.add(at(position))
    track.attitudes.add(yawed(attitude))
    assert track.at(1.999, FRAME) is None
    assert track.at(2.0, FRAME) is not None
    assert track.newest == 1.0


@pytest.mark.parametrize(("gap", "north", "heading"), [(2.0, 50.0, 0.5), (2.2, 1.1, 0.05)])
def test_a_wide_gap_is_not_interpolated(track: PoseTrack, gap: float, north: float, heading: float) -> None:
    """The samples are 100 m and 1 rad apart; the first one's own speed is 1 m/s and 0.1 rad/s."""
    track.positions.add(at(1.0, 0.0, (1.0, 0, 0)))
    track.positions.add(at(1.0 + gap, 100.0, (1.0, 0, 0)))
    track.attitudes.add(yawed(1.0, 0.0, 0.1))
    track.attitudes.add(yawed(1.0 + gap, 1.0, 0.1))
    state = pose(track, 1.0 + gap / 2)
    assert state.position[0] == pytest.approx(north, abs=1e-3)
    assert yaw(state) == pytest.approx(heading)
    assert state.age_s == pytest.approx(gap / 2)


@pytest.mark.parametrize("late", [2.0, 1.9, 1.0, 0.5])
def test_a_sample_that_comes_twice_or_late_is_dropped(track: PoseTrack, late: float) -> None:
    for boot in (1.0, 2.0):
        track.positions.add(at(boot))
        track.attitudes.add(yawed(boot))
    track.positions.add(at(late, 99.0))
    track.attitudes.add(yawed(late, 1.0))
    for boot in (1.0, 1.5, 1.95, 2.0, 2.5):
        state = pose(track, boot)
        assert np.linalg.norm(state.position) < 1e-3
        assert yaw(state) == 0
    assert track.newest == 2.0
    assert track.at(0.99, FRAME) is None


def test_fifteen_seconds_are_remembered(track: PoseTrack) -> None:
    for i in range(1500):
        track.positions.add(at(i / 50))
        track.attitudes.add(yawed(i / 50))
    assert track.newest == pytest.approx(29.98)
    assert track.at(15.0, FRAME) is not None
    assert track.at(14.9, FRAME) is None
    assert track.positions[0] == at(14.98)


def test_memory_does_not_grow(track: PoseTrack) -> None:
    """However fast the samples come: here a million of them in a second of the vehicle's time."""

    def fill(start: float) -> int:
        for i in range(10_000):
            track.positions.add(PositionSample(start + i * 1e-6, *HOME, (0.0, 0.0, 0.0)))
            track.attitudes.add(AttitudeSample(start + i * 1e-6, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        before = fill(1.0)
        assert fill(2.0) < before + 10_000
    finally:
        tracemalloc.stop()


# -- The autopilot's clock seen through a link that delays ------------------------------------------------


WINDOW_S = 1.0
TINY = 1e-9


def test_before_the_first_sample_nothing_is_known() -> None:
    assert ClockMap().boot(12.0) is None


def test_it_counts_on_between_samples(clock: ClockMap) -> None:
    clock.add(100.0, 7.0)
    assert clock.boot(100.0) == 7.0
    assert clock.boot(103.5) == 10.5
    assert clock.boot(99.0) == 6.0


@given(
    st.lists(st.tuples(st.floats(0.001, 0.4), st.floats(0, 0.6)), min_size=1, max_size=60),
    st.floats(-1000, 1000),
)
def test_never_ahead_of_the_vehicle_and_late_by_the_least_delay(
    samples: list[tuple[float, float]], offset: float
) -> None:
    """Any delays, which may put samples out of order too; the vehicle's clock keeps the host's time."""
    sent = list(accumulate(gap for gap, _ in samples))
    arrivals = sorted((t + delay, t, delay) for t, (_, delay) in zip(sent, samples, strict=True))
    clock = ClockMap()
    for i, (now, stamp, _) in enumerate(arrivals):
        clock.add(now, stamp - offset)
        estimate = clock.boot(now)
        late = now - offset - estimate
        least = min(delay for at, _, delay in arrivals[: i + 1] if at >= now - WINDOW_S)
        assert -TINY <= late <= least + TINY


@pytest.mark.parametrize(("rate", "earliest", "latest"), [(0.985, -0.0155, 0.0), (1.015, 0.0, 0.0155)])
def test_a_clock_that_runs_wrong_is_followed(clock: ClockMap, rate: float, earliest: float, latest: float) -> None:
    """1.5 % slow was measured: 15 ms in the second that is remembered."""
    numbers = random.Random(1)
    delays: list[tuple[float, float]] = []
    for i in range(3000):
        sent = 0.02 * i
        delay = numbers.uniform(0.001, 0.02)
        now = sent + delay
        delays.append((now, delay))
        clock.add(now, rate * sent)
        estimate = clock.boot(now)
        least = min(d for at, d in delays[-60:] if at >= now - WINDOW_S)
        late = rate * now - estimate
        assert earliest <= late <= least * 1.02 + latest


def steady(clock: ClockMap, start: float, end: float, offset: float) -> None:
    """50 Hz with 5 ms of delay."""
    for i in range(round((end - start) * 50)):
        sent = start + 0.02 * i
        clock.add(sent + 0.005, sent - offset)


def test_a_clock_that_jumped_ahead_is_believed_at_once(clock: ClockMap) -> None:
    steady(clock, 0, 5, 0.0)
    clock.add(5.005, 5.15)
    assert clock.boot(5.005) == pytest.approx(5.15)


@pytest.mark.parametrize(
    ("again_s", "soon_s", "late_s", "behind_s"),
    [(5.0, 5.9, 6.1, 0.15), (6.5, 7.0, 7.6, 1.5)],
    ids=["it fell behind", "the simulator stood still"],
)
def test_a_clock_that_fell_behind_is_believed_after_the_window(
    clock: ClockMap, again_s: float, soon_s: float, late_s: float, behind_s: float
) -> None:
    steady(clock, 0, 5, 0.0)
    steady(clock, again_s, soon_s, behind_s)
    assert clock.boot(soon_s) == pytest.approx(soon_s - 0.005)  # it may still be a delay
    steady(clock, soon_s, late_s, behind_s)
    assert clock.boot(late_s) == pytest.approx(late_s - behind_s - 0.005)


def test_a_burst_behind_a_stall_does_not_pass_for_fresh(clock: ClockMap) -> None:
    """A link that held everything up for 1.5 s, and then delivers it at once."""
    steady(clock, 0, 5, 0.0)
    for i in range(75):
        clock.add(6.5 + 0.001 * i, 5.0 + 0.02 * i)
        assert clock.boot(6.5 + 0.001 * i) == pytest.approx(6.495 + 0.001 * i)


@pytest.mark.parametrize(("speed", "rate"), [(0.5, 1.0), (1.0, 1.0), (1.5, 1.5), (19.0, 19.0), (30.0, 20.0)])
def test_the_rate_is_that_of_a_simulator_faster_than_real_time(clock: ClockMap, speed: float, rate: float) -> None:
    assert clock.rate == 1.0
    for i in range(0, 201, 2):
        clock.add(100 + 0.01 * i, 7 + speed * 0.01 * i)
        assert clock.rate == 1.0  # 2 s are too short for measuring it
    for i in range(202, 301, 2):
        clock.add(100 + 0.01 * i, 7 + speed * 0.01 * i)
        assert clock.rate == pytest.approx(rate)


def test_silence_does_not_keep_an_old_estimate(clock: ClockMap) -> None:
    clock.add(0.0, 0.0)
    clock.add(30.0, 29.5)
    assert clock.boot(30.0) == 29.5
