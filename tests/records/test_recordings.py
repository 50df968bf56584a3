"""What --record has written is read back as it was, and what is wrong in it is said with file and line."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from arva_hil.config import DEFAULT, parse
from arva_hil.events.searches import PlaceFound, TransmitterHeard
from arva_hil.links.tlog import tlog_record
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.model.field import LocalFrame
from arva_hil.records.reading import Recording, RecordingError, load
from arva_hil.records.reading import folder as folder_reader
from arva_hil.records.reading.folder import read_receiver
from arva_hil.records.reading.streams import streams
from arva_hil.records.received import KeptBytes
from arva_hil.records.report.facts import facts
from arva_hil.records.writing.search_log import SearchLog
from arva_hil.search.mission.outcome import SearchStep
from tests.every import every
from tests.files import written
from tests.made_records import EPOCH_US, HOME, SILENT, frames, pose_at, write, write_search


def edited(path: Path, old: str, new: str, count: int = 1) -> Path:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, count))
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The record of a flight of 30 frames and its search."""
    return write(tmp_path / "flight", 30)


@pytest.fixture
def read(folder: Path) -> Recording:
    return load(folder)


# -- what is there ------------------------------------------------------------------------------------------


def test_every_reading_is_read_back_to_the_last_digit(read: Recording) -> None:
    (receiver,) = read.receivers
    every = frames(DEFAULT, 30)
    assert (len(receiver), receiver.begins.tolist()) == (30, list(range(0, 121, 4)))
    assert receiver.sequence.tolist() == list(range(30))
    assert receiver.time_s.tolist() == [made.instant_s for made in every]
    assert receiver.late_ms.tolist() == [made.late_s * 1e3 for made in every]
    for n, made in enumerate(every):
        rows = receiver.rows(n)
        assert receiver.d_cm[rows].tolist() == [c.d_cm for c in made.reading.channels]
        assert receiver.delta_deg[rows].tolist() == [c.delta_deg for c in made.reading.channels]
        assert receiver.zone[rows].tolist() == [int(c.zone) for c in made.reading.channels]
        assert receiver.id[rows].tolist() == [-1 if c.id is None else c.id for c in made.reading.channels]
        ranges = [np.nan if c.true_range_m is None else c.true_range_m for c in made.reading.channels]
        np.testing.assert_array_equal(receiver.true_range_m[rows], ranges)
        if n >= SILENT:
            assert receiver.position[n].tolist() == pose_at(made.instant_s).position.tolist()
            assert receiver.attitude_deg[n].tolist() == pytest.approx([np.degrees(0.01), np.degrees(-0.02), 30])
            assert receiver.reported[n].tolist() == receiver.position[n].tolist()
    assert np.isnan(receiver.position[:SILENT]).all()
    assert np.isnan(receiver.boot_ms[:SILENT]).all()
    assert receiver.with_fault("stuck").tolist() == [n % 7 == 6 for n in range(30)]
    assert receiver.faults == ("stuck", "drop")


def test_what_was_read_of_one_transmitter(read: Recording) -> None:
    (receiver,) = read.receivers
    assert receiver.ids == (1,)
    d_m, delta, zone, range_m = receiver.of_transmitter(1)
    assert np.isnan(d_m[:SILENT]).all()
    assert (zone[:SILENT] == 0).all()
    assert np.abs(d_m[SILENT:] - range_m[SILENT:]).max() < 0.6 * range_m[SILENT:].max()
    assert np.isnan(delta[zone != 1]).all()
    assert np.isfinite(delta[zone == 1]).all()
    assert np.isnan(receiver.of_transmitter(7)[0]).all()


def test_a_record_says_what_was_run_where_and_when(read: Recording) -> None:
    assert read.run.scenario == DEFAULT
    assert read.run.ended == "finished"
    assert (read.start_utc_s, read.span_s, read.notes) == (1_798_761_602.0, (0.0, 29.0), ())
    (receiver,) = read.receivers
    lla = read.lla(receiver.vehicle, receiver.time_s, receiver.position)
    assert np.isnan(lla[:SILENT]).all()
    back = LocalFrame(*HOME).ned(*lla[SILENT:].T)
    np.testing.assert_allclose(back, receiver.position[SILENT:], atol=1e-6)
    assert read.transmitters("").positions.tolist() == [[20.0, 5.0, 0.0]]


def test_events_are_on_the_clock_of_the_frames_and_the_status_is_apart(read: Recording) -> None:
    assert [(event["event"], event["time_s"]) for event in read.events] == [
        ("datum_set", 0.0),
        ("first_frame", 0.0),
        ("take_off_point", 1.0),
        ("pose_found", 3.0),
        ("transmitter_heard", 5.0),
        ("place_found", pytest.approx(5.8)),
        ("pose_lost", 30.0),
    ]
    assert read.events[4]["by"] == "search"
    assert [round(status.time_s) for status in read.status] == list(range(30))
    assert read.status[0].vehicles[0].rates == {"ATTITUDE": 50.0, "GLOBAL_POSITION_INT": 49.5}


def test_a_search_beside_it_is_on_the_same_clock_and_lies_where_it_took_off(read: Recording) -> None:
    search = read.search
    assert search.start_s == 1.0
    assert (search.how, search.found and search.found.id) == ("found", 1)
    assert np.isfinite(search.d_cm).sum() == 6
    place = read.of_search([search.found.north, search.found.east, 0.0])
    assert place.tolist() == pytest.approx([20.5, 5.25, 0.0], abs=1e-4)


def test_the_ellipse_holds_95_percent_of_the_errors(read: Recording) -> None:
    search = read.search
    major, minor, bearing = search.found.ellipse()
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
    assert (read.start_utc_s, read.span_s) == (1_798_761_603.0, pytest.approx((0.0, 5.8)))


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


def test_the_events_of_a_search_beside_a_run_are_on_the_clock_of_the_run(folder: Path) -> None:
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
    assert (read.run.ended, len(read.receivers[0])) == ("", 30)
    datum = read.datum_at("", 10.0)
    assert (datum.lat, datum.lon, datum.alt) == HOME
    assert read.search.found is None
    assert read.notes == (f"{read.folder}/run.json: the run continues, or was killed: there are no counters",)


def test_a_line_that_is_cut_is_left_out_with_its_frame_and_said_once(folder: Path) -> None:
    for name in ("readings.csv", "search.csv", "events.jsonl"):
        (folder / name).write_bytes((folder / name).read_bytes()[:-9])
    read = load(folder)
    assert len(read.receivers[0]) == 29
    assert len(read.search.time_s) == 29  # type: ignore[union-attr]
    assert [note.rpartition("/")[2] for note in read.notes] == [
        "readings.csv: the last frame is cut, what is before it is used",
        "events.jsonl: the last line is cut, what is before it is used",
        "search.csv: the last line is cut, what is before it is used",
    ]


def test_a_fault_of_the_frame_that_is_left_out_is_none_of_the_record(folder: Path) -> None:
    header, *rows = (folder / "readings.csv").read_text().splitlines(keepends=True)
    (folder / "readings.csv").write_text(header + "".join(rows[6 * 4 : 7 * 4]) + rows[7 * 4][:-9])
    (receiver,) = (read := load(folder)).receivers
    assert (len(receiver), receiver.faults) == (0, ())
    assert "Faults" not in facts(read)


def test_a_frame_has_the_slots_that_it_had(folder: Path) -> None:
    """A command may change their number."""
    lines = (folder / "readings.csv").read_text().splitlines(keepends=True)
    (folder / "readings.csv").write_text("".join(lines[:14] + lines[17:]))
    (read,) = load(folder).receivers
    assert (read.begins.tolist()[:6], read.id[read.rows(3)].tolist()) == ([0, 4, 8, 12, 13, 17], [1])
    assert read.nearest_zone.tolist()[:5] == [0, 0, 0, 1, 1]
    assert read.d_cm[read.rows(4)].tolist() == [c.d_cm for c in frames(DEFAULT, 5)[4].reading.channels]


def test_a_slot_that_is_blank_for_the_moment_hears_nothing(folder: Path) -> None:
    lines = (folder / "readings.csv").read_text().splitlines(keepends=True)
    cells = lines[13].split(",")
    cells[12:15] = ["0", "-1", "-1"]
    (folder / "readings.csv").write_text("".join([*lines[:13], ",".join(cells), *lines[14:]]))
    (read,) = load(folder).receivers
    assert np.isnan(read.of_transmitter(1)[0]).tolist()[:5] == [True, True, True, True, False]


@pytest.mark.parametrize("count", [0, 1])
def test_a_run_with_no_frame_or_one_is_a_record(tmp_path: Path, count: int) -> None:
    read = load(write(tmp_path / "flight", count, search=False))
    (receiver,) = read.receivers
    assert (len(receiver), receiver.of_transmitter(1)[0].shape) == (count, (count,))
    assert read.span_s == (0.0, 0.0)


def test_an_empty_file_has_no_readings(folder: Path) -> None:
    (folder / "readings.csv").write_text("")
    assert len(load(folder).receivers[0]) == 0


def test_a_pose_of_nan_and_infinity_is_no_pose(folder: Path) -> None:
    first = pose_at(3.0).position.tolist()
    edited(folder / "readings.csv", f",{first[0]!r},{first[1]!r},", ",nan,inf,")
    (read,) = load(folder).receivers
    assert np.isnan(read.position[3, :2]).all()
    assert np.isnan(load(folder).lla("", read.time_s, read.position)[3]).all()  # type: ignore[index]


def test_a_flight_of_a_clock_that_was_stepped_has_the_time_of_the_computer(tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", 6, search=False, epoch_us=0)
    assert load(folder).start_utc_s == 1_798_761_600.0
    assert (folder / "frames.csv").read_text().splitlines()[1].startswith("2027-01-01T00:00:02.000Z,")


def test_a_scenario_that_this_program_cannot_read_costs_only_what_needs_it(folder: Path) -> None:
    edited(folder / "run.json", '"kappa_eq"', '"kappa_of_tomorrow"')
    read = load(folder)
    assert read.run.scenario is None
    assert read.transmitters("") is None
    assert len(read.receivers[0]) == 30
    assert "the scenario cannot be read: " in read.notes[0]
    assert "kappa_of_tomorrow" in read.notes[0]


def test_of_too_many_rows_the_first_are_used_in_whole_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("arva_hil.records.reading.folder._MOST_ROWS", 10)
    read = load(write(tmp_path / "flight", 5, search=False))
    assert len(read.receivers[0]) == 2
    assert read.notes == (f"{read.folder}/readings.csv: only the first 10 rows are used",)


# -- what is wrong ------------------------------------------------------------------------------------------


ODD = ("1" * 5000, '"\\ud800"')  # values that no program writes
LONG = "Exceeds the limit (4300"
HALF = "half of a surrogate pair, expected a whole character"


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
    too_long = refused(tmp_path / ("x" * 300))
    assert too_long in (": cannot be read: File name too long", f": no such folder{missing}")  # by Python's version


@pytest.mark.parametrize(
    ("module", "limit", "most", "said"),
    [
        ("lines", "_LARGEST_OBJECT", 100, "/run.json: is larger than 100 bytes: this is no file of a record"),
        ("folder", "_MOST_FAULTS", 0, "/readings.csv:26: more than 0 different sets of faults"),
        ("search", "_MOST_PHASES", 1, "/search.csv:7: more than 1 kinds of phases"),
    ],
)
def test_a_file_that_would_fill_the_memory_is_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch, module: str, limit: str, most: int, said: str
) -> None:
    monkeypatch.setattr(f"arva_hil.records.reading.{module}.{limit}", most)
    assert refused(folder) == said


def test_a_cell_without_an_end_is_no_line_of_csv(folder: Path) -> None:
    with open(folder / "readings.csv", "a") as file:
        file.write('"' + 4 * (60_000 * "1" + "\n"))
    assert "is no line of CSV: " in refused(folder)


@pytest.mark.parametrize("name", ["readings.csv", "search.csv"])
def test_a_first_line_that_is_no_line_of_csv_is_named(folder: Path, name: str) -> None:
    edited(folder / name, "time_s,", "time\r_s,")
    assert refused(folder).startswith(f"/{name}:1: is no line of CSV: ")


NEWER = "is newer than this program, which reads up to 1: update arva-hil"


@every(
    "name, old, new, said",
    [
        (
            "readings.csv",
            "seq,time_s",
            "number,time_s",
            "/readings.csv:1: no column seq: this is no table of a record",
        ),
        ("readings.csv", "\n0,0.0,", "\n0,soon,", "/readings.csv:2: 'soon', expected a number of seconds"),
        *[
            ("readings.csv", "\n0,0.0,", f"\n0,{time},", f"/readings.csv:2: '{time}', expected a number of seconds")
            for time in ("", "nan", "-inf", "1e300")
        ],
        ("search.csv", "\n0.0,", "\n,", "/search.csv:2: '', expected a number of seconds"),
        ("readings.csv", ",1,,0,-1,-1,", ",1,,-1,-1,-1,", "/readings.csv:2: -1 is out of range"),
        ("readings.csv", "\n0,0.0,", "\nx,0.0,", "/readings.csv:2: 'x', expected a number"),
        ("readings.csv", ",1,,0,-1,-1,", ",1,,0,-1.5,-1,", "/readings.csv:2: '-1.5', expected a number"),
        ("readings.csv", ",1,,0,-1,-1,", ",1,,0,-1,70000,", "/readings.csv:2: 70000 is out of range"),
        ("readings.csv", ",2,,0,-1,-1,", ",3,,0,-1,-1,", "/readings.csv:3: slot 3, expected 1 or 2"),
        ("readings.csv", "\n0,0.0,", "\n0,", "/readings.csv:2: 20 cells, expected 21"),
        ("readings.csv", "\n0,0.0,", "\n0,\x1b[31m,", "/readings.csv:2: '\\x1b[31m', expected a number"),
        ("search.csv", "climbing,0.2,", "climbing,far,", "/search.csv:3: 'far', expected a number"),
        ("run.json", '"record": 1', '"record": 2', f"/run.json: record: 2 {NEWER}"),
        ("run.json", '"record": 1', '"record": "next"', f"/run.json: record: 'next' {NEWER}"),
        ("events.jsonl", '{"event"', 'nothing\n{"event"', "/events.jsonl:1: is no JSON object: Expecting value"),
        ("events.jsonl", '{"event"', '{"event": "x"}\n{"event"', "/events.jsonl:1: expected an object with a time_s"),
        *[
            ("events.jsonl", '{"event"', f'{{"a": {value}, "event"', "/events.jsonl:1: is no JSON object: ")
            for value in ODD
        ],
    ],
)
def test_what_is_wrong_is_named_with_file_and_line(folder: Path, name: str, old: str, new: str, said: str) -> None:
    before = (folder / name).read_text()
    edited(folder / name, old, new)
    assert refused(folder).startswith(said)
    (folder / name).write_text(before)


@pytest.mark.parametrize("name", ["run.json", "search.json"])
def test_a_json_file_that_is_none_is_named_with_its_line(folder: Path, name: str) -> None:
    before = (folder / name).read_text().lstrip()
    for text, said in {
        '{\n  "seed": 1,,\n}\n': ":2:13: is not valid JSON: ",
        "[]": ":1: expected a JSON object, found list",
        f'{{"another": {ODD[0]}, {before[1:]}': f": is not valid JSON: {LONG}",
        f'{{"another": {ODD[1]}, {before[1:]}': f":1:14: is not valid JSON: {HALF}",
    }.items():
        (folder / name).write_text(text)
        assert refused(folder).startswith(f"/{name}{said}")


@pytest.mark.parametrize(("most", "notes"), [(3, 0), (2, 1)])
def test_of_too_many_events_the_first_are_used_and_a_note_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int, notes: int
) -> None:
    path = written(
        write(tmp_path / "flight", 3, search=False) / "events.jsonl",
        "".join(f'{{"event": "e{n}", "time_s": {n}}}\n' for n in range(3)),
    )
    monkeypatch.setattr(folder_reader, "_MOST_EVENTS", most)
    read = load(path.parent)
    assert [event["event"] for event in read.events] == ["e0", "e1", "e2"][:most]
    assert list(read.notes) == [f"{path}: only the first {most} events are used"] * notes


def test_a_file_that_never_ends_is_not_waited_for_and_a_line_without_end_not_kept(folder: Path) -> None:
    path = written(folder / "readings.csv", b"x" * 200_000)
    assert refused(folder).startswith("/readings.csv:1: a line longer than 65536 bytes")
    path.unlink()
    assert refused(folder) == "/readings.csv: cannot be read: No such file or directory"
    os.mkfifo(path)
    assert refused(folder) == "/readings.csv: is not a regular file"


@every(
    "row, said",
    [
        ("1,1000000000000000", "1000000000000000 bytes, expected 0 to 16777216"),
        ("1,-1", "-1 bytes, expected 0 to 16777216"),
        (f"{'9' * 400},1", f"{'9' * 40} is out of range"),
        (f"1,{'9' * 400}", f"{'9' * 40} is out of range"),
    ],
)
def test_a_chunk_with_an_impossible_size_or_time_is_refused(tmp_path: Path, row: str, said: str) -> None:
    (tmp_path / "frames.bin").write_bytes(b"abc")
    path = written(tmp_path / "chunks.csv", f"utc_us,bytes\n1,1\n{row}\n")
    with pytest.raises(RecordingError) as error:
        list(KeptBytes.of(tmp_path))
    assert str(error.value) == f"{path}:3: {said}"


# -- how much -----------------------------------------------------------------------------------------------


def test_a_reading_takes_less_than_a_hundred_bytes(tmp_path: Path) -> None:
    header, *rows = (write(tmp_path / "flight", 2, search=False) / "readings.csv").read_text().splitlines(keepends=True)
    (tmp_path / "readings.csv").write_text(header + "".join(rows[4:]) * 5000)
    read, notes = read_receiver(tmp_path / "readings.csv")
    assert notes == []
    assert len(read) == 5000
    assert 10 < sum(a.nbytes for a in vars(read).values() if isinstance(a, np.ndarray)) / 20_000 < 100


# -- the rates of a vehicle's messages: those of its own packets in the log of the link ------------------------


ATTITUDE = dialect.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 0)


def recorded(folder: Path, *strangers: tuple[int, int]) -> Path:
    """A record of vehicle 1/1 whose log has the same message once from every system and component."""
    senders = [Encoder(*ids) for ids in ((1, 1), *strangers)]
    log = (tlog_record(EPOCH_US + 2_500_000, sender.pack(ATTITUDE)) for sender in senders)
    (write(folder, 3, search=False) / "autopilot.tlog").write_bytes(b"".join(log))
    return folder


@pytest.mark.parametrize("stranger", [(1, 0), (1, 2), (0, 1), (2, 1), (2, 2)])
def test_packets_of_another_vehicle_or_component_are_not_counted(tmp_path: Path, stranger: tuple[int, int]) -> None:
    (stream,) = streams(load(recorded(tmp_path / "flight", stranger)))
    assert stream.hz.tolist() == [1.0]


def test_a_small_log_of_many_messages_over_many_days_does_not_fill_the_memory(tmp_path: Path) -> None:
    folder, raw = recorded(tmp_path / "flight"), bytearray(Encoder(1, 1).pack(ATTITUDE))
    log = bytearray()
    for n in range(200):
        raw[7:10] = (10_000 + n).to_bytes(3, "little")
        log += tlog_record(EPOCH_US + 5000 * 1_000_000 * n, raw)
    (folder / "autopilot.tlog").write_bytes(log)
    assert streams(load(folder)) == []


def test_a_log_with_a_name_that_no_file_can_have_is_not_there(tmp_path: Path) -> None:
    folder = recorded(tmp_path / "flight")
    edited(folder / "run.json", '"record": 1,', f'"record": 1, "tlog": "{300 * "x"}",')
    assert streams(load(folder)) == []


@pytest.mark.parametrize("missing", ["system", "component"])
def test_all_packets_are_counted_if_the_record_does_not_say_whose_they_are(tmp_path: Path, missing: str) -> None:
    folder = recorded(tmp_path / "flight", (1, 0), (2, 1))
    run = json.loads((folder / "run.json").read_text())
    del run["vehicle"][missing]
    (folder / "run.json").write_text(json.dumps(run))
    (stream,) = streams(load(folder))
    assert stream.hz.tolist() == [3.0]
