"""The report of runs: what it says is what the record has, and it needs nothing else."""

from __future__ import annotations

import base64
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from arva_hil.config import DEFAULT, parse
from arva_hil.records.exports.tracks import marks
from arva_hil.records.reading import Recording, load
from arva_hil.records.report import page as module
from arva_hil.records.report.facts import errors_m, facts, found_of, merged
from arva_hil.records.report.page import page
from tests.made_records import SILENT, frames, write, write_search, write_team
from tests.said import says

COUNT = 20
SVG = b'<svg xmlns="http://www.w3.org/2000/svg"/>'


@pytest.fixture(autouse=True)
def _pictures_of_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing takes seconds; test_pictures.py looks at the pictures."""

    def drawn(recording: Recording, format: str, *, transparent: bool) -> Iterator[tuple[str, str, bytes]]:
        assert (format, transparent) == ("svg", True)
        yield from ((receiver.name, "map", SVG) for receiver in recording.receivers)

    monkeypatch.setattr(module, "pictures", drawn)


def told(html: str) -> ElementTree.Element:
    return ElementTree.fromstring(html.partition("\n")[2])


def words(html: str) -> str:
    return " ".join(" ".join(told(html).itertext()).split())


def test_the_facts_are_those_of_the_record(tmp_path: Path) -> None:
    found = facts(load(write(tmp_path / "flight", COUNT)))
    assert list(found) == ["What the search found", "What was run", "Frames", "Faults", "Counters"]
    run = found["What was run"]
    assert (run["ended"], run["length"], run["seed"]) == ("finished (exit code 0)", "19.0 s", "1")
    assert run["transmitter 1"] == "20 m north, 5 m east, 0 m down of the datum; strength 1"
    late = [1e3 * made.late_s for made in frames(DEFAULT, COUNT)]
    expected = [np.percentile(late, share) for share in (50, 90, 99, 100)]
    shown = found["Frames"]["lateness"].removesuffix(" ms").split(" / ")
    assert [float(text) for text in shown] == pytest.approx(expected, abs=1e-3)
    assert found["Frames"]["without a pose"] == f"{SILENT} (15.0%)"
    channels = [made.reading.channels[0] for made in frames(DEFAULT, COUNT)[SILENT:]]
    off = [c.d_cm / 100 - float(c.true_range_m or 0) for c in channels]
    assert f"median {np.median(off):+.2f} m" in found["Frames"]["transmitter 1 heard"]
    assert found["Frames"]["transmitter 1 heard"].startswith("in 85.0% of the frames")
    assert found["Faults"] == {"stuck": "2 frames (10.0%)", "drop": "2 frames (10.0%)"}
    assert found["Counters"] == {"frames": "20", "delivered": "20", "worst lateness": "0.004 s"}


def test_the_place_found_is_compared_with_the_truth(tmp_path: Path) -> None:
    recording = load(write(tmp_path / "flight", COUNT))
    assert errors_m(recording) == pytest.approx({0: np.hypot(0.5, 0.25)}, abs=1e-3)
    search = facts(recording)["What the search found"]
    assert search["error"] == "0.56 m from the transmitter, horizontally"
    assert search["on Earth, 95 % inside"] == "1.00 m × 0.44 m, long axis 13°"
    assert (search["time"], search["path"], search["frames"]) == ("22 s", "22 m", "30")


@pytest.mark.parametrize(("autopilot_m", "unknown"), [(2.1, False), (None, True)])
def test_an_accuracy_that_the_autopilot_does_not_report_is_unknown(
    tmp_path: Path, autopilot_m: float | None, unknown: bool
) -> None:
    folder = write(tmp_path / "flight", COUNT, search=False)
    found = {"north": 18.5, "east": 5.25, "covariance": [0.1, 0.0, 0.1], "relative_covariance": [0.04, 0.0, 0.01]}
    found |= {"earth_covariance": [4.0, 0.0, 4.0], "autopilot_sigma_m": autopilot_m, "lat_lon": [46.0, 7.7]}
    recording = load(write_search(folder, COUNT, found=found))
    search = facts(recording)["What the search found"]
    assert search["relative to the drone"] == "± 0.20 m"
    assert search["on Earth, 95 % inside"].startswith("4.90 m × 4.90 m, long axis ")
    (mark, *_) = marks(recording)
    assert "; relative to the drone ± 0.20 m" in mark.about
    for text in (search["on Earth, 95 % inside"], mark.about):
        assert (", or more: the autopilot does not report its accuracy" in text) is unknown


def test_the_error_is_that_to_the_transmitter_searched_for_and_not_to_a_nearer_one(tmp_path: Path) -> None:
    both = parse("transmitters: [{id: 1, ned: [30, 5, 0]}, {id: 2, ned: [20, 5, 0]}]\n", "x")
    assert errors_m(load(write(tmp_path / "flight", 5, both))) == pytest.approx({0: np.hypot(9.5, 0.25)}, abs=1e-3)


def test_victims_have_the_number_of_their_finding(tmp_path: Path) -> None:
    """Not that of the order of probing, in which the file has them: the page and the events count so too."""
    place = {"down": 0.0, "covariance": None, "lat_lon": [46.0124799, 7.7456645], "sure": True}
    victims = [
        {"id": 2, "north": 28.0, "east": 5.5, "time_s": 80.0, **place},
        {"id": 1, "north": 18.0, "east": 5.0, "time_s": 41.0, **place},
    ]
    folder = write(tmp_path / "flight", COUNT, search=False)
    write_search(folder, COUNT, outcome="found", how="2 found in 90 s", wanted=2, victims=victims)
    search = facts(load(folder))["What the search found"]
    assert search["place of victim 1"].startswith("transmitter 1: ")
    assert search["place of victim 2"].startswith("transmitter 2: ")


def test_a_team_has_the_places_of_all_its_drones(tmp_path: Path) -> None:
    recording = load(write_team(tmp_path / "team", COUNT, code=130))
    assert facts(recording)["What the search found"] == {
        "drone-1: ended": "found",
        "drone-2: ended": "interrupted",
        "found": "1 of 2 found",
        "drone-1: place": "transmitter 1: 18.5 m north, 5.2 m east of the take-off point",
        "drone-1: latitude, longitude": "46.0124844, 7.7456678",
        "drone-1: on Earth, 95 % inside": "4.90 m × 4.90 m, long axis 90°, or more: the autopilot does not report "
        "its accuracy",
        "drone-1: error": "0.56 m from the transmitter, horizontally",
        "transmitter 2": "not found",
    }
    assert "1 of 2 found, 0.56 m from the transmitter, the search ended: interrupted, " in words(page([recording]))


def test_all_victims_are_there_and_those_who_are_missed(tmp_path: Path) -> None:
    field = parse("transmitters: [{id: 1, ned: [20, 5, 0]}, {id: 2, ned: [30, 5, 0]}, {id: 3, ned: [9, 9, 0]}]\n", "x")
    folder = write(tmp_path / "flight", COUNT, field, search=False)
    lat_lon = [46.0124799, 7.7456645]
    victims = [
        {"id": 2, "north": 28.0, "east": 5.5, "down": 0.0, "covariance": None, "lat_lon": lat_lon, "sure": True},
        {"id": 1, "north": 18.0, "east": -5.0, "down": 0.0, "covariance": None, "lat_lon": lat_lon, "sure": False},
    ]
    write_search(folder, COUNT, outcome="not found", how="2 found in 90 s", wanted=3, victims=victims)
    recording = load(folder)
    assert found_of(recording) == "1 of 3 found, 1 not sure"
    assert errors_m(recording) == pytest.approx({0: 0.5, 1: 10.0}, abs=1e-3)
    search = facts(recording)["What the search found"]
    assert search["place of victim 1"] == "transmitter 2: 28.0 m north, 5.5 m east of the take-off point"
    assert search["error of victim 1"] == "0.50 m from the transmitter, horizontally"
    assert search["place of victim 2"] == (
        "transmitter 1: 18.0 m north, 5.0 m west of the take-off point; "
        "not sure: the readings contradict the place, or ± relative to the drone is above 0.4 m"
    )
    assert search["transmitter 3"] == "not found"
    verdict = words(page([recording])).partition("What the search found")[0]
    assert "1 of 3 found, 1 not sure, 0.50 m, 10.00 m from the transmitters" in verdict
    assert "exit code" not in verdict


def test_a_page_is_whole_and_asks_for_nothing(tmp_path: Path) -> None:
    html = page([load(write(tmp_path / "flight", COUNT))])
    root = told(html)
    assert html.startswith("<!doctype html>\n")
    assert "script" not in {element.tag for element in root.iter()}
    sources = [element.get("src") or element.get("href") for element in root.iter()]
    assert [source for source in sources if source] == ["data:image/svg+xml;base64," + base64.b64encode(SVG).decode()]
    assert not re.search(r"url\(|@import", html)
    (policy,) = [m.get("content") for m in root.iter("meta") if m.get("http-equiv") == "Content-Security-Policy"]
    assert policy == "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    assert "1 of 1 found, 0.56 m from the transmitter, the run ended: finished, 20 frames" in words(html)


def test_what_happened_is_told_in_the_words_of_the_console(tmp_path: Path) -> None:
    says(
        words(page([load(write(tmp_path / "flight", COUNT))])),
        "datum: 46.0123000, 7.7456000, 1650.00 m AMSL",
        "20.0 s warning no pose: frames have no signal until there is one (the newest is 2.5 s old)",
    )


def test_two_runs_are_side_by_side_and_what_differs_is_marked(tmp_path: Path) -> None:
    html = page([load(write(tmp_path / "one", COUNT)), load(write(tmp_path / "two", 10, search=False))])
    rows = {tr[0].text: tr for tr in told(html).iter("tr") if len(tr) == 3 and tr[0].text}
    assert [cell.text for cell in rows["frames"]][1:] == ["20", "10"]
    assert rows["frames"].get("class") == "differs"
    assert rows["seed"].get("class") is None
    assert [cell.text for cell in rows["place"]][2] is None
    assert "one : 1 of 1 found, 0.56 m" in words(html)


def test_facts_that_only_one_run_has_keep_their_place() -> None:
    assert merged([{"a": {"x": "1", "z": "3"}}, {"a": {"x": "1", "y": "2", "z": "4"}, "b": {"w": "5"}}]) == [
        ("a", [("x", ["1", "1"]), ("y", ["", "2"]), ("z", ["3", "4"])]),
        ("b", [("w", ["", "5"])]),
    ]


def test_records_that_are_cut_empty_or_of_a_search_alone_have_a_page(tmp_path: Path) -> None:
    records = [
        write(tmp_path / "none", 0, search=False),
        write(tmp_path / "killed", 5, ended=False),
        write_search(tmp_path / "search", found={"north": 1.0, "east": 2.0}),
    ]
    assert "the run has not ended, 5 frames" in words(page([load(records[1])]))
    assert "the strategy does not say how sure it is" in words(page([load(records[2])]))
    assert "3 runs" in words(page([load(folder) for folder in records]))


def test_text_from_outside_is_text(tmp_path: Path) -> None:
    folder = write(tmp_path / "<b>", 5)
    evil = "</td><script>alert(1)</script>\u202e\x1b[31m"
    write_search(tmp_path / "search", how=evil, others=[{"id": evil, "nearest_m": 3.0}])
    (folder / "search.json").write_bytes((tmp_path / "search" / "search.json").read_bytes())
    html = page([load(folder)])
    root = told(html)
    assert not list(root.iter("script"))
    assert not list(root.iter("b"))
    assert "\u202e" not in html
    assert "\x1b" not in html
    assert "alert(1)" in words(html)


def test_names_of_folders_and_times_from_outside_are_text(tmp_path: Path) -> None:
    folder = write(tmp_path / "a\u202e", 5, search=False)
    run = json.loads((folder / "run.json").read_text()) | {"started": "2027\u202e\x1b[31m", "scenario": {}}
    (folder / "run.json").write_text(json.dumps(run))
    for receiver in ("\u202e/a", "b/\x1b[31m", "b/c", "b/d"):
        (folder / receiver).mkdir(parents=True)
        (folder / receiver / "readings.csv").write_bytes((folder / "readings.csv").read_bytes()[:-9])
    read = load(folder)
    assert [receiver.name for receiver in read.receivers] == ["b/c", "b/d"]
    assert len(read.notes) == 3
    html = page([read])
    assert "\u202e" not in html
    assert "\x1b" not in html


def test_without_matplotlib_it_has_no_pictures_and_says_how_to_get_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    said = words(page([load(write(tmp_path / "flight", 5))]))
    assert "Pictures need matplotlib: pip install 'arva-hil[plots]'" in said
