"""`--record DIR`: what came in, what went out, what was read, and how it ended."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest
from pymavlink import mavutil

from arva_hil.links.pty import PtyLink
from arva_hil.links.tlog import TlogReader
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.records.reading import load
from firmware_proto import Frame

from .far_ends import (
    ORDINARY,
    Arva,
    Autopilot,
    Keep,
    Program,
    Start,
    contents,
    frames_in,
    full_disk,
    hears,
    heartbeat,
    read_frames,
)

DATA = Path(__file__).parent.parent / "data"
COLUMNS = (
    "seq,time_s,boot_ms,north_m,east_m,down_m,roll_deg,pitch_deg,yaw_deg,pose_age_ms,"
    "slot,id,zone,d_cm,delta_deg,true_range_m,faults,reported_north_m,reported_east_m,reported_down_m,late_ms"
).split(",")


class Recorded(NamedTuple):
    folder: Path
    consumed: list[Frame]
    program: Program


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """One run with everything on, ended by Ctrl-C."""
    folder = tmp_path_factory.mktemp("run") / "a" / "record"
    line, vehicle = PtyLink(), Autopilot(PtyLink())
    arguments = ("--port", line.path, "--autopilot", vehicle.address, "--rate", 50, "--seed", 7, "--record", folder)
    program = Program(*arguments)
    try:
        frames = read_frames(line, 60)
        program.send(signal.SIGINT)
        assert program.ends() == 130
        frames += frames_in(line.read())
        return Recorded(folder, frames, program)
    finally:
        for thing in (program, vehicle, line):
            thing.close()


def test_ctrl_c_leaves_whole_files_that_hold_every_frame(recorded: Recorded) -> None:
    assert frames_in((recorded.folder / "frames.bin").read_bytes()) == recorded.consumed
    assert hears(recorded.consumed[-1])


def test_readings_csv_has_the_pinned_columns_and_says_what_the_frames_say(recorded: Recorded) -> None:
    with open(recorded.folder / "readings.csv", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == COLUMNS
    readings = [dict(zip(COLUMNS, row, strict=True)) for row in rows]
    channels = [(frame.sequence, slot, c) for frame in recorded.consumed for slot, c in enumerate(frame.channels, 1)]
    assert len(readings) == len(channels)
    for row, (sequence, slot, channel) in zip(readings, channels, strict=True):
        assert (int(row["seq"]), int(row["slot"])) == (sequence, slot)
        assert (int(row["d_cm"]), int(row["delta_deg"]), int(row["zone"])) == (channel.d, channel.delta, channel.zone)
        assert row["id"] == ("" if channel.id is None else str(channel.id))
    times = [float(row["time_s"]) for row in readings[::4]]
    assert times == pytest.approx([n / 50 for n in range(len(times))])
    first, last = readings[0], readings[-4]
    assert {first["north_m"], first["yaw_deg"], first["pose_age_ms"], first["true_range_m"]} == {""}  # no pose yet
    assert [float(last[name]) for name in ("north_m", "east_m", "down_m", "yaw_deg")] == pytest.approx([0] * 4, abs=0.1)
    assert float(last["true_range_m"]) == pytest.approx(20.616, abs=0.1)
    assert [last[f"reported_{axis}_m"] for axis in ("north", "east", "down")] == [
        last[name] for name in ("north_m", "east_m", "down_m")
    ]
    assert float(last["boot_ms"]) > 0
    (read,) = load(recorded.folder).receivers
    assert read.d_cm.tolist() == [channel.d for _, _, channel in channels]
    assert read.time_s.tolist() == times
    assert (read.late_ms >= 0).all()


def test_the_tlog_opens_in_mavutil_and_has_every_packet(recorded: Recorded) -> None:
    run = json.loads((recorded.folder / "run.json").read_bytes())
    log = mavutil.mavlink_connection(str(recorded.folder / "autopilot.tlog"))
    messages = []
    while (message := log.recv_msg()) is not None:
        messages.append(message)
    log.close()
    assert len(messages) == run["counters"]["packets_received"]
    assert {"HEARTBEAT", "GLOBAL_POSITION_INT", "ATTITUDE", "HOME_POSITION"} <= {m.get_type() for m in messages}
    stamps = [message._timestamp for message in messages]
    assert stamps == sorted(stamps)
    made = (recorded.folder / "run.json").stat().st_mtime
    assert made - 30 < stamps[0] <= stamps[-1] <= made + 1


def test_run_json_says_what_ran_and_how_it_ended(recorded: Recorded) -> None:
    run = json.loads((recorded.folder / "run.json").read_bytes())
    assert (run["ended"], run["exit_code"], run["seed"]) == ("SIGINT", 130, 7)
    assert run["scenario"]["transmitters"][0]["ned"] == [20, 5, 0]
    assert run["scenario"]["receiver"]["rate_hz"] == 50
    assert {"arva-hil", "python", "numpy", "pymavlink"} <= run["versions"].keys()
    assert run["counters"]["frames"] == len(recorded.consumed)
    assert run["counters"]["bad_checksums"] == 0
    assert run["vehicle"]["system"] == 1
    assert run["datum"] == pytest.approx([46.0123, 7.7456, 1650.0])
    assert f"{len(recorded.consumed)} frames: {len(recorded.consumed)} sent, 0 dropped" in recorded.program.err


def test_a_record_can_be_replayed(recorded: Recorded, arva: Arva, tmp_path: Path) -> None:
    code, _, _ = arva("replay", recorded.folder / "autopilot.tlog", "--rate", 20, "--out", tmp_path / "frames.bin")
    assert code == 0
    assert hears(frames_in((tmp_path / "frames.bin").read_bytes())[-1])


def test_sigterm_is_like_ctrl_c(start: Start, autopilot: Autopilot, line: PtyLink, tmp_path: Path) -> None:
    program = start(
        "--port", line.path, "--autopilot", autopilot.address, "--rate", 20, "--record", tmp_path / "record"
    )
    program.says("vehicle ardupilotmega")
    program.send(signal.SIGTERM)
    assert program.ends() == 130
    run = json.loads((tmp_path / "record" / "run.json").read_bytes())
    assert (run["ended"], run["exit_code"]) == ("SIGTERM", 130)
    records = list(TlogReader(tmp_path / "record" / "autopilot.tlog"))
    assert len(records) == run["counters"]["packets_received"]


def test_a_run_that_fails_says_so_in_its_record(start: Start, line: PtyLink, tmp_path: Path) -> None:
    program = start("--port", line.path, "--autopilot", "pty", "--timeout", 0.2, "--record", tmp_path / "record")
    assert program.ends() == 3
    run = json.loads((tmp_path / "record" / "run.json").read_bytes())
    assert run["exit_code"] == 3
    assert "no byte came" in run["ended"]
    assert (run["vehicle"], run["datum"]) == (None, None)


# -- where a record cannot be created -------------------------------------------------------------------------


def test_an_existing_record_is_never_overwritten(arva: Arva, tmp_path: Path) -> None:
    kept = tmp_path / "readings.csv"
    kept.write_text("of yesterday")
    code, _, err = arva("replay", DATA / "px4.tlog", "--record", tmp_path)
    assert code == 2
    assert "holds a record already (readings.csv); name another folder" in err
    assert str(tmp_path) in err
    assert kept.read_text() == "of yesterday"
    assert os.listdir(tmp_path) == ["readings.csv"]


def test_a_file_is_no_folder_for_a_record(arva: Arva, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("mine")
    code, _, err = arva("replay", DATA / "px4.tlog", "--record", file)
    assert code == 2
    assert f"{file}: cannot record: File exists" in err
    assert file.read_text() == "mine"


def test_a_read_only_folder_is_no_place_for_a_record(start: Start, tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        program = start("replay", DATA / "px4.tlog", "--record", tmp_path / "record", before=ORDINARY)
        assert program.ends() == 2
    finally:
        tmp_path.chmod(0o700)
    assert f"{tmp_path / 'record'}: cannot record: Permission denied" in program.err


def test_a_full_disk_ends_the_record_but_not_the_frames(
    start: Start, autopilot: Autopilot, line: PtyLink, tmp_path: Path
) -> None:
    program = start(
        *("--port", line.path, "--autopilot", autopilot.address, "--rate", 50, "--duration", 3),
        *("--record", tmp_path / "record"),
        **full_disk(),
        stdout=subprocess.DEVNULL,
    )
    program.says("frames go on")
    assert program.ends() == 1
    frames = frames_in(line.read())
    assert program.err.count("frames go on") == 1
    assert f"error: {tmp_path / 'record'}: cannot record: File too large" in program.err.splitlines()[-1]
    recorded = frames_in((tmp_path / "record" / "frames.bin").read_bytes())
    assert 0 < len(recorded) < len(frames)
    rows = (tmp_path / "record" / "readings.csv").read_text().splitlines()
    assert {row.count(",") for row in rows} == {len(COLUMNS) - 1}
    run = json.loads((tmp_path / "record" / "run.json").read_bytes())
    assert run["exit_code"] == 1
    assert "File too large" in run["ended"]
    assert run["counters"]["frames"] >= len(frames)


def test_a_full_disk_ends_a_replay_with_an_error(arva: Arva) -> None:
    code, _, err = arva("replay", DATA / "px4.tlog", "--out", "/dev/full")
    assert code == 1
    assert "error: /dev/full: cannot be written: No space left on device" in err


def test_a_key_on_the_link_is_not_recorded(start: Start, keep: Keep, line: PtyLink, tmp_path: Path) -> None:
    """Somebody sets up signing on the link that is recorded."""
    autopilot = keep(PtyLink())
    program = start("--port", line.path, "--autopilot", autopilot.path, "--record", tmp_path, "--timeout", 30)
    program.says("frames to")
    key = list(b"0123456789abcdef" * 2)
    ground = Encoder(255, 190)
    autopilot.write(ground.pack(dialect.MAVLink_setup_signing_message(1, 1, key, 1)) + heartbeat(Encoder(1, 1)))
    program.says("vehicle ardupilotmega")
    program.send(signal.SIGINT)
    assert program.ends() == 130
    assert len(list(TlogReader(tmp_path / "autopilot.tlog"))) == 1
    assert not any(bytes(key) in data for data in contents(tmp_path).values())
    assert json.loads((tmp_path / "run.json").read_text())["counters"]["packets_received"] == 2
