"""`arva-hil demo`: vehicle, receiver and search in one program; here also what the search makes of hard scenarios."""

from __future__ import annotations

import json
import re
import signal
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from arva_hil.cli import demo as command
from arva_hil.cli.demo import Pace
from arva_hil.clock import StepClock
from arva_hil.search.flight.client import SearchClient
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.simulated import closed_loop
from tests.files import rows as table
from tests.files import written
from tests.said import says

from .far_ends import Arva, Start, full_disk
from .flown import demo

CONFIGS = Path(__file__).parent.parent.parent / "configs"
MAX = ("demo", "--speed", "max", "--headless")

pytestmark = pytest.mark.undrawn  # but for the flight of flown.py


def error_m(err: str) -> float:
    """How far from the transmitter it was reported, m."""
    return errors_m(err, "the place")[0]


def errors_m(err: str, of: str) -> list[float]:
    """The errors of something, m; less than 1 cm is 0."""
    found = re.findall(rf"^error of {of}: (?:([\d.]+) m|less than 1 cm)$", err, re.MULTILINE)
    assert found, err
    assert "0.00" not in found
    return [float(metres or 0) for metres in found]


def scenario(folder: Path, *transmitters: tuple[int, float, float]) -> Path:
    """A file with transmitters 1 m deep: id, north, east."""
    path = folder / "scenario.yaml"
    lines = [f"  - {{id: {id_}, ned: [{north}, {east}, 1.0]}}" for id_, north, east in transmitters]
    path.write_text("transmitters:\n" + "\n".join(lines) + "\n")
    return path


def test_it_finds_the_transmitter_and_lands(tmp_path_factory: pytest.TempPathFactory) -> None:
    code, out, err, record = demo(tmp_path_factory)
    assert (code, out) == (0, "")
    assert error_m(err) < 1.0
    assert errors_m(err, "the landing")[0] < 1.0
    assert re.search(
        r"^found transmitter 1: (19|20)\.\d m north, [45]\.\d m east of the take-off point", err, re.MULTILINE
    )
    assert "search: found; landing" in err
    run, search = (json.loads((record / name).read_text()) for name in ("run.json", "search.json"))
    assert (run["ended"], search["outcome"], search["exit_code"]) == ("finished", "found", 0)
    rows = table(record / "search.csv")
    assert rows[-1]["phase"] == "landing"
    assert 40 < float(rows[-1]["time_s"]) < 55, "README says within 60 s, and the program starts and ends in a few"
    assert abs(float(rows[-1]["down_m"])) < 0.2
    assert (record / "search.png").stat().st_size > 10_000


def test_the_format_and_an_error_of_the_gps_are_chosen(
    arva: Arva, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    hint = "the GPS of this flight had no error; --gps-noise 1.5 flies with one"
    assert hint in demo(tmp_path_factory).err
    assert "; less than 10 cm from the drone ± " in demo(tmp_path_factory).err
    near = scenario(tmp_path, (1, 6.0, 3.0))
    record = tmp_path / "record"
    err = arva(*MAX, "--format", "text", "--gps-noise", 0.5, "--scenario", near, "--record", record).err
    assert hint not in err
    assert 0.1 < error_m(err) < 2.0
    assert "\nfound a transmitter: " in err  # this format has no ids
    assert re.search(r"of the take-off point; .* the drone ± (0\.\d m|\d cm)", err)  # by the check of the readings
    unknown = "or more: the autopilot does not report its accuracy"
    assert re.search(rf"position: .* ± 2\.\d m on Earth, {unknown}", err)
    assert unknown in arva("report", record, "--out", "-").out
    assert unknown in arva("export", record, "--format", "kml", "--out", "-").out
    events = [json.loads(line) for line in (record / "events.jsonl").read_text().splitlines()]
    (found,) = [one for one in events if one["event"] == "place_found"]
    assert found["autopilot_sigma_m"] is None


def test_at_full_speed_it_is_repeatable(arva: Arva, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    """As far as it is flown again."""
    arva(*MAX, "--limit", 8, "--record", tmp_path, code=1)
    before = demo(tmp_path_factory).record
    flown = (tmp_path / "search.csv").read_text().partition("landing")[0].splitlines()[:-2]  # it stops before it lands
    assert len(flown) > 40
    assert (before / "search.csv").read_text().splitlines()[: len(flown)] == flown
    for file in ("frames.bin", "autopilot.tlog"):
        half = (tmp_path / file).stat().st_size // 2
        assert (before / file).read_bytes()[:half] == (tmp_path / file).read_bytes()[:half]


def test_two_victims_are_found_one_after_the_other_and_listed(arva: Arva, tmp_path: Path) -> None:
    two = scenario(tmp_path, (7, 6.0, -2.0), (8, -5.0, 5.0))
    err = arva(*MAX, "--scenario", two, "--victims", 2, "--max-speed", 3, "--record", tmp_path / "record").err
    lines = err.splitlines()
    at = lines.index("found 2 of 2")
    assert lines[at + 1] == "order of probing, the surest place first:"
    places = [
        re.match(r"([12])\. transmitter ([78]): .* m below the take-off point, marked by the receiver", line)
        for line in (lines[at + 2], lines[at + 4])
    ]
    assert [place and place[1] for place in places] == ["1", "2"]
    assert max(*errors_m(err, "transmitter 7"), *errors_m(err, "transmitter 8")) < 1.0
    said = json.loads((tmp_path / "record" / "search.json").read_text())
    assert (said["outcome"], said["wanted"], said["others"]) == ("found", 2, [])
    assert {victim["id"] for victim in said["victims"]} == {7, 8}
    assert all(victim["sure"] and victim["marked"] and len(victim["lat_lon"]) == 2 for victim in said["victims"])
    assert said["found"]["lat_lon"] == pytest.approx(said["victims"][0]["lat_lon"], abs=1e-9)


def test_without_a_signal_it_flies_its_strips_lands_and_says_so(arva: Arva, tmp_path: Path) -> None:
    far = scenario(tmp_path, (1, 400.0, 0.0))
    err = arva(*MAX, "--scenario", far, "--area=-5,-5,5,5", "--record", tmp_path / "record", code=1).err
    says(err, "search: no signal: all strips are flown; landing", "\nno signal: all strips are flown\n")
    search = json.loads((tmp_path / "record" / "search.json").read_text())
    assert (search["outcome"], search["found"], search["others"], search["exit_code"]) == ("not found", None, [], 1)
    assert search["path_m"] == pytest.approx(13, abs=2)


def test_of_two_victims_the_nearer_is_found_outside_the_area_too_and_the_other_reported(
    arva: Arva, tmp_path: Path
) -> None:
    two = scenario(tmp_path, (7, 9.0, -2.0), (8, -30.0, 10.0))
    err = arva(*MAX, "--scenario", two, "--area=-5,-5,5,5", "--record", tmp_path / "record").err
    assert error_m(err) < 1.0
    assert "found transmitter 7: " in err
    assert re.search(r"^transmitter 8 was received, but not found; nearest, [\d.]+ m away, at ", err, re.MULTILINE)
    (other,) = json.loads((tmp_path / "record" / "search.json").read_text())["others"]
    assert other["id"] == 8


def test_the_strategy_is_chosen_and_the_time_is_limited(
    arva: Arva, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    err = arva(*MAX, "--strategy", "flux", "--limit", 10, "--record", tmp_path, code=1).err
    flux, usual = (table(record / "search.csv") for record in (tmp_path, demo(tmp_path_factory).record))
    begun = [row["phase"] for row in flux].index("flying")
    assert flux[begun + 10]["phase"] == usual[begun + 10]["phase"] == "flying"
    assert flux[begun + 10]["v_east"] != usual[begun + 10]["v_east"]
    says(err, "\nnot found in 10 s\n", "\ntransmitter 1 was received, but not found; nearest, ")


def test_it_can_be_interrupted(start: Start, tmp_path: Path) -> None:
    program = start("demo", "--headless", "--record", tmp_path).after(
        r"vehicle at /dev/\S+, frames at /dev/\S+", "arming"
    )
    program.stops(signal.SIGINT)
    assert json.loads((tmp_path / "search.json").read_text())["exit_code"] == 130
    assert json.loads((tmp_path / "run.json").read_text())["ended"] == "SIGINT"


def test_a_full_disk_does_not_end_the_flight(start: Start, tmp_path: Path) -> None:
    record = tmp_path / "record"
    program = start(*MAX, "--limit", 9, "--record", record, **full_disk())
    program.says(f"{record}: cannot record: File too large", "search: not found in 9 s; landing")
    program.ends(1)


@pytest.mark.parametrize("name", ["search.csv", "search.json", "frames.bin"])
def test_a_folder_that_holds_a_search_or_a_record_stays_as_it_is(arva: Arva, tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("of yesterday")
    err = arva.refused(*MAX, "--record", tmp_path)
    what = "a record" if name == "frames.bin" else "a search"
    assert err == f"arva-hil: {tmp_path}: holds {what} already ({name}); name another folder\n"
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "of yesterday"


def test_a_demo_that_cannot_begin_leaves_no_record(arva: Arva, tmp_path: Path) -> None:
    says(arva.refused(*MAX, "--record", tmp_path / "d", "--strip-width", "builtin:nothing"), "--strip-width")
    assert not (tmp_path / "d").exists()


def test_the_demo_has_a_port_and_no_use_for_frames_inside_mavlink(arva: Arva) -> None:
    says(arva.refused(*MAX, "--format", "tunnel"), "--format tunnel", "choose binary, nmea or text")


def test_an_error_of_the_estimate_is_refused_where_the_vehicle_tells_the_truth(arva: Arva, tmp_path: Path) -> None:
    path = written(
        tmp_path / "scenario.yaml",
        "spec: 2\nnavigation_error: {bias_ned: [1, 0, 0]}\ntransmitters: [{id: 1, ned: [5, 5, 0]}]\n",
    )
    assert "navigation_error" in arva.refused(*MAX, "--scenario", path)


@pytest.mark.parametrize(("words", "place"), [((), [0.3, 0, 0.1]), (["--mount=1,2,3"], [1, 2, 3])])
@pytest.mark.parametrize("drones", [(), ("--count", 2)])
def test_its_searches_know_where_the_scenario_has_mounted_the_receiver(
    arva: Arva,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: Sequence[str],
    place: Sequence[float],
    drones: Sequence[object],
) -> None:
    plans: list[SearchPlan] = []

    def client(plan: SearchPlan, *more: Any, **named: Any) -> SearchClient:
        plans.append(plan)
        return SearchClient(plan, *more, **named)

    monkeypatch.setattr(closed_loop, "SearchClient", client)
    monkeypatch.setattr(command, "run", lambda *_, **__: None)
    near = scenario(tmp_path, (1, 6.0, 3.0))
    mount = "{position: [0.3, 0, 0.1], sling: {length_m: 6}}"
    near.write_text(f"spec: 2\n{near.read_text()}receiver: {{mount: {mount}}}\n")
    err = arva(*MAX, "--scenario", near, *drones, *words, code=1).err
    assert "a receiver hangs on a rope, which the search does not know: places are up to 6 m too high" in err
    assert [plan.mount.pose((0, 0, 0), (1, 0, 0, 0))[0].tolist() for plan in plans] == [place] * (2 if drones else 1)


# -- `arva-hil demo` with several drones on one field ----------------------------------------------------------


FIELD = "spec: 2\ntransmitters: [{id: 1, ned: [7, -5, 0.5]}, {id: 2, ned: [-6, 6, 1]}]\n"


@pytest.fixture
def field(tmp_path: Path) -> Path:
    return written(tmp_path / "field.yaml", FIELD)


def test_two_drones_find_one_transmitter_each_and_what_was_not_found_is_named(
    arva: Arva, field: Path, tmp_path: Path
) -> None:
    field.write_text(FIELD.replace("}]", "}, {id: 3, ned: [-400, 12, 1]}]"))
    record = tmp_path / "record"
    words = ("--scenario", field, "--count", 2, "--area=-10,-10,10,10", "--max-speed", 3, "--record", record)
    err = arva("demo", "--speed", "max", "--web", "127.0.0.1:0", *words, code=1).err
    assert "page: http://127.0.0.1:" in err
    for id_ in (1, 2):
        assert err.count(f": found transmitter {id_}: ") == 1
    assert "not found: transmitter 3" in err
    run = json.loads((record / "run.json").read_text())
    assert run["vehicles"].keys() == {"drone-1", "drone-2"}
    assert run["scenario"]["datum"] == {"lat": 46.0123, "lon": 7.7456, "alt": 1650.0}  # so that a replay has the same
    assert (record / "drone-2" / "receiver" / "frames.bin").stat().st_size > 0
    recorded = [json.loads(line) for line in (record / "events.jsonl").read_text().splitlines()]
    assert {one["of"] for one in recorded if one["event"] == "place_found"} == {"drone-1", "drone-2"}


def test_a_computer_that_is_too_slow_for_the_speed_is_named_as_the_cause(arva: Arva, field: Path) -> None:
    ended = arva("demo", "--speed", 1000, "--headless", "--scenario", field, "--count", 2, "--limit", 30, code=(1, 3))
    *_, lacking, last = ended.err.splitlines()
    assert lacking.startswith("not found: transmitter 1")
    assert last.startswith("this computer was too slow for --speed 1000: up to ")
    assert last.endswith("choose a lower --speed, or --speed max, which waits for nothing")


def test_who_keeps_pace_is_not_told_that_it_did_not() -> None:
    clock, pace = StepClock(), Pace(0.0)
    clock.wait(pace.service(clock))
    assert pace.service(clock) == pytest.approx(0.2)
    clock.wait(0.4)
    pace.service(clock)
    assert pace.complaint(20.0) == ""
    clock.wait(2.5)
    pace.service(clock)
    assert pace.complaint(1.0) == (
        "this computer was too slow for real time: up to 2.0 s of the flight behind, which may be why the search "
        "failed: choose --speed max"
    )


def test_a_drone_with_two_receivers_is_refused(arva: Arva, field: Path) -> None:
    two = "{name: front, port: pty}, {name: rear, port: pty}"
    field.write_text(FIELD + f"vehicles: [{{name: alpha, receivers: [{two}]}}]\n")
    assert "alpha: 2 receivers; a drone has one here" in arva.refused(*MAX, "--scenario", field)


# -- a demo without --record: its folder is named -------------------------------------------------------------


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_a_demo_says_where_its_record_is(arva: Arva, temporary: Path) -> None:
    err = arva("demo", "--speed", "max", "--headless", "--limit", 1, code=1).err
    (made,) = temporary.iterdir()
    assert re.fullmatch(r"arva-demo-\d{8}T\d{6}-\w+", made.name)
    assert err.startswith(f"record: {made}; --record DIR keeps it elsewhere\n")
    assert (made / "run.json").exists()


def test_a_demo_that_cannot_begin_leaves_no_folder(arva: Arva, temporary: Path) -> None:
    assert "--map: there is no page" in arva.refused(*MAX, "--map", "f.tif")
    assert list(temporary.iterdir()) == []
