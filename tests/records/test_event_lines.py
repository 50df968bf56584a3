"""events.jsonl of a record: what happened, one JSON object a line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from arva_hil.events import DatumSet, PacketsReceived
from arva_hil.records.writing import Recorder
from arva_hil.records.writing import layout as module
from arva_hil.records.writing.layout import EventLines
from tests.made_records import EPOCH_US, START_S, write


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
    monkeypatch.setattr(module, "_MOST_BYTES", 1000)
    made = EventLines(0)
    data = b"".join(made.of(DatumSet(float(n), "a", 1.0, 2.0, 3.0, ())) for n in range(100))
    *_, before, last = map(json.loads, data.splitlines())
    assert before["event"] == "datum_set"
    assert last == {"event": "events_left_out", "time_s": before["time_s"] + 1}
    assert len(data) < 1100
