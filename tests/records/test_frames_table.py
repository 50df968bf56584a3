"""frames.csv: one row a frame, which other tools load as it is."""

from __future__ import annotations

import csv
import dataclasses
import io
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from arva_hil.emulator.receivers import frame_of
from arva_hil.events import FrameMade
from arva_hil.model.field.rotation import from_euler, to_matrix
from arva_hil.model.receiver import ChannelReading, Pose, Reading, Zone
from arva_hil.records.writing import Recorder, RecordLayout

HEADER = (
    "utc,time_s,seq,north_m,east_m,down_m,roll_deg,pitch_deg,yaw_deg,"
    "id1,zone1,d1_cm,delta1_deg,range1_m,id2,zone2,d2_cm,delta2_deg,range2_m"
)
HEARD = ChannelReading(7, Zone.MID, 1046, -12, 10.25)
EMPTY = ChannelReading(None, Zone.OUTER, -1, -1, 31.5)
POSE = Pose(np.array([1 / 3, -2.0, -3.0]), to_matrix(from_euler(np.radians(10.0), 0.0, np.radians(-45.0))))
EPOCH_US = 1_798_761_600_000_000  # 2027-01-01T00:00:00Z


def made(number: int, *channels: ChannelReading, pose: Pose | None = POSE, receiver: str = "r") -> FrameMade:
    """Frame `number` of ten a second, made 30 ms after its instant; the run began 2 s after the loop's time 0."""
    reading, instant_s = Reading(channels, False, False), number / 10
    frame = frame_of(reading, number % 256)
    age_s = None if pose is None else 0.1
    return FrameMade(
        instant_s + 2.03, "v", receiver, number, instant_s, None, pose, age_s, reading, frame, True, 0.03, (), pose
    )


def recorded(folder: Path, *frames: FrameMade, layout: RecordLayout | None = None) -> Path:
    recorder = Recorder(folder, EPOCH_US, layout=layout)
    for frame in frames:
        recorder.observe(frame)
    recorder.close({})
    return folder


def test_each_frame_is_a_row_with_its_moment_its_pose_and_every_slot(tmp_path: Path) -> None:
    recorded(tmp_path, made(0, EMPTY, EMPTY, pose=None), made(1, HEARD, EMPTY))
    header, first, second = (tmp_path / "frames.csv").read_text().splitlines()
    assert header == HEADER
    assert first == "2027-01-01T00:00:02.000Z,0.0,0,,,,,,,,0,-1,-1,31.5,,0,-1,-1,31.5"
    cells = dict(zip(HEADER.split(","), second.split(","), strict=True))
    assert cells["utc"] == "2027-01-01T00:00:02.100Z"
    assert float(cells["north_m"]) == 1 / 3  # as exact as it was computed with
    assert [float(cells[f"{name}_deg"]) for name in ("roll", "pitch", "yaw")] == pytest.approx([10, 0, -45])
    assert [cells[name] for name in HEADER.split(",")[9:14]] == ["7", "1", "1046", "-12", "10.25"]


def test_numpy_and_pandas_load_it_as_numbers(tmp_path: Path) -> None:
    recorded(tmp_path, made(0, EMPTY, EMPTY, pose=None), *(made(n, HEARD, EMPTY) for n in range(1, 20)))
    table = np.genfromtxt(tmp_path / "frames.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert table["d1_cm"].tolist() == [-1] + [1046] * 19
    assert np.isnan(table["north_m"][0])
    assert table["range1_m"][1:].tolist() == [10.25] * 19
    assert table["time_s"][-1] == 1.9
    pandas = pytest.importorskip("pandas", reason="pandas is not installed; numpy has loaded the file")
    frame = pandas.read_csv(tmp_path / "frames.csv", parse_dates=["utc"])
    assert frame["utc"][0].to_pydatetime() == datetime(2027, 1, 1, 0, 0, 2, tzinfo=UTC)
    assert frame["delta1_deg"].tolist() == [-1] + [-12] * 19
    assert frame["id2"].isna().all()


def test_several_receivers_have_one_each_with_as_many_slots_as_each_has(tmp_path: Path) -> None:
    layout = RecordLayout((("v", "front"), ("v", "rear"), ("v", "silent")))
    recorded(tmp_path, made(0, HEARD, receiver="front"), made(0, HEARD, EMPTY, receiver="rear"), layout=layout)
    front, rear, silent = (
        list(csv.reader((tmp_path / "v" / n / "frames.csv").open())) for n in ("front", "rear", "silent")
    )
    assert (front[0][-1], rear[0][-1], silent) == ("range1_m", "range2_m", [HEADER.split(",")[:9]])
    assert [len(front), len(rear)] == [2, 2]


def test_a_moment_that_no_calendar_has_is_empty_and_the_record_goes_on(tmp_path: Path) -> None:
    """A log may say anything of the time at which it was written."""
    recorder = Recorder(tmp_path, 2**63)
    recorder.observe(dataclasses.replace(made(0, HEARD)))
    recorder.close({})
    (row,) = csv.DictReader(io.StringIO((tmp_path / "frames.csv").read_text()))
    assert (row["utc"], row["d1_cm"]) == ("", "1046")


@pytest.mark.parametrize("name", ["=1+1", "+drop", "-drop", "@drop"])
def test_a_text_is_no_formula_and_a_number_below_zero_stays_a_number(tmp_path: Path, name: str) -> None:
    """Faults that another package adds are named by it."""
    recorded(tmp_path, dataclasses.replace(made(0, EMPTY), faults=(name, "stuck")))
    (row,) = csv.DictReader(io.StringIO((tmp_path / "readings.csv").read_text()))
    assert row["faults"] == f"'{name}+stuck"
    assert (row["d_cm"], row["delta_deg"], row["east_m"]) == ("-1", "-1", "-2.0")
    (row,) = csv.DictReader(io.StringIO((tmp_path / "frames.csv").read_text()))
    assert (row["d1_cm"], row["delta1_deg"], row["east_m"]) == ("-1", "-1", "-2.0")


def test_the_table_keeps_its_columns_when_a_command_changes_the_number_of_slots(tmp_path: Path) -> None:
    recorded(tmp_path, made(0, HEARD, EMPTY), made(1, HEARD), made(2, HEARD, EMPTY, EMPTY))
    table = list(csv.reader((tmp_path / "frames.csv").open()))
    assert {len(row) for row in table} == {len(HEADER.split(","))}
    assert table[2][-5:] == [""] * 5
