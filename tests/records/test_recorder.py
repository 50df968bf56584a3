"""Records and logs while they are written: what is on the disk, whatever ends the program or fills the disk."""

from __future__ import annotations

import csv
import dataclasses
import functools
import json
import os
import threading
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from arva_hil.cli.search_report import close_log
from arva_hil.clock import StepClock
from arva_hil.events import DatumSet, FrameMade, PacketsReceived, StatusReport
from arva_hil.links.tlog import TlogReader
from arva_hil.mavlink.codec import Encoder, Packet, Parser, dialect
from arva_hil.model.field.rotation import from_euler, to_matrix
from arva_hil.model.receiver import ChannelReading, Pose, Zone
from arva_hil.records.writing import Recorder, RecordError, RecordLayout, layout
from arva_hil.records.writing import growing_files as module
from arva_hil.records.writing.layout import EventLines
from arva_hil.records.writing.search_log import SearchLog
from arva_hil.runtime import worker_thread
from arva_hil.runtime.worker_thread import WorkerThread
from arva_hil.search.mission.outcome import Outcome, SearchStep
from tests.files import rows as table
from tests.made_frames import frame_made
from tests.made_records import EPOCH_US, START_S, write
from tests.waiting import no_file_beyond, until

NAMES = ["autopilot.tlog", "events.jsonl", "frames.bin", "frames.csv", "readings.csv", "run.json"]
STATUS = StatusReport(0.0, [])


def packets(count: int) -> list[Packet]:
    encoder = Encoder(1, 1)
    heartbeat = dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3)
    return Parser().feed(b"".join(encoder.pack(heartbeat) for _ in range(count)))


def made(number: int) -> FrameMade:
    return frame_made(number, ChannelReading(None, Zone.OUTER, -1, -1, None), instant_s=number / 10)


def in_tlog(folder: Path) -> int:
    return len(list(TlogReader(str(folder / "autopilot.tlog"))))


@pytest.mark.parametrize("patient", [False, True])
def test_packets_are_on_the_disk_with_the_next_status_though_no_frame_is_made(tmp_path: Path, patient: bool) -> None:
    clock = StepClock()
    recorder = Recorder(tmp_path, 10**15, clock=clock, patient=patient)
    recorder.observe(PacketsReceived(0.0, "autopilot", packets(3)))
    recorder.observe(STATUS)
    until(lambda: in_tlog(tmp_path) == 3)
    for n in range(1, 5):  # the status comes four times a second
        recorder.observe(PacketsReceived(n / 4, "autopilot", packets(1)))
        clock.wait(n / 4)
        recorder.observe(STATUS)
        until(lambda n=n: in_tlog(tmp_path) == 3 + n)  # type: ignore[misc]
    recorder.close({})


def test_a_disk_that_hangs_holds_a_patient_record_only_until_it_is_broken_off_and_its_end_not_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate, jobs = threading.Event(), 0

    def hanging(*job: object) -> Callable[[], object]:
        nonlocal jobs
        jobs += 1
        return lambda: gate.wait(60)

    monkeypatch.setattr(module, "partial", hanging)
    monkeypatch.setattr(module, "_LAST_S", 0.0)
    monkeypatch.setattr(worker_thread, "_ASK_S", 0.001)
    recorder = Recorder(tmp_path, 10**15, patient=True)
    monkeypatch.setattr(recorder, "_background", WorkerThread("hanging", most_jobs=1))
    closing = functools.partial(recorder._background.close, timeout_s=0.01)
    monkeypatch.setattr(recorder._background, "close", closing)
    signal = iter([False, False, True])
    recorder.broken_off = lambda: next(signal, True)
    monkeypatch.setattr(module, "_FLUSH_S", 0.0)
    for n in range(5):
        recorder.observe(made(n))
    assert jobs > 2
    assert next(signal, None) is None  # it has waited
    recorder.broken_off = lambda: False
    recorder.observe(PacketsReceived(1.0, "autopilot", packets(1)))
    with pytest.raises(RecordError, match="the disk is too slow, the record has"):
        recorder.close({"ended": "finished"})
    assert "the disk is too slow" in json.loads((tmp_path / "run.json").read_bytes())["ended"]
    gate.set()


def test_what_was_made_until_a_replay_is_broken_off_is_recorded_by_a_disk_that_still_has_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_FLUSH_S", 0.0)
    monkeypatch.setattr(worker_thread, "_ASK_S", 0.001)
    recorder, gate = Recorder(tmp_path, 0, patient=True), threading.Event()
    monkeypatch.setattr(recorder, "_background", WorkerThread("busy", most_jobs=1))
    recorder._background.put(lambda: gate.wait(60))

    def broken_off() -> bool:
        """A signal has come. The disk goes on once it was waited for."""
        gate.set()
        return True

    recorder.broken_off = broken_off
    for n in range(5):
        recorder.observe(made(n))
    recorder.close({"ended": "SIGTERM"})
    assert gate.is_set()  # there was no room
    assert recorder.error == ""
    assert (tmp_path / "readings.csv").read_bytes().count(b"\n") == 6


def test_frames_are_written_a_few_times_a_second_and_not_one_by_one(tmp_path: Path) -> None:
    clock = StepClock()
    recorder = Recorder(tmp_path, 0, clock=clock)
    recorder.observe(made(0))
    until(lambda: (tmp_path / "readings.csv").read_bytes().count(b"\n") == 2)
    size = (tmp_path / "readings.csv").stat().st_size
    for n in range(1, 10):
        clock.wait(n / 50)
        recorder.observe(made(n))
    clock.wait(0.25)
    recorder.observe(made(10))
    until(lambda: (tmp_path / "readings.csv").stat().st_size > size)
    assert (tmp_path / "readings.csv").read_bytes().count(b"\n") == 12
    recorder.close({})


def test_from_the_start_run_json_says_what_is_known_and_that_the_run_has_not_ended(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, 0, {"seed": 7})
    assert sorted(os.listdir(tmp_path)) == NAMES
    assert json.loads((tmp_path / "run.json").read_bytes()) == {
        "record": 1,
        "ended": None,
        "exit_code": None,
        "seed": 7,
    }
    recorder.close({"ended": "finished"})
    assert sorted(os.listdir(tmp_path)) == NAMES
    assert json.loads((tmp_path / "run.json").read_bytes()) == {"record": 1, "ended": "finished"}


def test_a_disk_that_is_full_at_the_end_leaves_the_run_json_of_the_start_and_it_is_said(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, 0, {"seed": 7})
    full = pytest.raises(RecordError, match=f"{tmp_path / 'run.json'}: cannot record: File too large")
    with no_file_beyond(200), full:
        recorder.close({"ended": "finished", "padding": "x" * 200})
    assert json.loads((tmp_path / "run.json").read_bytes()) == {
        "record": 1,
        "ended": None,
        "exit_code": None,
        "seed": 7,
    }
    assert sorted(os.listdir(tmp_path)) == NAMES


@pytest.mark.parametrize(("end", "code"), [("finished", 0), ("SIGTERM", 130)])
def test_a_disk_that_does_not_take_the_last_data_is_told_in_run_json_too(tmp_path: Path, end: str, code: int) -> None:
    recorder, why = Recorder(tmp_path, 0), f"{tmp_path}: cannot record: File too large"
    recorder.observe(PacketsReceived(0.0, "autopilot", packets(100)))
    with no_file_beyond(1000), pytest.raises(RecordError, match=why):
        recorder.close({"ended": end, "exit_code": code})
    ended, exit_code = (end, code) if code else (why, 1)
    assert json.loads((tmp_path / "run.json").read_bytes()) == {"record": 1, "ended": ended, "exit_code": exit_code}
    assert in_tlog(tmp_path) == 0


def test_where_run_json_cannot_be_written_there_is_no_record_and_the_folder_can_be_tried_again(
    tmp_path: Path,
) -> None:
    (tmp_path / "run.json.new").mkdir()
    with pytest.raises(RecordError, match="cannot record: Is a directory"):
        Recorder(tmp_path, 0)
    assert os.listdir(tmp_path) == ["run.json.new"]


# -- symlinks --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("leads", ["to a file", "nowhere"])
@pytest.mark.parametrize(
    ("kind", "name"),
    [*(("record", name) for name in NAMES), ("search", "search.csv"), ("search", "search.json")],
)
def test_nothing_is_written_through_a_symlink(tmp_path: Path, kind: str, name: str, leads: str) -> None:
    folder, target = tmp_path / "record", tmp_path / "of somebody"
    folder.mkdir()
    if leads == "to a file":
        target.write_text("mine")
    (folder / name).symlink_to(target)
    with pytest.raises(RecordError, match=rf"holds a {kind} already \({name}\); name another folder"):
        Recorder(folder, 0) if kind == "record" else SearchLog(folder)
    assert os.listdir(folder) == [name]
    assert target.read_text() == "mine" if leads == "to a file" else not target.exists()


def test_a_symlink_made_while_it_records_is_replaced_and_not_followed(tmp_path: Path) -> None:
    folder, target = tmp_path / "record", tmp_path / "of somebody"
    target.write_text("mine")
    recorder = Recorder(folder, 0)
    for name in ("run.json", "run.json.new"):
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(target)
    recorder.close({"ended": "finished"})
    assert target.read_text() == "mine"
    assert json.loads((folder / "run.json").read_bytes()) == {"record": 1, "ended": "finished"}
    assert sorted(os.listdir(folder)) == NAMES


def test_the_folder_itself_may_be_a_symlink(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "record").symlink_to(tmp_path / "disk")
    Recorder(tmp_path / "record", 0).close({})
    assert sorted(os.listdir(tmp_path / "disk")) == NAMES


@pytest.mark.parametrize("name", ["run.json", "Run.JSON", "events.jsonl", "autopilot-2.tlog", "frames.bin"])
def test_a_vehicle_that_is_named_as_a_file_of_the_record_is_refused_by_name(tmp_path: Path, name: str) -> None:
    layout = RecordLayout((("alpha", "r"), (name, "r")), ("one", "two"))
    with pytest.raises(RecordError, match=f"a vehicle is named {name}, as a file of the record: give it another name"):
        Recorder(tmp_path / "record", 0, layout=layout)
    assert not list(tmp_path.iterdir())


# -- events.jsonl of a record: what happened, one JSON object a line -------------------------------------------


def lines(folder: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]


def test_events_are_as_json_gives_them_and_frames_and_packets_are_none(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, 0)
    recorder.observe(DatumSet(1.5, "alpha", 46.0, 7.0, 1650.0, ()))
    recorder.observe(PacketsReceived(1.5, "autopilot", []))
    recorder.close({})
    assert lines(tmp_path) == [
        {
            **{"event": "datum_set", "time_s": 1.5, "vehicle": "alpha", "lat": 46.0, "lon": 7.0, "alt": 1650.0},
            "reason": "",
            "notice": {"level": "info", "text": "datum: 46.0000000, 7.0000000, 1650.00 m AMSL"},
        }
    ]


def test_the_first_frame_says_when_the_time_of_the_frames_begins(tmp_path: Path) -> None:
    first = [event for event in lines(write(tmp_path / "flight", 5)) if event["event"] == "first_frame"]
    assert first == [{"event": "first_frame", "time_s": START_S, "utc": "2027-01-01T00:00:02.000Z"}]
    assert EPOCH_US == 1_798_761_600_000_000


def test_the_status_is_there_once_a_second(tmp_path: Path) -> None:
    status = [event for event in lines(write(tmp_path / "flight", 5)) if event["event"] == "status"]
    assert [round(float(str(one["time_s"]))) for one in status] == [2, 3, 4, 5, 6]
    assert status[0]["vehicles"] == [
        {
            "name": "vehicle",
            "label": "quadrotor 1/1",
            "rates": {"ATTITUDE": 50.0, "GLOBAL_POSITION_INT": 49.5},
            "receivers": [{"name": "receiver", "frames": 1, "dropped": 0}],
        }
    ]


def test_a_vehicle_that_never_stops_talking_does_not_fill_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(layout, "_MOST_BYTES", 1000)
    made = EventLines(0)
    data = b"".join(made.of(DatumSet(float(n), "a", 1.0, 2.0, 3.0, ())) for n in range(100))
    *_, before, last = map(json.loads, data.splitlines())
    assert before["event"] == "datum_set"
    assert last == {"event": "events_left_out", "time_s": before["time_s"] + 1}
    assert len(data) < 1100


# -- the log of a search: one row a step, and how it ended -----------------------------------------------------


COLUMNS = "time_s,phase,north_m,east_m,down_m,heading_deg,v_north,v_east,v_down,id,d_cm,delta_deg,zone"


def row(n: int) -> SearchStep:
    reading = (7, 1234 + n, -15, 1) if n % 5 == 0 else (None, None, None, None)
    return SearchStep(n * 0.2, "flying", 1 / 3 + n, -n / 7, -1.0, 359.9, 0.5, -0.25, 0.0, *reading)


@pytest.mark.parametrize("count", [0, 1, 500])
def test_every_row_is_there_to_the_last_digit(tmp_path: Path, count: int) -> None:
    log = SearchLog(tmp_path / "deep" / "er")
    rows = [row(n) for n in range(count)]
    for one in rows:
        log.row(one)
    log.close({"outcome": "found"})
    assert log.error == ""
    with open(tmp_path / "deep" / "er" / "search.csv", newline="") as file:
        header, *lines = csv.reader(file)
    assert ",".join(header) == COLUMNS
    for line, one in zip(lines, rows, strict=True):
        assert [value == "" for value in line] == [value is None for value in one]
        assert (float(line[2]), float(line[3])) == (one.north_m, one.east_m)
    assert json.loads((tmp_path / "deep" / "er" / "search.json").read_text()) == {"outcome": "found"}


def test_it_may_lie_beside_the_record_of_a_run(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("{}")
    (tmp_path / "readings.csv").write_text("seq\n")
    SearchLog(tmp_path).close({})
    assert (tmp_path / "readings.csv").read_text() == "seq\n"


@pytest.mark.parametrize("name", ["search.csv", "search.json"])
def test_another_search_is_never_overwritten(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("of yesterday")
    with pytest.raises(RecordError, match=rf"{tmp_path}: holds a search already \({name}\); name another folder"):
        SearchLog(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "of yesterday"


def test_a_picture_is_not_drawn_through_a_symlink(tmp_path: Path) -> None:
    (tmp_path / "of somebody").write_text("mine")
    (tmp_path / "search.png").symlink_to(tmp_path / "of somebody")
    log = SearchLog(tmp_path)
    log.row(row(0))
    assert close_log(log, Outcome("found", ()), 0, 0.0) == [
        f"log: {tmp_path / 'search.csv'}, picture: {tmp_path / 'search.png'}"
    ]
    assert (tmp_path / "of somebody").read_text() == "mine"
    assert (tmp_path / "search.png").read_bytes().startswith(b"\x89PNG")
    assert not (tmp_path / "search.png").is_symlink()


def test_rows_are_on_the_disk_soon_whatever_ends_the_program(tmp_path: Path) -> None:
    clock = StepClock()
    log = SearchLog(tmp_path, clock)
    for n in range(5):
        clock.wait(n * 0.25)
        log.row(row(n))
        until(lambda n=n: (tmp_path / "search.csv").read_bytes().count(b"\n") == n + 2)  # type: ignore[misc]
    log.close({})


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(RecordError, match=f"{file}: is no folder; name another one"):
        SearchLog(file)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")  # it is told by the log
def test_what_goes_wrong_is_told_at_the_end_and_holds_nobody_up(tmp_path: Path) -> None:
    log = SearchLog(tmp_path)
    log._files["search.csv"].close()
    for n in range(500):
        log.row(row(n))
    with pytest.raises(RecordError, match=f"{tmp_path}: cannot record: .*closed file"):
        log.close({"outcome": "found"})
    assert "closed file" in log.error
    assert json.loads((tmp_path / "search.json").read_text()) == {"outcome": "found"}


def test_a_folder_that_has_gone_is_told_too(tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    log = SearchLog(folder)
    (folder / "search.csv").unlink()
    folder.rmdir()
    with pytest.raises(RecordError, match="No such file or directory"):
        log.close({})


# -- frames.csv: one row a frame, which other tools load as it is ----------------------------------------------


HEADER = (
    "utc,time_s,seq,north_m,east_m,down_m,roll_deg,pitch_deg,yaw_deg,"
    "id1,zone1,d1_cm,delta1_deg,range1_m,id2,zone2,d2_cm,delta2_deg,range2_m"
)
HEARD = ChannelReading(7, Zone.MID, 1046, -12, 10.25)
EMPTY = ChannelReading(None, Zone.OUTER, -1, -1, 31.5)
POSE = Pose(np.array([1 / 3, -2.0, -3.0]), to_matrix(from_euler(np.radians(10.0), 0.0, np.radians(-45.0))))


def late(number: int, *channels: ChannelReading, pose: Pose | None = POSE, receiver: str = "r") -> FrameMade:
    """Frame `number` of ten a second, made 30 ms after its instant; the run began 2 s after the loop's time 0."""
    values = {"age_s": None if pose is None else 0.1, "reported_pose": pose, "time_s": number / 10 + 2.03}
    return frame_made(number, *channels, instant_s=number / 10, pose=pose, of=("v", receiver), late_s=0.03, **values)


def recorded(folder: Path, *frames: FrameMade, layout: RecordLayout | None = None) -> Path:
    recorder = Recorder(folder, EPOCH_US, layout=layout)
    for frame in frames:
        recorder.observe(frame)
    recorder.close({})
    return folder


def test_each_frame_is_a_row_with_its_moment_its_pose_and_every_slot(tmp_path: Path) -> None:
    recorded(tmp_path, late(0, EMPTY, EMPTY, pose=None), late(1, HEARD, EMPTY))
    header, first, second = (tmp_path / "frames.csv").read_text().splitlines()
    assert header == HEADER
    assert first == "2027-01-01T00:00:02.000Z,0.0,0,,,,,,,,0,-1,-1,31.5,,0,-1,-1,31.5"
    cells = dict(zip(HEADER.split(","), second.split(","), strict=True))
    assert cells["utc"] == "2027-01-01T00:00:02.100Z"
    assert float(cells["north_m"]) == 1 / 3  # as exact as it was computed with
    assert [float(cells[f"{name}_deg"]) for name in ("roll", "pitch", "yaw")] == pytest.approx([10, 0, -45])
    assert [cells[name] for name in HEADER.split(",")[9:14]] == ["7", "1", "1046", "-12", "10.25"]


def test_numpy_and_pandas_load_it_as_numbers(tmp_path: Path) -> None:
    recorded(tmp_path, late(0, EMPTY, EMPTY, pose=None), *(late(n, HEARD, EMPTY) for n in range(1, 20)))
    table = np.genfromtxt(tmp_path / "frames.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert table["d1_cm"].tolist() == [-1] + [1046] * 19
    assert np.isnan(table["north_m"][0])
    assert (table["range1_m"][1:].tolist(), table["time_s"][-1]) == ([10.25] * 19, 1.9)
    pandas = pytest.importorskip("pandas", reason="pandas is not installed; numpy has loaded the file")
    frame = pandas.read_csv(tmp_path / "frames.csv", parse_dates=["utc"])
    assert frame["utc"][0].to_pydatetime() == datetime(2027, 1, 1, 0, 0, 2, tzinfo=UTC)
    assert frame["delta1_deg"].tolist() == [-1] + [-12] * 19
    assert frame["id2"].isna().all()


def test_several_receivers_have_one_each_with_as_many_slots_as_each_has(tmp_path: Path) -> None:
    layout = RecordLayout((("v", "front"), ("v", "rear"), ("v", "silent")))
    recorded(tmp_path, late(0, HEARD, receiver="front"), late(0, HEARD, EMPTY, receiver="rear"), layout=layout)
    front, rear, silent = (
        list(csv.reader((tmp_path / "v" / n / "frames.csv").open())) for n in ("front", "rear", "silent")
    )
    assert (front[0][-1], rear[0][-1], silent) == ("range1_m", "range2_m", [HEADER.split(",")[:9]])
    assert [len(front), len(rear)] == [2, 2]


def test_a_moment_that_no_calendar_has_is_empty_and_the_record_goes_on(tmp_path: Path) -> None:
    """A log may say anything of the time at which it was written."""
    recorder = Recorder(tmp_path, 2**63)
    recorder.observe(dataclasses.replace(late(0, HEARD)))
    recorder.close({})
    (row,) = table(tmp_path / "frames.csv")
    assert (row["utc"], row["d1_cm"]) == ("", "1046")


@pytest.mark.parametrize("name", ["=1+1", "+drop", "-drop", "@drop"])
def test_a_text_is_no_formula_and_a_number_below_zero_stays_a_number(tmp_path: Path, name: str) -> None:
    """Faults that another package adds are named by it."""
    recorded(tmp_path, dataclasses.replace(late(0, EMPTY), faults=(name, "stuck")))
    (row,) = table(tmp_path / "readings.csv")
    assert row["faults"] == f"'{name}+stuck"
    assert (row["d_cm"], row["delta_deg"], row["east_m"]) == ("-1", "-1", "-2.0")
    (row,) = table(tmp_path / "frames.csv")
    assert (row["d1_cm"], row["delta1_deg"], row["east_m"]) == ("-1", "-1", "-2.0")


def test_the_table_keeps_its_columns_when_a_command_changes_the_number_of_slots(tmp_path: Path) -> None:
    recorded(tmp_path, late(0, HEARD, EMPTY), late(1, HEARD), late(2, HEARD, EMPTY, EMPTY))
    table = list(csv.reader((tmp_path / "frames.csv").open()))
    assert {len(row) for row in table} == {len(HEADER.split(","))}
    assert table[2][-5:] == [""] * 5
