"""What --record has written is read back as it was, and what is wrong in it is said with file and line."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from arva_hil.config import DEFAULT, parse
from arva_hil.events.searches import PlaceFound, TransmitterHeard
from arva_hil.model.field import LocalFrame
from arva_hil.records.reading import RecordingError, load
from arva_hil.records.reading import folder as folder_reader
from arva_hil.records.reading.folder import read_receiver
from arva_hil.records.writing.search_log import SearchLog
from arva_hil.search.mission.outcome import SearchStep
from tests.made_records import HOME, SILENT, frames, pose_at, write, write_search


def edited(path: Path, old: str, new: str, count: int = 1) -> Path:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, count))
    return path


# -- what is there ------------------------------------------------------------------------------------------


def test_every_reading_is_read_back_to_the_last_digit(tmp_path: Path) -> None:
    (read,) = load(write(tmp_path / "flight", 30)).receivers
    every = frames(DEFAULT, 30)
    assert len(read) == 30
    assert read.begins.tolist() == list(range(0, 121, 4))
    assert read.sequence.tolist() == list(range(30))
    assert read.time_s.tolist() == [made.instant_s for made in every]
    assert read.late_ms.tolist() == [made.late_s * 1e3 for made in every]
    for n, made in enumerate(every):
        rows = read.rows(n)
        assert read.d_cm[rows].tolist() == [c.d_cm for c in made.reading.channels]
        assert read.delta_deg[rows].tolist() == [c.delta_deg for c in made.reading.channels]
        assert read.zone[rows].tolist() == [int(c.zone) for c in made.reading.channels]
        assert read.id[rows].tolist() == [-1 if c.id is None else c.id for c in made.reading.channels]
        ranges = [np.nan if c.true_range_m is None else c.true_range_m for c in made.reading.channels]
        np.testing.assert_array_equal(read.true_range_m[rows], ranges)
        if n >= SILENT:
            assert read.position[n].tolist() == pose_at(made.instant_s).position.tolist()
            assert read.attitude_deg[n].tolist() == pytest.approx([np.degrees(0.01), np.degrees(-0.02), 30])
            assert read.reported[n].tolist() == read.position[n].tolist()
    assert np.isnan(read.position[:SILENT]).all()
    assert np.isnan(read.boot_ms[:SILENT]).all()
    assert read.with_fault("stuck").tolist() == [n % 7 == 6 for n in range(30)]
    assert read.faults == ("stuck", "drop")


def test_what_was_read_of_one_transmitter(tmp_path: Path) -> None:
    (read,) = load(write(tmp_path / "flight", 30)).receivers
    assert read.ids == (1,)
    d_m, delta, zone, range_m = read.of_transmitter(1)
    assert np.isnan(d_m[:SILENT]).all()
    assert (zone[:SILENT] == 0).all()
    assert np.abs(d_m[SILENT:] - range_m[SILENT:]).max() < 0.6 * range_m[SILENT:].max()
    assert np.isnan(delta[zone != 1]).all()
    assert np.isfinite(delta[zone == 1]).all()
    nothing = read.of_transmitter(7)
    assert np.isnan(nothing[0]).all()


def test_a_record_says_what_was_run_where_and_when(tmp_path: Path) -> None:
    read = load(write(tmp_path / "flight", 30))
    assert read.run is not None
    assert read.run.scenario == DEFAULT
    assert (read.run.ended, read.run.seed) == ("finished", 1)
    assert read.start_utc_s == 1_798_761_602.0
    assert read.span_s == (0.0, 29.0)
    assert read.notes == ()
    (receiver,) = read.receivers
    lla = read.lla(receiver.vehicle, receiver.time_s, receiver.position)
    assert lla is not None
    assert np.isnan(lla[:SILENT]).all()
    back = LocalFrame(*HOME).ned(*lla[SILENT:].T)
    np.testing.assert_allclose(back, receiver.position[SILENT:], atol=1e-6)
    there = read.transmitters("")
    assert there is not None
    assert there.at(0.0).positions.tolist() == [[20.0, 5.0, 0.0]]


def test_events_are_on_the_clock_of_the_frames_and_the_status_is_apart(tmp_path: Path) -> None:
    read = load(write(tmp_path / "flight", 30))
    assert [(event["event"], event["time_s"]) for event in read.events] == [
        ("datum_set", 0.0),
        ("first_frame", 0.0),
        ("pose_found", 3.0),
        ("transmitter_heard", 5.0),
        ("pose_lost", 30.0),
    ]
    assert read.events[3]["by"] == "search"
    assert [round(status["time_s"]) for status in read.status] == list(range(30))
    assert read.status[0]["vehicles"][0]["rates"] == {"ATTITUDE": 50.0, "GLOBAL_POSITION_INT": 49.5}


def test_a_search_beside_it_is_on_the_same_clock_and_lies_where_it_took_off(tmp_path: Path) -> None:
    read = load(write(tmp_path / "flight", 30))
    search = read.search
    assert search is not None
    assert search.start_s == 1.0
    assert (search.how, search.target) == ("found", 1)
    assert search.flying.sum() == 20
    assert np.isfinite(search.d_cm).sum() == 6
    assert search.found is not None
    place = read.of_search([search.found.north, search.found.east, 0.0])
    assert place is not None
    assert place.tolist() == pytest.approx([20.5, 5.25, 0.0], abs=1e-4)


def test_the_ellipse_holds_95_percent_of_the_errors(tmp_path: Path) -> None:
    search = load(write(tmp_path / "flight", 30)).search
    assert search is not None
    assert search.found is not None
    ellipse = search.found.ellipse()
    assert ellipse is not None
    major, minor, bearing = ellipse
    errors = np.random.default_rng(1).multivariate_normal([0, 0], [[0.16, 0.03], [0.03, 0.04]], 20_000)
    along = errors @ [np.cos(bearing), np.sin(bearing)]
    across = errors @ [-np.sin(bearing), np.cos(bearing)]
    assert ((along / major) ** 2 + (across / minor) ** 2 < 1).mean() == pytest.approx(0.95, abs=0.006)
    outline = np.array(search.found.outline())
    assert outline[0].tolist() == outline[-1].tolist()
    assert np.hypot(*(outline - [18.5, 5.25]).T).max() == pytest.approx(major)


def test_the_log_of_a_search_alone_is_a_record_without_receivers(tmp_path: Path) -> None:
    read = load(write_search(tmp_path))
    assert read.run is None
    assert read.receivers == ()
    assert read.search is not None
    assert read.start_utc_s == 1_798_761_603.0
    assert read.span_s == pytest.approx((0.0, 5.8))


def test_the_events_of_a_search_alone_are_in_its_log_on_the_clock_of_its_steps(tmp_path: Path) -> None:
    log = SearchLog(tmp_path, start_s=50.0)
    log.row(SearchStep(0.2, "flying", 0.0, 0.0, -3.0, 0.0, 0.0, 0.0, 0.0, None, None, None))
    log.observe(TransmitterHeard(52.5, 3, 20.0, 1.0, 2.0))
    log.observe(PlaceFound(60.0, 3, 4.0, 5.0, None, True))
    log.close({"started": "2027-01-01T00:00:03.000Z"})
    read = load(tmp_path)
    assert [(event["event"], event["time_s"]) for event in read.events] == [
        ("transmitter_heard", 2.5),
        ("place_found", 10.0),
    ]
    assert read.events[0]["notice"]["text"].startswith("received transmitter 3")


def test_the_events_of_a_search_beside_a_run_are_on_the_clock_of_the_run(tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", 30)
    (folder / "search.jsonl").write_text('{"event": "place_found", "time_s": 10.0}\n')
    assert [event["time_s"] for event in load(folder).events if event["event"] == "place_found"] == [11.0]


def test_several_receivers_each_have_their_own(tmp_path: Path) -> None:
    receivers = "[{name: front, port: pty}, {name: rear, port: pty}]"
    scenario = parse(
        f"spec: 2\ntransmitters: [{{id: 1, enu: [5, 20, 0]}}]\nvehicles: [{{name: alpha, receivers: {receivers}}}]\n",
        "x",
    )
    read = load(write(tmp_path / "flight", 10, scenario, receivers=[("alpha", "front"), ("alpha", "rear")]))
    assert [receiver.name for receiver in read.receivers] == ["alpha/front", "alpha/rear"]
    assert [len(receiver) for receiver in read.receivers] == [10, 10]
    assert read.datum_at("alpha", 0.0) is not None


# -- what is odd, and no mistake ----------------------------------------------------------------------------


def test_a_run_that_was_killed_has_what_was_written_and_its_datum_by_the_events(tmp_path: Path) -> None:
    read = load(write(tmp_path / "flight", 30, ended=False))
    assert read.run is not None
    assert read.run.ended == ""
    assert len(read.receivers[0]) == 30
    datum = read.datum_at("", 10.0)
    assert datum is not None
    assert (datum.lat, datum.lon, datum.alt) == HOME
    assert read.search is not None
    assert read.search.found is None
    assert read.notes == (f"{read.folder}/run.json: the run continues, or was killed: there are no counters",)


def test_a_line_that_is_cut_is_left_out_with_its_frame_and_said_once(tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", 30)
    for name in ("readings.csv", "search.csv", "events.jsonl"):
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[:-9])
    read = load(folder)
    assert len(read.receivers[0]) == 29
    assert len(read.search.time_s) == 29  # type: ignore[union-attr]
    assert [note.rpartition("/")[2] for note in read.notes] == [
        "readings.csv: the last frame is cut, what is before it is used",
        "events.jsonl: the last line is cut, what is before it is used",
        "search.csv: the last line is cut, what is before it is used",
    ]


def test_a_frame_has_the_slots_that_it_had(tmp_path: Path) -> None:
    """A command may change their number."""
    folder = write(tmp_path / "flight", 5)
    lines = (folder / "readings.csv").read_text().splitlines(keepends=True)
    (folder / "readings.csv").write_text("".join(lines[:14] + lines[17:]))
    (read,) = load(folder).receivers
    assert read.begins.tolist() == [0, 4, 8, 12, 13, 17]
    assert read.id[read.rows(3)].tolist() == [1]
    assert read.nearest_zone.tolist() == [0, 0, 0, 1, 1]
    assert read.d_cm[read.rows(4)].tolist() == [c.d_cm for c in frames(DEFAULT, 5)[4].reading.channels]


def test_a_slot_that_is_blank_for_the_moment_hears_nothing(tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", 5)
    lines = (folder / "readings.csv").read_text().splitlines(keepends=True)
    cells = lines[13].split(",")
    cells[12:15] = ["0", "-1", "-1"]
    (folder / "readings.csv").write_text("".join([*lines[:13], ",".join(cells), *lines[14:]]))
    (read,) = load(folder).receivers
    assert np.isnan(read.of_transmitter(1)[0]).tolist() == [True, True, True, True, False]


@pytest.mark.parametrize("count", [0, 1])
def test_a_run_with_no_frame_or_one_is_a_record(tmp_path: Path, count: int) -> None:
    read = load(write(tmp_path / "flight", count, search=False))
    (receiver,) = read.receivers
    assert len(receiver) == count
    assert receiver.of_transmitter(1)[0].shape == (count,)
    assert read.span_s == (0.0, 0.0)


def test_an_empty_file_and_one_of_the_header_alone_have_no_readings(tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", 0, search=False)
    (folder / "readings.csv").write_text("")
    assert len(load(folder).receivers[0]) == 0


def test_a_pose_of_nan_and_infinity_is_no_pose(tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", 6)
    first = pose_at(3.0).position.tolist()
    edited(folder / "readings.csv", f",{first[0]!r},{first[1]!r},", ",nan,inf,")
    (read,) = load(folder).receivers
    assert np.isnan(read.position[3, :2]).all()
    assert np.isnan(load(folder).lla("", read.time_s, read.position)[3]).all()  # type: ignore[index]


def test_a_record_of_an_older_program_has_no_lateness_and_no_events(tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", 6)
    (folder / "events.jsonl").unlink()
    edited(folder / "run.json", '"record": 1,', "")
    rows = [line.rsplit(",", 5)[0] for line in (folder / "readings.csv").read_text().splitlines()]
    (folder / "readings.csv").write_text("\n".join(rows) + "\n")
    read = load(folder)
    assert read.events == ()
    assert np.isnan(read.receivers[0].late_ms).all()
    assert read.receivers[0].faults == ()
    assert read.start_utc_s == 1_798_761_602.0  # by frames.csv


def test_a_flight_of_a_clock_that_was_stepped_has_the_time_of_the_computer(tmp_path: Path) -> None:
    read = load(write(tmp_path / "flight", 6, search=False, epoch_us=0))
    assert read.start_utc_s == 1_798_761_600.0


def test_a_scenario_that_this_program_cannot_read_costs_only_what_needs_it(tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", 6)
    edited(folder / "run.json", '"kappa_eq"', '"kappa_of_tomorrow"')
    read = load(folder)
    assert read.run is not None
    assert read.run.scenario is None
    assert read.transmitters("") is None
    assert len(read.receivers[0]) == 6
    assert "the scenario cannot be read: " in read.notes[0]
    assert "kappa_of_tomorrow" in read.notes[0]


def test_of_too_many_rows_the_first_are_used_in_whole_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("arva_hil.records.reading.folder._MOST_ROWS", 10)
    read = load(write(tmp_path / "flight", 5, search=False))
    assert len(read.receivers[0]) == 2
    assert read.notes == (f"{read.folder}/readings.csv: only the first 10 rows are used",)


# -- what is wrong ------------------------------------------------------------------------------------------


def refused(folder: Path) -> str:
    with pytest.raises(RecordingError) as error:
        load(folder)
    said = str(error.value)
    assert "\n" not in said
    return said.removeprefix(f"{folder}")


def test_what_is_no_record_is_refused(tmp_path: Path) -> None:
    missing = "; name one that --record has written"
    assert refused(tmp_path / "nowhere") == f": no such folder{missing}"
    assert refused(tmp_path) == f": there is no run.json and no search.csv in it{missing}"
    (tmp_path / "flight.tlog").touch()
    assert refused(tmp_path / "flight.tlog") == f": is not a folder{missing}"


@pytest.mark.parametrize("version", ["2", '"next"'])
def test_a_record_of_a_newer_version_is_refused_by_its_version(tmp_path: Path, version: str) -> None:
    folder = write(tmp_path / "flight", 3)
    edited(folder / "run.json", '"record": 1', f'"record": {version}')
    shown = version.replace('"', "'")
    assert refused(folder) == (
        f"/run.json: record: {shown} is newer than this program, which reads up to 1: update arva-hil"
    )


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "seq,time_s",
            "number,time_s",
            "/readings.csv:1: no column seq: this is no table of a record, or an older one",
        ),
        ("\n0,0.0,", "\n0,soon,", "/readings.csv:2: 'soon', expected a number"),
        ("\n0,0.0,", "\nx,0.0,", "/readings.csv:2: 'x', expected a number"),
        (",1,,0,-1,-1,", ",1,,0,-1.5,-1,", "/readings.csv:2: '-1.5', expected a number"),
        (",1,,0,-1,-1,", ",1,,0,-1,70000,", "/readings.csv:2: 70000 is out of range"),
        (",2,,0,-1,-1,", ",3,,0,-1,-1,", "/readings.csv:3: slot 3, expected 1 or 2"),
        ("\n0,0.0,", "\n0,", "/readings.csv:2: 20 cells, expected 21"),
    ],
)
def test_a_wrong_cell_is_named_with_file_and_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    folder = write(tmp_path / "flight", 5)
    edited(folder / "readings.csv", old, new)
    assert refused(folder) == said


@pytest.mark.parametrize("name", ["run.json", "search.json"])
def test_a_json_file_that_is_none_is_named_with_its_line(tmp_path: Path, name: str) -> None:
    folder = write(tmp_path / "flight", 3)
    (folder / name).write_text('{\n  "seed": 1,,\n}\n')
    assert refused(folder).startswith(f"/{name}:2:13: is not valid JSON: ")
    (folder / name).write_text("[]")
    assert refused(folder) == f"/{name}:1: expected a JSON object, found list"


@pytest.mark.parametrize(
    ("line", "said"),
    [("nothing", "is no JSON object: Expecting value"), ('{"event": "x"}', "expected an object with a time_s")],
)
def test_a_wrong_event_is_named_with_its_line(tmp_path: Path, line: str, said: str) -> None:
    folder = write(tmp_path / "flight", 3)
    path = folder / "events.jsonl"
    path.write_text(f'{{"event": "x", "time_s": 1}}\n{line}\n{{"event": "x", "time_s": 1}}\n')
    assert refused(folder) == f"/events.jsonl:2: {said}"


@pytest.mark.parametrize(("most", "notes"), [(3, 0), (2, 1)])
def test_of_too_many_events_the_first_are_used_and_a_note_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int, notes: int
) -> None:
    path = write(tmp_path / "flight", 3, search=False) / "events.jsonl"
    path.write_text("".join(f'{{"event": "e{n}", "time_s": {n}}}\n' for n in range(3)))
    monkeypatch.setattr(folder_reader, "_MOST_EVENTS", most)
    read = load(path.parent)
    assert [event["event"] for event in read.events] == ["e0", "e1", "e2"][:most]
    assert list(read.notes) == [f"{path}: only the first {most} events are used"] * notes


def test_a_wrong_step_of_a_search_is_named_with_its_line(tmp_path: Path) -> None:
    write_search(tmp_path)
    edited(tmp_path / "search.csv", "climbing,0.2,", "climbing,far,")
    assert refused(tmp_path) == "/search.csv:3: 'far', expected a number"


def test_a_file_that_never_ends_is_not_waited_for_and_a_line_without_end_not_kept(tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", 3)
    path = folder / "readings.csv"
    path.write_bytes(b"x" * 200_000)
    assert refused(folder).startswith("/readings.csv:1: a line longer than 65536 bytes")
    path.unlink()
    assert refused(folder) == "/readings.csv: cannot be read: No such file or directory"
    os.mkfifo(path)
    assert refused(folder) == "/readings.csv: is not a regular file"


def test_text_from_outside_cannot_change_a_terminal(tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", 3)
    edited(folder / "readings.csv", "\n0,0.0,", "\n0,\x1b[31m,")
    assert refused(folder) == "/readings.csv:2: '\\x1b[31m', expected a number"


# -- how much -----------------------------------------------------------------------------------------------


def test_a_reading_takes_less_than_a_hundred_bytes(tmp_path: Path) -> None:
    header, *rows = (write(tmp_path / "flight", 2, search=False) / "readings.csv").read_text().splitlines(keepends=True)
    (tmp_path / "readings.csv").write_text(header + "".join(rows[4:]) * 5000)
    read, notes = read_receiver(tmp_path / "readings.csv")
    assert notes == []
    assert len(read) == 5000
    held = {id(a.base if a.base is not None else a): a for a in vars(read).values() if isinstance(a, np.ndarray)}
    each = sum(a.nbytes for a in vars(read).values() if isinstance(a, np.ndarray)) / 20_000
    assert held
    assert each < 100
    assert json.dumps(each)


@pytest.mark.parametrize("name", ["run.json", "search.json"])
@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("1" * 5000, ":1:13: is not valid JSON: a number of 5000 digits, expected 4300 at most"),
        ('"\\ud800"', ":1:14: is not valid JSON: half of a surrogate pair, expected a whole character"),
    ],
)
def test_a_value_that_no_program_writes_is_named_by_its_place(tmp_path: Path, name: str, value: str, said: str) -> None:
    folder = write(tmp_path / "flight", 3)
    text = (folder / name).read_text().lstrip()
    (folder / name).write_text(f'{{"another": {value}, ' + text.lstrip("{"))
    assert refused(folder) == f"/{name}{said}"


@pytest.mark.parametrize("value", ["1" * 5000, '"\\ud800"'])
def test_such_a_value_in_the_events_is_named_by_its_line(tmp_path: Path, value: str) -> None:
    folder = write(tmp_path / "flight", 3)
    edited(folder / "events.jsonl", '{"event"', f'{{"another": {value}, "event"')
    assert refused(folder).startswith("/events.jsonl:1: is no JSON object: ")
