"""`arva-hil demo`: vehicle, receiver and search in one program; here also what the search makes of hard scenarios."""

from __future__ import annotations

import csv
import json
import re
import signal
from pathlib import Path

import pytest

from .far_ends import Arva, Start, full_disk
from .flown import demo, fly

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
    with open(record / "search.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert rows[-1]["phase"] == "landing"
    assert abs(float(rows[-1]["down_m"])) < 0.2
    assert (record / "search.png").stat().st_size > 10_000


def test_the_strategy_the_format_and_an_error_of_the_gps_are_chosen(
    arva: Arva, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    hint = "the GPS of this flight had no error; --gps-noise 1.5 flies with one"
    assert hint in demo(tmp_path_factory).err
    code, _, err = arva(*MAX, "--strategy", "flux", "--format", "text", "--gps-noise", 0.5, "--record", tmp_path)
    assert code == 0, err
    assert hint not in err
    assert 0.1 < error_m(err) < 2.0
    assert "\nfound a transmitter: " in err  # this format has no ids
    assert re.search(r"of the take-off point; .* of the drone ± (0\.\d m|\d cm)", err)  # by the check of the readings
    assert re.search(r"position: .* ± 2\.\d m on Earth, or more: the autopilot does not report its accuracy", err)


def test_at_full_speed_it_is_repeatable(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    again, before = fly(tmp_path), demo(tmp_path_factory)
    assert again.code == 0
    for file in ("frames.bin", "search.csv", "search.png", "autopilot.tlog"):
        assert (before.record / file).read_bytes() == (again.record / file).read_bytes()


def test_of_two_victims_the_nearer_is_found_and_the_other_reported(arva: Arva, tmp_path: Path) -> None:
    two = scenario(tmp_path, (7, 12.0, -4.0), (8, -30.0, 10.0))
    code, _, err = arva(*MAX, "--scenario", two, "--record", tmp_path / "record")
    assert code == 0
    assert error_m(err) < 1.0
    assert "found transmitter 7: " in err
    assert re.search(r"^transmitter 8 was received, but not found; nearest, [\d.]+ m away, at ", err, re.MULTILINE)
    (other,) = json.loads((tmp_path / "record" / "search.json").read_text())["others"]
    assert other["id"] == 8


def test_two_victims_are_found_one_after_the_other_and_listed(arva: Arva, tmp_path: Path) -> None:
    two = scenario(tmp_path, (7, 12.0, -4.0), (8, -10.0, 10.0))
    code, _, err = arva(*MAX, "--scenario", two, "--victims", 2, "--record", tmp_path / "record")
    assert code == 0, err
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


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (["--victims", "0"], "'0': expected a whole number 1…16, or all"),
        (["--victims", "some"], "'some': expected a whole number 1…16, or all"),
        (["--victims", "2"], "--victims 2: there is one transmitter in default scenario"),
        (
            ["--victims", "2", "--count", "2"],
            "--victims: several drones share the transmitters, one each: leave it out",
        ),
    ],
)
def test_what_cannot_be_searched_for_is_refused(arva: Arva, options: list[str], what: str) -> None:
    code, _, err = arva(*MAX, *options)
    assert code == 2
    assert what in err


def test_without_a_signal_it_flies_its_strips_lands_and_says_so(arva: Arva, tmp_path: Path) -> None:
    far = scenario(tmp_path, (1, 400.0, 0.0))
    code, _, err = arva(*MAX, "--scenario", far, "--area=-20,-20,20,20", "--record", tmp_path / "record")
    assert code == 1
    assert "search: no signal: all strips are flown; landing" in err
    assert "\nno signal: all strips are flown\n" in err
    search = json.loads((tmp_path / "record" / "search.json").read_text())
    assert (search["outcome"], search["found"], search["others"], search["exit_code"]) == ("not found", None, [], 1)
    assert search["path_m"] == pytest.approx(60, abs=5)


def test_a_victim_outside_the_area_is_heard_and_found(arva: Arva, tmp_path: Path) -> None:
    outside = scenario(tmp_path, (1, 45.0, 5.0))
    code, _, err = arva(*MAX, "--scenario", outside, "--area=-10,-10,15,10", "--record", tmp_path / "record")
    assert code == 0, err
    assert error_m(err) < 1.0


def test_the_time_is_limited(arva: Arva, tmp_path: Path) -> None:
    code, _, err = arva(*MAX, "--limit", 10, "--record", tmp_path)
    assert code == 1
    assert "\nnot found in 10 s\n" in err
    assert "\ntransmitter 1 was received, but not found; nearest, " in err


def test_it_runs_over_real_terminals(start: Start, tmp_path: Path) -> None:
    # at a speed of 8, a program that gets a quarter of a core lets the vehicle go, as it should
    near = scenario(tmp_path, (1, 6.0, 2.0))
    program = start("demo", "--speed", 3, "--headless", "--scenario", near, "--record", tmp_path / "record")
    program.says(r"vehicle at /dev/\S+, frames at /dev/\S+")
    assert program.ends() == 0
    assert error_m(program.err) < 1.0


def test_it_can_be_interrupted(start: Start, tmp_path: Path) -> None:
    program = start("demo", "--headless", "--record", tmp_path)
    program.says("arming")
    program.send(signal.SIGINT)
    assert program.ends() == 130
    assert json.loads((tmp_path / "search.json").read_text())["exit_code"] == 130
    assert json.loads((tmp_path / "run.json").read_text())["ended"] == "SIGINT"


def test_a_full_disk_does_not_end_the_flight(start: Start, tmp_path: Path) -> None:
    program = start(
        *(*MAX, "--record", tmp_path),
        **full_disk(),
    )
    assert program.ends() == 1
    assert error_m(program.err) < 1.0
    assert f"error: {tmp_path}: cannot record: File too large" in program.err


@pytest.mark.parametrize("name", ["search.csv", "search.json", "frames.bin"])
def test_a_folder_that_holds_a_search_or_a_record_stays_as_it_is(arva: Arva, tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("of yesterday")
    code, _, err = arva(*MAX, "--record", tmp_path)
    assert code == 2
    what = "a record" if name == "frames.bin" else "a search"
    assert err == f"arva-hil: {tmp_path}: holds {what} already ({name}); name another folder\n"
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "of yesterday"


def test_the_demo_has_a_port_and_no_use_for_frames_inside_mavlink(arva: Arva) -> None:
    code, _, err = arva(*MAX, "--format", "tunnel")
    assert code == 2
    assert "--format tunnel" in err
    assert "choose binary, nmea or text" in err


def test_an_error_of_the_estimate_is_refused_where_the_vehicle_tells_the_truth(arva: Arva, tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text("spec: 2\nnavigation_error: {bias_ned: [1, 0, 0]}\ntransmitters: [{id: 1, ned: [5, 5, 0]}]\n")
    code, _, err = arva(*MAX, "--scenario", path)
    assert code == 2
    assert "navigation_error" in err
