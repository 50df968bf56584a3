"""The record of a run while it goes on: what is on the disk when the program is killed, or the disk is full."""

from __future__ import annotations

import functools
import json
import os
import resource
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from arva_hil.clock import StepClock
from arva_hil.emulator.receivers import frame_of
from arva_hil.events import FrameMade, PacketsReceived, StatusReport
from arva_hil.links.tlog import TlogReader
from arva_hil.mavlink.codec import Encoder, Packet, Parser, dialect
from arva_hil.model.receiver import ChannelReading, Reading, Zone
from arva_hil.records.writing import Recorder, RecordError, RecordLayout
from arva_hil.records.writing import growing_files as module
from arva_hil.records.writing.search_log import SearchLog
from arva_hil.runtime import worker_thread
from arva_hil.runtime.worker_thread import WorkerThread

NAMES = ["autopilot.tlog", "events.jsonl", "frames.bin", "frames.csv", "readings.csv", "run.json"]
STATUS = StatusReport(0.0, [])


class Writes:
    """Lets a test wait until the disk has a file of so many bytes."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def until(self, condition: Callable[[Path], bool]) -> None:
        over = threading.Event()
        for _ in range(6000):
            if condition(self._folder):
                return
            over.wait(0.01)
        raise AssertionError("the deadline passed")


def packets(count: int) -> list[Packet]:
    encoder = Encoder(1, 1)
    heartbeat = dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3)
    return Parser().feed(b"".join(encoder.pack(heartbeat) for _ in range(count)))


def made(number: int) -> FrameMade:
    reading = Reading((ChannelReading(None, Zone.OUTER, -1, -1, None),), False, False)
    frame = frame_of(reading, number % 256)
    return FrameMade(
        number / 10, "vehicle", "receiver", number, number / 10, None, None, None, reading, frame, True, 0.0
    )


def in_tlog(folder: Path) -> int:
    return len(list(TlogReader(str(folder / "autopilot.tlog"))))


@pytest.mark.parametrize("patient", [False, True])
def test_packets_are_on_the_disk_with_the_next_status_though_no_frame_is_made(tmp_path: Path, patient: bool) -> None:
    clock = StepClock()
    recorder = Recorder(tmp_path, 10**15, clock=clock, patient=patient)
    recorder.observe(PacketsReceived(0.0, "autopilot", packets(3)))
    recorder.observe(STATUS)
    Writes(tmp_path).until(lambda folder: in_tlog(folder) == 3)
    for n in range(1, 5):  # the status comes four times a second
        recorder.observe(PacketsReceived(n / 4, "autopilot", packets(1)))
        clock.wait(n / 4)
        recorder.observe(STATUS)
        Writes(tmp_path).until(lambda folder, n=n: in_tlog(folder) == 3 + n)  # type: ignore[misc]
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
    assert json.loads((tmp_path / "run.json").read_bytes())["ended"] == "finished"
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
    Writes(tmp_path).until(lambda folder: (folder / "readings.csv").read_bytes().count(b"\n") == 2)
    size = (tmp_path / "readings.csv").stat().st_size
    for n in range(1, 10):
        clock.wait(n / 50)
        recorder.observe(made(n))
    clock.wait(0.25)
    recorder.observe(made(10))
    Writes(tmp_path).until(lambda folder: (folder / "readings.csv").stat().st_size > size)
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
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200, limits[1]))
    try:
        with pytest.raises(RecordError, match=f"{tmp_path / 'run.json'}: cannot record: File too large"):
            recorder.close({"ended": "finished", "padding": "x" * 200})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert json.loads((tmp_path / "run.json").read_bytes()) == {
        "record": 1,
        "ended": None,
        "exit_code": None,
        "seed": 7,
    }
    assert sorted(os.listdir(tmp_path)) == NAMES


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
