"""`replay`: a recorded flight instead of a vehicle; the same log, scenario and seed give the same bytes."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from arva_hil.clock import RealClock
from arva_hil.links.pty import PtyLink
from arva_hil.links.tlog import TlogReader, tlog_record
from arva_hil.mavlink.codec import Encoder, dialect
from firmware_proto import SYNTHETIC

from .far_ends import Arva, Start, contents, frames_in, heartbeat, read_frames

LOG = Path(__file__).parent.parent / "data" / "arducopter.tlog"


def frames_of(err: str) -> int:
    return int(re.search(r"^(\d+) frames: ", err, re.MULTILINE)[1])  # type: ignore[index]


def test_twice_the_same_gives_the_same_bytes_another_seed_others(arva: Arva, flight: Path, tmp_path: Path) -> None:
    for folder, seed in ("first", 5), ("second", 5), ("other", 6):
        assert arva("replay", flight, "--seed", seed, "--record", tmp_path / folder).code == 0
    first, second, other = (contents(tmp_path / name) for name in ("first", "second", "other"))
    for name in ("frames.bin", "frames.csv", "readings.csv", "autopilot.tlog"):
        assert first[name] == second[name]
    assert first["frames.bin"] != other["frames.bin"]
    assert first["autopilot.tlog"] == other["autopilot.tlog"]


def test_its_record_is_complete(arva: Arva, flight: Path, tmp_path: Path) -> None:
    assert arva("replay", flight, "--record", tmp_path).code == 0
    files = contents(tmp_path)
    frames = frames_in(files["frames.bin"])
    assert frames[-1].channels[0].valid
    rows = list(csv.DictReader(io.StringIO(files["readings.csv"].decode())))
    assert [(int(row["d_cm"]), int(row["delta_deg"])) for row in rows] == [
        (channel.d, channel.delta) for frame in frames for channel in frame.channels
    ]
    assert [record.raw for record in TlogReader(tmp_path / "autopilot.tlog")] == [
        record.raw for record in TlogReader(flight)
    ]
    run = json.loads(files["run.json"])
    assert (run["ended"], run["exit_code"]) == ("finished", 0)
    assert run["counters"]["frames"] == len(frames)


def test_frames_go_to_a_file_or_to_stdout(arva: Arva, start: Start, flight: Path, tmp_path: Path) -> None:
    assert arva("replay", flight, "--out", tmp_path / "frames.bin").code == 0
    program = start("replay", flight, "--out", "-")
    assert program.ends() == 0
    written = (tmp_path / "frames.bin").read_bytes()
    assert program.out == written
    frames = frames_in(written)
    assert len(frames) in (26, 30)
    assert all(frame.status & SYNTHETIC for frame in frames)


def test_without_a_place_to_go_frames_are_lines_on_stdout(arva: Arva) -> None:
    ended = arva("replay", LOG)
    assert len(ended.out.splitlines()) == frames_of(ended.err)
    assert re.search(r"^ +20\.000 s +20  #1 mid \d+ cm [+-]\d+°$", ended.out, re.MULTILINE)


def test_a_port_gets_the_frames_in_the_logs_rhythm_times_the_speed(start: Start, line: PtyLink) -> None:
    clock = RealClock()
    program = start("replay", LOG, "--port", line.path, "--speed", 20)
    frames = read_frames(line, 26)
    assert program.ends() == 0
    assert clock.now() > 29 / 20  # the log's last frame is at 29 s
    assert len(frames) + len(frames_in(line.read())) == frames_of(program.err)
    assert frames[-1].channels[0].valid


def test_json_is_one_object_a_frame(arva: Arva) -> None:
    ended = arva("replay", LOG, "--json")
    every = [json.loads(line) for line in ended.out.splitlines()]
    objects = [said for said in every if "event" not in said]
    names = [said["event"] for said in every if "event" in said]
    assert names[:2] == ["vehicle_found", "datum_set"]
    assert "pose_found" in names
    assert [said["time_s"] for said in objects] == pytest.approx(range(frames_of(ended.err)))
    assert objects[-1]["channels"][0]["id"] == 1


def test_every_line_says_which_faults_its_frame_met(arva: Arva) -> None:
    faults = ("--fault", "drop=1@10-12", "--fault", "stuck@11-13")
    met = {10: ["drop"], 11: ["stuck", "drop"], 12: ["stuck"]}
    ended = arva("replay", LOG, "--json", "--out", os.devnull, *faults)
    objects = [said for line in ended.out.splitlines() if "event" not in (said := json.loads(line))]
    assert {(n, tuple(said["faults"])) for n, said in enumerate(objects)} == {
        (n, tuple(met.get(n, ()))) for n in range(frames_of(ended.err))
    }
    for said in (arva("replay", LOG, *faults).out, arva("replay", LOG, "--out", os.devnull, "-v", *faults).err):
        lines = re.findall(r"^(?: +[\d.]+ s )? *(\d+)  ?(?:#|no signal).*?(?:  \[(.*)\])?$", said, re.MULTILINE)
        assert {int(n): names.split(", ") for n, names in lines if names} == met
        assert len(lines) == frames_of(ended.err)


# -- logs that are not what they should be -----------------------------------------------------------------


def test_garbage_and_a_torn_tail_are_passed_over_and_counted(arva: Arva, flight: Path, tmp_path: Path) -> None:
    records = [tlog_record(*record) for record in TlogReader(flight)]
    middle = len(records) // 2
    log = tmp_path / "torn.tlog"
    log.write_bytes(b"".join(records[:middle]) + b"\x55" * 100 + b"".join(records[middle:])[:-5])
    whole, hurt = arva("replay", flight, "--out", os.devnull), arva("replay", log, "--out", os.devnull)
    assert hurt.code == 0
    assert frames_of(hurt.err) == frames_of(whole.err)
    assert f"{log}: 100 bytes of garbage, {len(records[-1]) - 5} of an incomplete last record" in hurt.err
    assert "garbage" not in whole.err


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: None, "no such file"),
        (lambda path: path.mkdir(), "is a directory"),
        (lambda path: path.write_bytes(b""), "no MAVLink packet in its 0 bytes: is it a telemetry log?"),
        (lambda path: path.write_bytes(b"hello\n" * 100), "no MAVLink packet in its 600 bytes"),
    ],
)
def test_what_is_no_log_is_refused(arva: Arva, tmp_path: Path, make: Callable[[Path], object], message: str) -> None:
    log = tmp_path / "flight.tlog"
    make(log)
    code, out, err = arva("replay", log, "--record", tmp_path / "record")
    assert (code, out) == (2, "")
    assert f"arva-hil: {log}: {message}" in err
    assert not (tmp_path / "record").exists()


def test_a_log_without_an_autopilot_has_no_vehicle(arva: Arva, tmp_path: Path) -> None:
    station = Encoder(255, 190)
    hello = (heartbeat(station, dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID) for _ in range(5))
    log = tmp_path / "station.tlog"
    log.write_bytes(b"".join(tlog_record((1_700_000_000 + n) * 1_000_000, raw) for n, raw in enumerate(hello)))
    ended = arva("replay", log, "--out", os.devnull)
    assert ended.code == 3
    assert "no autopilot's heartbeat: heartbeats of gcs from 255/190 ×5" in ended.err


def test_another_vehicle_than_the_logs_can_be_asked_for(arva: Arva) -> None:
    ended = arva("replay", LOG, "--out", os.devnull, "--target-system", 9)
    assert ended.code == 3
    assert "packets came, but none of the wanted vehicle: packets from 1/1 ×" in ended.err
    assert "; is its system id right?" in ended.err


def test_the_log_itself_is_never_written_to(arva: Arva, tmp_path: Path) -> None:
    log = tmp_path / "flight.tlog"
    log.write_bytes(LOG.read_bytes())
    code, _, err = arva("replay", log, "--out", log)
    assert code == 2
    assert "this is the log itself: name another file" in err
    assert log.read_bytes() == LOG.read_bytes()


def test_ctrl_c_ends_it_with_whole_files(start: Start, line: PtyLink, tmp_path: Path) -> None:
    program = start("replay", LOG, "--port", line.path, "--rate", 20, "--record", tmp_path)
    frames = read_frames(line, 5)
    program.send(signal.SIGINT)
    assert program.ends() == 130
    recorded = contents(tmp_path)
    assert frames_in(recorded["frames.bin"]) == frames + frames_in(line.read())
    assert json.loads(recorded["run.json"])["ended"] == "SIGINT"
