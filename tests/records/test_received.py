"""The record of a real receiver: the emulator stands in for it, and the record has what came."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from arva_hil.autopilot.following.session import Session
from arva_hil.config import DEFAULT
from arva_hil.events import BytesSent, FrameMade, HeartbeatMissing, ReceiverRestarted
from arva_hil.model.field import LocalFrame
from arva_hil.records.reading import RecordingError, load
from arva_hil.records.received import RECEIVER, KeptBytes, ReceivedFrames, ReceiverLog, Surveyed, surveyed_scenario
from firmware_proto import Channel, Decoder, Frame, encode
from tests.rehearsed import rehearse
from tools.real.rehearsal import EPOCH_US, HOME, Waypoint

POINTS = [Waypoint(0, -10, 0, -3, 0), Waypoint(10, -10, 0, -3, 0), Waypoint(30, 20, 0, -3, 60)]
PLACE = Surveyed(1, *(float(value) for value in LocalFrame(*HOME).lla([20.0, 5.0, 0.0])))
QUIET = replace(DEFAULT, receiver=replace(DEFAULT.receiver, noise=replace(DEFAULT.receiver.noise, kind="off")))


def log_of() -> ReceiverLog:
    return ReceiverLog(
        surveyed_scenario([]), Session(passive=True), ReceivedFrames(Decoder(), numbered=True), start=0.0, timeout_s=5.0
    )


def test_a_record_has_each_frame_with_its_pose_and_the_range_of_a_surveyed_place(tmp_path: Path) -> None:
    record = load(rehearse(tmp_path / "r", QUIET, POINTS, surveyed=[PLACE]))
    assert record.notes == ()
    assert record.run is not None
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
    assert record.run is not None
    assert record.run.scenario is None
    assert json.loads((tmp_path / "r" / "run.json").read_text())["source"] == "receiver"
    assert np.isnan(record.receivers[0].true_range_m).all()
    assert np.isfinite(record.receivers[0].position[2:]).all()


def test_the_bytes_are_kept_with_their_times_so_that_they_can_be_decoded_again(tmp_path: Path) -> None:
    noise = [(12.0, b"$OTHER,1,2*00\r\n"), (14.5, b"more")]
    folder = rehearse(tmp_path / "r", QUIET, POINTS, more=noise)
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
    kept = b"".join(one.data for one in KeptBytes.of(folder) if one.link == RECEIVER)
    assert kept == data[:-33]


def test_a_receiver_that_restarts_is_said_and_counted() -> None:
    log = log_of()
    for number in [*range(100, 140), 0, 1, 2]:
        log.receive(RECEIVER, encode(Frame(number, 1, (Channel(),))), 0.1 * number)
    log.advance(20.0, final=True)
    restarts = [event for event in log.events() if isinstance(event, ReceiverRestarted)]
    assert [(one.before, one.after) for one in restarts] == [(139, 0)]
    assert log.counts()["restarts"] == 1
    assert log.counts()["lost"] == 0


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
