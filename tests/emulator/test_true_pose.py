"""Truth and estimate are two poses: the receiver hears where the vehicle is, and it reports where it believes to be."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arva_hil.autopilot.following.session import Session
from arva_hil.clock import StepClock
from arva_hil.config import (
    MountOptions,
    NavigationError,
    Noise,
    ReceiverOptions,
    Scenario,
    ScenarioError,
    Transmitter,
    parse,
)
from arva_hil.config.receiver import SlingOptions
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import ReceiverSetup, VehicleSetup, one_vehicle
from arva_hil.emulator.true_state import PoseError, SimulatorTruth
from arva_hil.events import FrameMade, PoseLost, PoseMissing
from arva_hil.events.reasons import NoPose
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.model.field import LocalFrame, rotation
from arva_hil.records.writing import Recorder
from arva_hil.registry import STRATEGIES
from arva_hil.runtime.loop import run
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.simulated.closed_loop import ClosedLoop
from arva_hil.simulated.messages import BUILDERS
from arva_hil.simulated.vehicle import SimulatedVehicle
from tests.one_receiver import HOME, Diary, Flown, turn

QUIET = Scenario((Transmitter(1, ned=(20.0, 5.0, 0.0)),), receiver=ReceiverOptions(noise=Noise("off"), rate_hz=5.0))
TRUTH = replace(QUIET, pose="truth")


class Bench(Flown):
    """The built-in vehicle, whose reports are wrong by some metres, and an emulator."""

    def __init__(self, scenario: Scenario, seconds: float = 20.0, *, gps_noise_m: float = 3.0) -> None:
        super().__init__(scenario, SimulatedVehicle(HOME, gps_noise_m=gps_noise_m, seed=5))
        self.run(seconds)

    @property
    def posed(self) -> list[FrameMade]:
        return [frame for frame in self.diary.frames if frame.pose is not None]


def offsets(frames: Sequence[FrameMade]) -> list[np.ndarray]:
    """From the reported to the true position."""
    return [f.pose.position - f.reported_pose.position for f in frames if f.pose and f.reported_pose]


# -- the simulator's truth ---------------------------------------------------------------------------------


def test_the_receiver_hears_where_the_simulator_says_that_its_vehicle_is() -> None:
    bench = Bench(TRUTH)
    truth = np.array(bench.vehicle.truth(bench.clock.now()).ned)
    assert len(bench.posed) > 80
    for frame in bench.posed:
        assert frame.pose.position == pytest.approx(truth, abs=0.02)
        assert frame.reading.channels[0].true_range_m == pytest.approx(math.dist(truth, (20, 5, 0)), abs=0.03)
    assert np.linalg.norm(offsets(bench.posed)[-1]) > 0.5  # what it reports is elsewhere


def test_without_more_the_estimate_counts_as_the_truth() -> None:
    bench = Bench(QUIET)
    assert len(bench.posed) > 80
    assert all(frame.pose is frame.reported_pose for frame in bench.posed)
    truth = np.array(bench.vehicle.truth(bench.clock.now()).ned)
    assert np.linalg.norm(bench.posed[-1].pose.position - truth) > 0.5


def test_without_a_simulator_there_is_no_truth_and_frames_say_no_signal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(BUILDERS, dialect.MAVLINK_MSG_ID_SIM_STATE)
    bench = Bench(TRUTH)
    assert not bench.posed
    assert bench.diary.frames[-1].reported_pose is not None
    (missing,) = [event for event in bench.diary.events if isinstance(event, PoseMissing)]
    assert missing.lacking == NoPose("no truth", message="SIM_STATE")


def test_when_a_simulator_stops_telling_there_is_no_pose_though_the_report_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = Bench(TRUTH, 10.0)
    monkeypatch.setitem(BUILDERS, dialect.MAVLINK_MSG_ID_SIM_STATE, lambda report: None)
    bench.go_on(5.0)
    (lost,) = [event for event in bench.diary.events if isinstance(event, PoseLost)]
    assert lost.time_s == pytest.approx(12.1, abs=0.11)
    assert bench.diary.frames[-1].pose is None
    assert bench.diary.frames[-1].reported_pose is not None


def told(session: Session, truth: SimulatorTruth, *messages: object, at: float, system: int = 1) -> None:
    encoder = Encoder(system, 1)
    truth.observe(session.feed(b"".join(encoder.pack(message) for message in messages), at), at)


def heartbeat(autopilot: int) -> object:
    return dialect.MAVLink_heartbeat_message(2, autopilot, 0, 0, 3, 3)


def attitude(boot_ms: int) -> object:
    return dialect.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0)


def hil(q: Sequence[float] = (1, 0, 0, 0), lat: int = 460123000, alt: int = 1_652_500, vx: int = 150) -> object:
    return dialect.MAVLink_hil_state_quaternion_message(
        0, list(q), 0, 0, 0, lat, 77456000, alt, vx, 0, -20, 0, 0, 0, 0, 0
    )


@pytest.fixture
def px4() -> tuple[Session, SimulatorTruth]:
    session = Session()
    truth = SimulatorTruth(session)
    told(session, truth, heartbeat(dialect.MAV_AUTOPILOT_PX4), attitude(5000), at=10.0)
    return session, truth


def test_px4_s_truth_has_millimetres_and_either_quaternion_and_is_stamped_when_it_comes(
    px4: tuple[Session, SimulatorTruth],
) -> None:
    session, truth = px4
    turned = rotation.from_euler(0.1, -0.2, 2.0)
    told(session, truth, hil(-turned), at=10.5)
    state = truth.track.at(5.6, LocalFrame(*HOME))
    assert state.age_s == pytest.approx(0.1)
    assert state.position == pytest.approx([0.15, 0.0, -2.52], abs=1e-3)
    assert rotation.to_matrix(state.attitude) == pytest.approx(rotation.to_matrix(turned), abs=1e-6)


def test_of_a_burst_the_last_one_counts(px4: tuple[Session, SimulatorTruth]) -> None:
    session, truth = px4
    told(session, truth, *[hil(lat=460123000 + 100 * n, vx=0) for n in range(5)], at=10.5)
    assert truth.track.at(5.51, LocalFrame(*HOME)).position[0] == pytest.approx(4.45, abs=0.05)


@pytest.mark.parametrize(
    "bad", [hil(q=(0, 0, 0, 0)), hil(q=(math.nan, 0, 0, 1)), hil(lat=950000000), hil(alt=-2_000_000)]
)
def test_a_truth_that_is_no_pose_is_refused(px4: tuple[Session, SimulatorTruth], bad: object) -> None:
    session, truth = px4
    told(session, truth, bad, at=10.5)
    assert (truth.refused, truth.track.newest) == (1, None)


def test_only_the_vehicle_s_own_packets_tell_the_truth(px4: tuple[Session, SimulatorTruth]) -> None:
    session, truth = px4
    told(session, truth, hil(), at=10.5, system=2)
    assert truth.track.newest is None


def test_after_a_reboot_the_truth_is_told_anew() -> None:
    bench = Bench(TRUTH, 10.0)
    bench.vehicle.reboot(bench.clock.now())
    bench.go_on(8.0)
    assert bench.session.navigation.reboots == 1
    last = bench.diary.frames[-1]
    assert last.pose.position == pytest.approx(bench.vehicle.truth(bench.clock.now()).ned, abs=0.02)
    assert last.age_s < 0.1


def test_the_truth_of_another_autopilot_is_asked_for_in_its_own_message() -> None:
    """The first simulator was ended, and the other one was started."""
    session = Session()
    truth = SimulatorTruth(session)
    told(session, truth, heartbeat(dialect.MAV_AUTOPILOT_ARDUPILOTMEGA), attitude(1000), at=1.0)
    session.poll(7.0)
    told(session, truth, heartbeat(dialect.MAV_AUTOPILOT_PX4), attitude(1000), at=7.0)
    assert dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION in session.streams.extra_ids


def test_in_flight_the_truth_is_that_of_the_frame_s_instant() -> None:
    bench = Bench(TRUTH, 5.0)
    bench.fly(6.0)
    bench.go_on(2.9)
    last = bench.posed[-1]
    assert last.pose.position == pytest.approx(bench.vehicle.truth(last.instant_s).ned, abs=0.05)


# -- an error that the emulator adds -----------------------------------------------------------------------


def test_a_bias_moves_the_receiver_and_not_the_report() -> None:
    error = NavigationError(bias_ned=(1.0, -2.0, 0.5))
    bench = Bench(replace(QUIET, navigation_error=error), gps_noise_m=0.0)
    assert len(bench.posed) > 80
    assert np.array(offsets(bench.posed)) == pytest.approx(np.tile([1.0, -2.0, 0.5], (len(bench.posed), 1)))


def test_a_heading_error_turns_the_receiver_clockwise() -> None:
    mounted = replace(QUIET.receiver, mount=MountOptions((1.0, 0.0, 0.0)))
    error = NavigationError(heading_deg=30.0)
    bench = Bench(replace(QUIET, receiver=mounted, navigation_error=error), gps_noise_m=0.0)
    last = bench.posed[-1]
    turn = rotation.to_euler(last.pose.rotation)[2] - rotation.to_euler(last.reported_pose.rotation)[2]
    assert math.degrees(turn) == pytest.approx(30.0, abs=0.01)
    assert last.pose.position[:2] == pytest.approx([math.cos(math.pi / 6), 0.5], abs=0.01)


def test_what_is_reported_late_is_where_the_vehicle_was() -> None:
    """Flying north at 2 m/s, half a second of latency is a metre."""
    bench = Bench(replace(QUIET, navigation_error=NavigationError(latency_s=0.5)), 5.0, gps_noise_m=0.0)
    bench.fly(2.0)
    bench.go_on(2.9)
    assert offsets(bench.posed)[-1] == pytest.approx([1.0, 0.0, 0.0], abs=0.05)
    assert bench.posed[-1].age_s < 0.1


def test_what_hangs_on_a_rope_is_reported_straight_below() -> None:
    hanging = replace(QUIET.receiver, mount=MountOptions(sling=SlingOptions(6.0)))
    error = NavigationError(bias_ned=(3.0, 0.0, 0.0))
    bench = Bench(replace(QUIET, receiver=hanging, navigation_error=error), gps_noise_m=0.0)
    last = bench.posed[-1]
    assert last.pose.position - last.reported_pose.position == pytest.approx([3.0, 0.0, 0.0], abs=0.01)
    assert last.pose.position[2] == pytest.approx(6.0, abs=0.01)


@pytest.mark.parametrize(
    ("chosen", "late_s"),
    [
        *[(QUIET, 0.0), (TRUTH, 0.0)],
        *[(replace(QUIET, navigation_error=NavigationError(latency_s=late_s)), late_s) for late_s in (0.5, 10.0)],
    ],
    ids=["estimate", "truth", "latency", "latency beyond the look-ahead"],
)
def test_with_look_ahead_a_frame_waits_until_its_true_pose_is_known(chosen: Scenario, late_s: float) -> None:
    vehicle, late = SimulatedVehicle(HOME), list[float]()
    emulator = Emulator([one_vehicle(chosen, Session())], start=0.0, look_ahead_s=1.0)
    for step in range(200):
        now, diary = step / 10, Diary()
        emulator.receive("autopilot", vehicle.poll(now), now)
        for output in turn(emulator, now, diary):
            if output.link == "autopilot":
                vehicle.feed(output.data, now)
        late += [now - frame.instant_s for frame in diary.frames if frame.pose]
    assert len(late) > 20
    assert late_s - 0.01 < min(late) <= max(late) < late_s + 0.3


def test_a_walk_has_its_size_and_its_correlation_time() -> None:
    error = PoseError((0, 0, 0), 1.5, 4.0, 0.0, seed=3)
    walk = np.array([error.true_pose(t / 5, np.zeros(3), np.array([1.0, 0, 0, 0]))[0] for t in range(10_000)])
    assert walk.std() == pytest.approx(1.5, rel=0.1)
    later = (walk[20:] * walk[:-20]).mean() / (walk**2).mean()
    assert later == pytest.approx(math.exp(-1), abs=0.08)


def test_the_same_seed_gives_the_same_error_at_the_same_time_in_whatever_order_it_is_asked_for() -> None:
    def at(error: PoseError, time_s: float) -> list[float]:
        position, _ = error.true_pose(time_s, np.zeros(3), np.array([1.0, 0, 0, 0]))
        return list(position.tolist())

    def made(seed: int) -> PoseError:
        return PoseError((0, 0, 0), 1.5, 20.0, 0.0, seed=seed)

    forwards, backwards = made(1), made(1)
    times = [0.0, 0.05, 3.3, 3.31, 50.0, 200.0, 1000.0]
    expected = [at(forwards, t) for t in times]
    assert [at(backwards, t) for t in reversed(times)] == expected[::-1]
    assert at(made(2), 3.3) != expected[2]


def test_two_receivers_of_one_vehicle_share_its_error() -> None:
    scenario = replace(QUIET, navigation_error=NavigationError(walk_sigma_m=2.0, walk_tau_s=5.0))
    quick = replace(scenario, receiver=replace(QUIET.receiver, rate_hz=10.0), seed=9)
    receivers = [ReceiverSetup("slow", "a", scenario), ReceiverSetup("quick", "b", quick)]
    emulator = Emulator([VehicleSetup("vehicle", "link", Session(passive=True), scenario, receivers)], start=0.0)
    vehicle = SimulatedVehicle(HOME, streams={33: 50.0, 30: 50.0})
    diary = Diary()
    for n in range(1, 1500):
        emulator.receive("link", vehicle.poll(n / 100), n / 100)
        turn(emulator, n / 100, diary)
    frames = {(made.receiver, round(made.instant_s, 6)): made for made in diary.frames if made.pose}
    both = [(frames["slow", t], frames["quick", t]) for name, t in frames if name == "slow"]
    assert len(both) > 30
    for slow, fast in both:
        assert offsets([slow])[0] == pytest.approx(offsets([fast])[0], abs=1e-6)
    assert np.std([offsets([slow])[0] for slow, _ in both]) > 0.5


def test_a_scenario_has_the_truth_of_a_simulator_or_an_error_and_not_both() -> None:
    text = "spec: 2\npose: truth\nnavigation_error: {bias_ned: [1, 0, 0]}\ntransmitters: [{id: 1, enu: [1, 2, 3]}]"
    with pytest.raises(ScenarioError, match=r"s\.yaml:3:1"):
        parse(text, "s.yaml")


# -- what is written down, and what comes of it ------------------------------------------------------------


def test_readings_have_the_reported_place_in_their_last_columns_but_one(tmp_path: Path) -> None:
    bench = Bench(TRUTH, 12.0)
    recorder = Recorder(tmp_path, 0, patient=True)
    for frame in bench.diary.frames:
        recorder.observe(frame)
    recorder.close({})
    with open(tmp_path / "readings.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    names = [f"reported_{axis}_m" for axis in ("north", "east", "down")]
    assert list(rows[0])[-5:] == ["faults", *names, "late_ms"]
    assert [rows[0][name] for name in names] == [""] * 3
    last = bench.diary.frames[-1].reported_pose
    assert [float(rows[-1][name]) for name in names] == last.position.tolist()


def test_the_noise_of_the_gps_is_an_error_of_what_a_search_reaches() -> None:
    """When it heard where it believed to be, the error cancelled: 0.2 m were reported 3 m beside the victim."""
    clock = StepClock()
    loop = ClosedLoop(
        Scenario((Transmitter(1, ned=(5.0, 3.0, 1.0)),), seed=3),
        SearchPlan(STRATEGIES["extremum"]),
        start=clock.now(),
        gps_noise_m=1.5,
        stream_hz=10.0,
    )
    run(loop.tasks, clock, until=300.0, stopped=lambda: loop.drones[0].search.outcome is not None)
    error, off = loop.drones[0].error(), loop.drones[0].off(clock.now())
    assert error is not None
    assert off is not None
    assert min(error, off) > 0.5
    assert loop.drones[0].vehicle.truth(clock.now()).ned[2] == pytest.approx(0.0, abs=0.05)
