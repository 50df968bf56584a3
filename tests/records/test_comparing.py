"""Readings side by side: the figures of a comparison are those that were put into the flights."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from arva_hil.autopilot.following.session import Session
from arva_hil.config import DEFAULT, Fault, NavigationError, Scenario, Transmitter
from arva_hil.events import BytesSent, FrameMade, HeartbeatMissing, ReceiverRestarted
from arva_hil.model.field import LocalFrame
from arva_hil.records.comparing import Comparison, compared, emulated_again, paired_frames
from arva_hil.records.reading import RecordingError, load
from arva_hil.records.received import RECEIVER, KeptBytes, ReceivedFrames, ReceiverLog, surveyed_scenario
from firmware_proto import Channel, Decoder, Frame, encode
from tests.rehearsed import rehearse
from tools.figures.rehearsal import EPOCH_US, HOME, Waypoint

QUIET = replace(DEFAULT, receiver=replace(DEFAULT.receiver, noise=replace(DEFAULT.receiver.noise, kind="off")))
FLIGHT = [
    Waypoint(0, -15, 0, -4, 0),
    Waypoint(20, 25, 0, -4, 0),
    Waypoint(25, 25, 10, -4, 90),
    Waypoint(45, -15, 10, -4, 180),
    Waypoint(60, 10, 5, -4, 270),
]


def with_scenario(folder: Path, scenario: Scenario) -> Comparison:
    record = load(folder)
    again = emulated_again(record, record.receivers[0], scenario)
    (one,) = compared(record.receivers[0], again.receiver, again.pairs, again.ranges)
    return one


def test_the_emulator_reads_the_same_where_nothing_differs(tmp_path: Path) -> None:
    one = with_scenario(rehearse(tmp_path / "r", QUIET, FLIGHT), QUIET)
    assert (one.both, one.frames) == (60, 61)  # the autopilot sends nothing before the first
    assert one.all.d_bias_m == pytest.approx(0, abs=0.02)
    assert one.all.d_scatter_m < 0.05
    assert one.all.delta_scatter_deg is not None
    assert one.all.delta_scatter_deg < 1.6
    assert one.hints == []
    said = one.as_json()
    assert said["id"] == 1
    assert set(said["by"]) == {"range", "zone", "angle", "time"}
    assert np.isfinite(said["all"]["ratio"])


def test_a_receiver_that_is_late_has_this_lag(tmp_path: Path) -> None:
    one = with_scenario(rehearse(tmp_path / "r", QUIET, FLIGHT, latency_s=0.6), QUIET)
    assert one.lag_s == pytest.approx(0.6, abs=0.06)


def test_the_delay_of_a_scenario_is_the_lag_of_the_receiver(tmp_path: Path) -> None:
    late = replace(QUIET, faults=(Fault("delay_s", 0.6),))  # the first frame was made before the record
    one = with_scenario(rehearse(tmp_path / "r", QUIET, FLIGHT, latency_s=0.6), late)
    assert one.lag_s == pytest.approx(0, abs=0.06)
    assert one.all.d_scatter_m < 0.05


def test_with_latency_the_receiver_is_where_the_log_reports_the_vehicle_that_much_later(tmp_path: Path) -> None:
    record = load(rehearse(tmp_path / "r", QUIET, FLIGHT))
    late = replace(QUIET, navigation_error=NavigationError(latency_s=3.0))
    there, then = (emulated_again(record, record.receivers[0], scenario).ranges[1] for scenario in (QUIET, late))
    assert then[1:-3] == pytest.approx(there[4:], abs=0.02)


def test_two_frames_of_one_chunk_have_one_time(tmp_path: Path) -> None:
    record = load(rehearse(tmp_path / "r", QUIET, FLIGHT))
    (receiver,) = record.receivers
    time_s = receiver.time_s.copy()
    time_s[21] = time_s[20]
    assert len(emulated_again(record, replace(receiver, time_s=time_s), QUIET).receiver) == 61


def test_frames_that_a_fault_withholds_or_damages_are_lost_and_a_dead_antenna_is_heard(tmp_path: Path) -> None:
    folder = rehearse(tmp_path / "r", QUIET, FLIGHT)
    one = with_scenario(folder, replace(QUIET, faults=(Fault("drop", 0.3), Fault("corrupt", 0.2))))
    assert 10 < one.second_lost < 45
    assert one.both < 45
    assert one.all.d_scatter_m < 0.05
    assert with_scenario(folder, replace(QUIET, faults=(Fault("antenna_x", 0.3),))).all.ratio < 0.97


def test_another_display_law_is_a_ratio_and_a_mount_a_bias_of_the_angle(tmp_path: Path) -> None:
    mount = replace(QUIET.receiver.mount, attitude=(0.0, 0.0, 12.0))
    real = replace(QUIET, receiver=replace(QUIET.receiver, kappa_eq=1.542 * 1.1**3, mount=mount))
    one = with_scenario(rehearse(tmp_path / "r", real, FLIGHT), QUIET)
    assert (one.all.ratio, one.all.delta_bias_deg) == (pytest.approx(1.1, abs=0.01), pytest.approx(-12, abs=1))
    assert {spread.label for spread in one.groups["zone"]} == {"mid"}
    assert sum(spread.count for spread in one.groups["time"]) == one.both
    assert sum(spread.count for spread in one.groups["range"]) == one.both


def test_a_place_100_m_off_is_said(tmp_path: Path) -> None:
    elsewhere = replace(QUIET, transmitters=(Transmitter(id=1, ned=(20.0, 105.0, 0.0)),))
    one = with_scenario(rehearse(tmp_path / "r", QUIET, FLIGHT), elsewhere)
    assert one.second_only == one.both == 0
    hint = next(hint for hint in one.hints if "off" in hint)
    assert 80 < float(hint.split("about ")[1].split(" m")[0]) < 110


def test_a_transmitter_that_the_scenario_has_not_is_said(tmp_path: Path) -> None:
    other = replace(QUIET, transmitters=(Transmitter(id=7, ned=(200.0, 105.0, 0.0)),))
    one = with_scenario(rehearse(tmp_path / "r", QUIET, FLIGHT), other)
    assert any("none in the second" in hint for hint in one.hints)


def test_frames_without_ids_are_those_of_the_nearest(tmp_path: Path) -> None:
    one = with_scenario(rehearse(tmp_path / "r", replace(QUIET, output_format="text"), FLIGHT), QUIET)
    assert one.id is None
    assert one.all.d_scatter_m < 0.05


def test_a_receiver_of_pulses_is_compared_with_one_of_pulses(tmp_path: Path) -> None:
    pulsed = replace(QUIET, receiver=replace(QUIET.receiver, model="pulsed", options=None))
    one = with_scenario(rehearse(tmp_path / "r", pulsed, FLIGHT), pulsed)
    assert one.all.d_scatter_m < 0.2
    assert one.first_only + one.second_only <= 3


def test_two_records_of_one_flight_are_paired_by_the_autopilots_clock(tmp_path: Path) -> None:
    a, b = rehearse(tmp_path / "a", DEFAULT, FLIGHT), rehearse(tmp_path / "b", replace(DEFAULT, seed=2), FLIGHT)
    later = (b / "events.jsonl").read_text().replace("2027-01-01T00:00:", "2027-01-01T00:07:")
    (b / "events.jsonl").write_text(later)
    one, two = load(a), load(b)
    pairs = paired_frames(one, two)
    assert (pairs.how, pairs.offset_s) == ("time", pytest.approx(420, abs=0.01))
    (result,) = compared(one.receivers[0], two.receivers[0], pairs)
    assert 0 < result.all.d_scatter_m < 1
    assert abs(result.all.d_bias_m) < 0.3


def test_the_lag_between_two_receivers_is_that_of_their_latencies(tmp_path: Path) -> None:
    early, late = (rehearse(tmp_path / f"{late_s}", QUIET, FLIGHT, latency_s=late_s) for late_s in (0.3, 1.1))
    one, two = load(late), load(early)
    (result,) = compared(one.receivers[0], two.receivers[0], paired_frames(one, two))
    assert (result.lag_s, result.hints) == (pytest.approx(0.8, abs=0.06), [])


FAR = [
    Waypoint(0, -35, 0, -4, 0),
    Waypoint(60, 25, 0, -4, 0),
    Waypoint(70, 25, 10, -4, 90),
    Waypoint(130, -35, 10, -4, 180),
]


def test_noise_does_not_draw_the_lag_to_the_middle_between_two_readings(tmp_path: Path) -> None:
    """Five readings a second: the middle is 0.1 s off."""
    noisy = replace(DEFAULT, receiver=replace(DEFAULT.receiver, rate_hz=5.0), seed=1)
    record = rehearse(tmp_path / "r", noisy, FAR, seed=1)
    assert with_scenario(record, replace(noisy, seed=101)).lag_s == pytest.approx(0, abs=0.05)


def test_each_reading_is_in_one_part_of_the_time(tmp_path: Path) -> None:
    record = load(rehearse(tmp_path / "r", QUIET, FLIGHT))
    again = emulated_again(record, record.receivers[0], QUIET)
    pairs = again.pairs._replace(first=again.pairs.first[3:], second=again.pairs.second[3:])
    for aside_s in (0.0, 0.07, 0.13):
        later = replace(record.receivers[0], time_s=record.receivers[0].time_s + aside_s)
        (one,) = compared(later, again.receiver, pairs, again.ranges)
        assert sum(spread.count for spread in one.groups["time"]) == one.both


def test_two_flights_are_paired_by_their_places(tmp_path: Path) -> None:
    there = [point._replace(time_s=point.time_s * 1.3) for point in FLIGHT]
    one, two = load(rehearse(tmp_path / "a", QUIET, FLIGHT)), load(rehearse(tmp_path / "b", QUIET, there))
    pairs = paired_frames(one, two)
    assert pairs.how == "place"
    (result,) = compared(one.receivers[0], two.receivers[0], pairs)
    assert result.both > 30
    assert result.all.d_scatter_m < 1
    assert result.lag_s is None


# -- the record of a real receiver: the emulator stands in for it, and the record has what came ----------------


POINTS = [Waypoint(0, -10, 0, -3, 0), Waypoint(10, -10, 0, -3, 0), Waypoint(30, 20, 0, -3, 60)]
LAT, LON, ALT = (float(value) for value in LocalFrame(*HOME).lla([20.0, 5.0, 0.0]))
PLACE = (1, LAT, LON, ALT)


def log_of() -> ReceiverLog:
    frames = ReceivedFrames(Decoder(), numbered=True)
    return ReceiverLog(surveyed_scenario([]), Session(passive=True), frames, start=0.0, timeout_s=5.0)


def test_a_record_has_each_frame_with_its_pose_and_the_range_of_a_surveyed_place(tmp_path: Path) -> None:
    record = load(rehearse(tmp_path / "r", QUIET, POINTS, surveyed=[PLACE]))
    assert record.notes == ()
    assert record.run.is_real
    (receiver,) = record.receivers
    assert len(receiver) == 31
    d_m, _, zone, range_m = receiver.of_transmitter(1)
    there = zone > 0
    assert there.sum() >= 28
    from_pose = np.linalg.norm(receiver.position - [20.0, 5.0, 0.0], axis=1)
    assert range_m[there] == pytest.approx(from_pose[there], abs=0.02)
    assert 0.9 < np.median(d_m[there] / range_m[there]) < 1.16


def test_without_a_surveyed_place_there_is_no_true_range_and_no_scenario(tmp_path: Path) -> None:
    record = load(rehearse(tmp_path / "r", QUIET, POINTS))
    assert record.notes == ()
    assert record.run.scenario is None
    assert json.loads((tmp_path / "r" / "run.json").read_text())["source"] == "receiver"
    assert np.isnan(record.receivers[0].true_range_m).all()
    assert np.isfinite(record.receivers[0].position[2:]).all()


def test_the_bytes_are_kept_with_their_times_so_that_they_can_be_decoded_again(tmp_path: Path) -> None:
    folder = rehearse(tmp_path / "r", QUIET, POINTS, more=[(12.0, b"$OTHER,1,2*00\r\n"), (14.5, b"more")])
    chunks = [one for one in KeptBytes.of(folder) if one.link == RECEIVER]
    assert b"".join(one.data for one in chunks) == (folder / "frames.bin").read_bytes()
    assert [(one.time_us - EPOCH_US) / 1e6 for one in chunks if one.data == b"more"] == [pytest.approx(14.5, abs=0.06)]
    times = [one.time_us for one in KeptBytes.of(folder)]
    assert all(a <= b for a, b in pairwise(times))


def test_a_record_whose_bytes_have_no_times_is_refused(tmp_path: Path) -> None:
    folder = rehearse(tmp_path / "r", QUIET, POINTS)
    (folder / "chunks.csv").unlink()
    with pytest.raises(RecordingError, match=r"there is no chunks.csv in it"):
        list(KeptBytes.of(folder))


def test_a_cut_file_of_bytes_gives_what_is_before_the_cut(tmp_path: Path) -> None:
    folder = rehearse(tmp_path / "r", QUIET, POINTS)
    data = (folder / "frames.bin").read_bytes()
    (folder / "frames.bin").write_bytes(data[:-5])
    assert b"".join(one.data for one in KeptBytes.of(folder) if one.link == RECEIVER) == data[:-33]


def test_a_receiver_that_restarts_is_said_and_counted() -> None:
    log = log_of()
    for number in [*range(100, 140), 0, 1, 2]:
        log.receive(RECEIVER, encode(Frame(number, 1, (Channel(),))), 0.1 * number)
    log.advance(20.0, final=True)
    restarts = [event for event in log.events() if isinstance(event, ReceiverRestarted)]
    assert [(one.before, one.after) for one in restarts] == [(139, 0)]
    assert (log.counts()["restarts"], log.counts()["lost"]) == (1, 0)


def test_frames_without_poses_are_kept_and_counted() -> None:
    log = log_of()
    log.receive(RECEIVER, encode(Frame(0, 1, (Channel(1, 1, 500, 3),))), 1.0)
    log.advance(6.0)
    events = log.events()
    (made,) = [event for event in events if isinstance(event, FrameMade)]
    assert made.pose is None
    assert made.reading.channels[0].d_cm == 500
    assert made.reading.channels[0].true_range_m is None
    assert log.counts()["no_pose"] == 1
    assert log.missing
    assert any(isinstance(event, HeartbeatMissing) for event in events)
    assert sum(len(event.data) for event in events if isinstance(event, BytesSent)) == 15


def test_the_status_of_a_frame_is_kept() -> None:
    log = log_of()
    log.receive(RECEIVER, encode(Frame(0, 0b111110, (Channel(),))), 1.0)
    log.advance(3.0, final=True)
    (made,) = [event for event in log.events() if isinstance(event, FrameMade)]
    reading = made.reading
    assert (reading.interference, reading.more_heard, reading.failed, reading.overlapping) == (True,) * 4
    assert not reading.searching


def test_two_surveyed_places_of_one_id_are_refused() -> None:
    with pytest.raises(ValueError, match="id"):
        surveyed_scenario([PLACE, PLACE])
