"""A program that is killed leaves a record that says so, whole up to a second before."""

from __future__ import annotations

import csv
import json
import random
import signal
import time
from pathlib import Path

import pytest

from arva_hil.clock import RealClock
from arva_hil.links.pty import PtyLink
from arva_hil.links.tlog import TlogReader
from arva_hil.records.writing import COLUMNS

from .far_ends import Autopilot, Program, Start, frames_in, read_frames

LOST_S = 1.0  # docs/howto/recordings.md


def killed(program: Program, after_s: float) -> int:
    """Kill it after so many seconds; when that was, µs since 1970."""
    clock = RealClock()
    clock.wait(after_s)
    at = time.time_ns() // 1000
    program.send(signal.SIGKILL)
    assert program.ends() == -signal.SIGKILL
    return at


@pytest.mark.parametrize("moment", range(2))
def test_a_frame_every_ten_seconds_and_killed_the_log_is_there_to_a_second_before(
    start: Start, autopilot: Autopilot, line: PtyLink, tmp_path: Path, moment: int
) -> None:
    folder = tmp_path / "record"
    program = start(
        "--port", line.path, "--autopilot", autopilot.address, "--rate", 0.1, "--seed", 7, "--record", folder
    )
    program.says("datum: ")
    at = killed(program, random.Random(moment).uniform(0.5, 2.0))
    run = json.loads((folder / "run.json").read_bytes())
    assert (run["ended"], run["exit_code"], run["seed"]) == (None, None, 7)
    assert run["scenario"]["receiver"]["rate_hz"] == 0.1
    assert {"arva-hil", "python"} <= run["versions"].keys()
    assert run["started"].endswith("Z")
    log = list(TlogReader(str(folder / "autopilot.tlog")))
    assert log[-1].time_us > at - LOST_S * 1e6
    with (folder / "readings.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == COLUMNS
    assert [row[0] for row in rows] == ["0"] * 4
    assert [frame.sequence for frame in frames_in((folder / "frames.bin").read_bytes())] == [0]
    assert (folder / "frames.csv").read_text().count("\n") == 2


@pytest.mark.parametrize("moment", range(2))
def test_frames_and_readings_that_a_killed_program_sent_are_recorded_to_a_second_before(
    start: Start, autopilot: Autopilot, line: PtyLink, tmp_path: Path, moment: int
) -> None:
    folder, rate_hz = tmp_path / "record", 20
    program = start("--port", line.path, "--autopilot", autopilot.address, "--rate", rate_hz, "--record", folder)
    frames = read_frames(line, random.Random(moment).randint(30, 60))
    killed(program, 0.0)
    frames += frames_in(line.read())
    assert json.loads((folder / "run.json").read_bytes())["ended"] is None
    recorded = frames_in((folder / "frames.bin").read_bytes())
    assert recorded == frames[: len(recorded)]
    assert len(recorded) >= len(frames) - LOST_S * rate_hz
    with (folder / "readings.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) >= 4 * (len(frames) - LOST_S * rate_hz)
    assert [int(row["seq"]) for row in rows] == [n // 4 for n in range(len(rows))]
    with (folder / "frames.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert len(table) >= len(frames) - LOST_S * rate_hz
    assert [int(row["seq"]) for row in table] == list(range(len(table)))
    assert all(None not in row.values() and None not in row for row in table)


def test_a_killed_record_is_not_written_over_and_can_be_replayed(
    start: Start, autopilot: Autopilot, line: PtyLink, tmp_path: Path
) -> None:
    folder = tmp_path / "record"
    program = start("--port", line.path, "--autopilot", autopilot.address, "--rate", 20, "--record", folder)
    read_frames(line, 40)
    killed(program, 0.0)
    assert start("--port", "pty", "--autopilot", "pty", "--record", folder).ends() == 2
    assert start("replay", folder / "autopilot.tlog", "--rate", 20, "--out", tmp_path / "again").ends() == 0
    assert frames_in((tmp_path / "again").read_bytes())
