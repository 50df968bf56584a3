"""A record on the page: at any time of it what there was to see then, also of records that are torn or strange."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from arva_hil.cli.main import main
from arva_hil.observers.web.viewer import RecordedState
from arva_hil.records.reading import load

MAX = ("demo", "--headless", "--speed", "max")


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("viewer") / "record"
    assert main([*MAX, "--fault", "drop=1@8-9.5", "--record", str(folder)]) == 0
    return folder


@pytest.fixture
def record(flown: Path, tmp_path: Path) -> Path:
    """A copy, to be damaged."""
    folder = tmp_path / "record"
    folder.mkdir()
    for file in flown.iterdir():
        if file.suffix in (".csv", ".json", ".jsonl"):
            (folder / file.name).write_bytes(file.read_bytes())
    return folder


def shown(state: RecordedState, time_s: float) -> dict[str, Any]:
    state.show(time_s)
    made: dict[str, Any] = json.loads(state.document(), parse_constant=lambda name: pytest.fail(name))
    return made


def test_at_every_time_there_is_what_there_was_in_any_order(flown: Path) -> None:
    recording = load(flown)
    state = RecordedState(recording)
    (receiver,) = recording.receivers
    for time_s in (12.0, 20.5, 3.0, 40.0, 0.0, 12.0):
        document = shown(state, time_s)
        points = document["receivers"][0]["points"]
        assert document["receivers"][0]["frames"] == len(points) == int(time_s) + 1
        i = int(time_s)
        d_cm, place = int(receiver.d_cm[receiver.begins[i]]), receiver.position[i].tolist()
        assert points[-1][7][0][2] == d_cm
        if i:
            assert points[-1][1:4] == pytest.approx(place, abs=0.001)
        assert all(event[0] <= time_s for event in document["events"])
        assert bool(document["search"] and document["search"]["found"]) == (time_s == 40.0)
    assert shown(state, 9.0)["receivers"][0]["faults"] == ["drop"]
    assert shown(state, 12.0)["receivers"][0]["faults"] == []
    assert len(shown(state, 8.0)["search"]["hypotheses"]) >= 1
    assert shown(state, 12.0)["transmitters"][0]["place"] == [20.0, 5.0, 0.0]
    assert shown(state, 12.0)["vehicles"][0]["label"] == "quadrotor 1/1"
    texts = [event[2] for event in shown(state, 12.0)["events"]]
    assert "search: going for transmitter 1, 19.2 m away" in texts


def test_at_every_time_a_vehicle_has_its_health_of_then(flown: Path) -> None:
    state = RecordedState(load(flown))
    for time_s, mode in ((12.0, "GUIDED, armed"), (1e9, "LAND, armed"), (12.0, "GUIDED, armed")):
        checks = {name: value for _, name, value, _ in shown(state, time_s)["vehicles"][0]["checks"]}
        assert checks["mode"] == mode
        assert checks["GPS"] == "3D fix, 10 satellites"
        assert float(checks["link"].split()[0]) <= 1.0


def test_a_log_that_cannot_be_read_leaves_out_the_health_alone(record: Path) -> None:
    (record / "autopilot.tlog").mkdir()
    document = shown(RecordedState(load(record)), 12.0)
    assert document["vehicles"][0]["checks"] == []
    assert len(document["receivers"][0]["points"]) == 13


def test_before_and_after_the_record_are_its_ends(flown: Path) -> None:
    state = RecordedState(load(flown))
    assert shown(state, -1e9)["at"] == 0.0
    assert shown(state, float("nan"))["at"] == shown(state, 1e9)["at"] == state.span_s[1]


def test_asked_again_for_the_same_time_little_is_sent(flown: Path) -> None:
    state = RecordedState(load(flown))
    document = shown(state, 12.0)
    state.show(12.0)
    assert len(state.document(document["version"])) < 3000
    assert json.loads(state.document(document["version"]))["receivers"][0]["points"] == []


def test_of_a_long_record_no_more_is_sent_than_a_page_can_draw(record: Path) -> None:
    lines = (record / "readings.csv").read_text().splitlines()
    first = [line.split(",") for line in lines[5:9]]
    rows = [[cells[0], str(n / 50), *cells[2:]] for n in range(20_000) for cells in first]
    (record / "readings.csv").write_text("\n".join([lines[0], *(",".join(cells) for cells in rows)]) + "\n")
    state = RecordedState(load(record))
    points = shown(state, 300.0)["receivers"][0]["points"]
    assert 1000 < len(points) <= 3100
    assert points[-1][0] == 300.0
    assert [point[0] for point in points] == sorted({point[0] for point in points})


def damaged(record: Path, name: str, change: Callable[[str], str]) -> dict[str, Any]:
    (record / name).write_text(change((record / name).read_text()))
    return shown(RecordedState(load(record)), 12.0)


def test_an_empty_run_and_one_reading(record: Path) -> None:
    document = damaged(record, "readings.csv", lambda text: text.splitlines()[0] + "\n")
    assert document["receivers"][0]["points"] == []
    document = damaged(record, "readings.csv", lambda text: text + "0,0.5,,,,,,,,,1,,0,-1,-1,,,,,,0.1\n")
    assert [point[:2] for point in document["receivers"][0]["points"]] == [[0.5, None]]


def test_the_log_of_a_search_alone(record: Path) -> None:
    for name in ("run.json", "readings.csv", "frames.csv", "events.jsonl"):
        (record / name).unlink()
    state = RecordedState(load(record))
    document = shown(state, 1e9)
    assert not document["known"]
    assert document["transmitters"] == []
    assert document["search"]["found"]["place"] == pytest.approx([20.0, 5.0], abs=0.5)
    assert document["receivers"][0]["points"][-1][7][0][0] == 1


@pytest.mark.parametrize(
    "line",
    [
        '{"event": "autopilot_text", "time_s": 1.0, "vehicle": ["a"], "text": {"b": 1}}',
        '{"event": "belief_changed", "time_s": 1.0, "transmitter": 1, "hypotheses": 7, "covariance": "x", "goal": []}',
        '{"event": "status", "time_s": 1.0, "vehicles": [{"name": 5, "rates": [1], "receivers": "x"}]}',
        '{"event": "unheard_of", "time_s": 1.0, "notice": {"level": "panic", "text": "<b>\\u202e"}}',
        '{"event": "place_found", "time_s": 1.0, "by": "search"}',
        '{"event": "transmitter_heard", "time_s": 1.0, "transmitter": [], "distance_m": 1, "north_m": {}, "east_m": 0}',
        '{"event": "link_lost", "time_s": 1.0, "link": {}, "address": 5, "reason": [1]}',
    ],
)
def test_events_that_are_not_as_expected_do_no_harm(record: Path, line: str) -> None:
    document = damaged(record, "events.jsonl", lambda text: line + "\n" + text)
    assert len(document["receivers"][0]["points"]) == 13
    assert len(shown(RecordedState(load(record)), 1.5)["receivers"][0]["points"]) == 2


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["{record}/nowhere"], "nowhere: no such folder; name one that --record has written"),
        (["{record}"], "readings.csv:3: "),
        (["{record}", "--web", "1.2.3.4.5:80"], "1.2.3.4.5:80: the page cannot be served: "),
        (["{record}", "--web", "off"], "off:8457: the page cannot be served: no address of that name"),
        (["{record}", "--scenario", "builtin:x"], "--scenario: a record has its own"),
        (["{record}/run.json"], "run.json"),
    ],
)
def test_what_cannot_be_shown_is_an_error_that_says_so(
    record: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], what: str
) -> None:
    if what.startswith("readings.csv"):
        text = (record / "readings.csv").read_text().splitlines(keepends=True)
        (record / "readings.csv").write_text("".join([text[0], text[1], "nonsense\n", *text[2:]]))
    assert main(["view", *(word.format(record=record) for word in arguments), "--duration", "0.01"]) == 2
    told = capsys.readouterr().err
    assert what in told
    assert "Traceback" not in told
