"""Depths below a terrain: grids of heights, what is wrong with them, and where transmitters then are."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from arva_hil.cli.main import main
from arva_hil.config import Lla, Scenario, ScenarioError, Transmitter, load, parse, to_dict
from arva_hil.config.terrain import parse_grid
from arva_hil.emulator.build import transmitters
from arva_hil.model.field import LocalFrame

CELL = 0.001
HEAD = f"ncols 3\nnrows 2\nxllcorner 6.9995\nyllcorner 45.9995\ncellsize {CELL}\nNODATA_value -9999\n"
GRID = f"{HEAD}1700 1710 1720\n1600 1610 -9999\n"  # centres: 46.001 and 46.000 north, 7.000 to 7.002 east
HOME = (46.0, 7.0, 1655.0)


def folder(tmp_path: Path, text: str, grid: str = GRID) -> Path:
    (tmp_path / "slope.asc").write_text(grid)
    path = tmp_path / "s.yaml"
    path.write_text(f"spec: 2\n{text}")
    return path


def mistakes(path: Path) -> list[str]:
    with pytest.raises(ScenarioError) as caught:
        load(path)
    return [str(one).replace(f"{path.parent}/", "") for one in caught.value.problems]


def test_a_grid_is_linear_between_the_centres_of_its_cells() -> None:
    grid = parse_grid(GRID, "slope.asc")
    places = {(46.001, 7.0): 1700, (46.0, 7.001): 1610, (46.0005, 7.0005): 1655, (46.001, 7.002): 1720}
    for place, height in places.items():
        assert grid.height(*place) == pytest.approx(height, abs=1e-6)
    for place in [(46.0, 7.0015), (46.0005, 7.002), (46.0011, 7.0), (45.9999, 7.0), (46.0, 6.9999), (47.0, 8.0)]:
        assert grid.height(*place) is None
    of_centres = GRID.replace("xllcorner 6.9995", "XLLCENTER 7.0").replace("yllcorner 45.9995", "yllcenter 46.0")
    assert parse_grid(of_centres, "slope.asc") == grid


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("ncols 3\n", "", "slope.asc:6:1: no ncols, expected an ESRI ASCII grid: a header with ncols"),
        ("ncols 3", "ncols three", "slope.asc:1:1: 'ncols three', expected an ESRI ASCII grid"),
        ("ncols 3", "ncols 3\nncols 3", "slope.asc:2:1: 'ncols 3'"),
        ("ncols 3", "ncols 1", "slope.asc:1:1: 1 columns, 2 rows, expected 2 to 10000 of each"),
        ("nrows 2", "nrows 20000", "slope.asc:1:1: 3 columns, 20000 rows"),
        ("nrows 2", "nrows 3", "slope.asc:9:1: 0 heights, expected 3 in a row, 3 rows"),
        ("1600 1610 -9999", "1600 1610", "slope.asc:8:1: 2 heights, expected 3 in a row, 2 rows"),
        ("1600 1610 -9999", "1600 1610 7\n1 2 3", "slope.asc:9:1: more heights, expected 2 rows"),
        ("1610", "1,610", "slope.asc:8:1: '1600 1,610 -9999', expected heights in metres"),
        ("1610", "nan", "slope.asc:8:1: a height of no place on Earth"),
        ("1710", "99999", "slope.asc:7:1: a height of no place on Earth, expected -500 to 9000 m AMSL, or -9999"),
        ("6.9995", "2600000", "slope.asc:1:1: an origin of 2.6e+06, 46, cells of 0.001, expected degrees of WGS-84"),
        ("cellsize 0.001", "cellsize 0", "slope.asc:1:1: an origin of 6.9995, 45.9995, cells of 0, expected degrees"),
    ],
)
def test_a_grid_that_is_none_is_refused_at_its_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in GRID
    path = folder(tmp_path, "terrain: slope.asc\ntransmitters: [{id: 1, ned: [1, 2, 3]}]\n", GRID.replace(old, new, 1))
    (only,) = mistakes(path)
    assert only.startswith("s.yaml:2:10: ")
    assert words in only


def test_a_grid_that_is_no_file_or_too_large_is_refused(tmp_path: Path) -> None:
    path = folder(tmp_path, "terrain: other.asc\ntransmitters: [{id: 1, ned: [1, 2, 3]}]\n")
    assert mistakes(path) == [
        "s.yaml:2:10: other.asc:1:1: No such file or directory, expected an ESRI ASCII grid",
    ]
    path = folder(tmp_path, "terrain: slope.asc\ntransmitters: [{id: 1, ned: [1, 2, 3]}]\n", "x" * (17 << 20))
    assert mistakes(path) == ["s.yaml:2:10: slope.asc:1:1: more than 16 MiB, expected an ESRI ASCII grid"]
    path = folder(tmp_path, "terrain: [slope.asc]\ntransmitters: [{id: 1, ned: [1, 2, 3]}]\n")
    assert mistakes(path) == ["s.yaml:2:10: terrain: a list of 1, expected a file of heights, or autopilot"]


def test_a_hole_under_a_transmitter_and_another_place_are_refused_where_they_are(tmp_path: Path) -> None:
    at = "{lat: 46.0, lon: 7.0, alt: 1650}"
    several = (
        "[{id: 1, enu: [20, 5, 0], depth_m: 1},\n  {id: 2, enu: [150, 5, 0], depth_m: 1},\n  {id: 3, ned: [0, 150, 0]}]"
    )
    path = folder(tmp_path, f"datum: {at}\nterrain: slope.asc\ntransmitters: {several}\n")
    assert mistakes(path) == [
        "s.yaml:5:3: a transmitter outside of slope.asc, or over a hole of it, expected a place with a height"
    ]
    path = folder(tmp_path, f"datum: {at}\nterrain: slope.asc\ntransmitters: {several}\n".replace("46.0", "47.0"))
    (only,) = mistakes(path)
    assert only == "s.yaml:3:10: slope.asc, which has no height at the datum, expected a terrain around the datum"
    path = folder(tmp_path, "terrain: slope.asc\ntransmitters:\n- {id: 1, lla: [46.0, 7.0019, 0], depth_m: 1}\n")
    assert mistakes(path)[0].startswith("s.yaml:4:3: a transmitter outside of slope.asc")


@pytest.mark.parametrize(
    ("transmitter", "words"),
    [
        ("{id: 1, enu: [1, 2, 3], depth_m: 1}", "3:36: enu: 3, expected 0 as its height beside depth_m"),
        ("{id: 1, ned: [1, 2, -1], depth_m: 1}", "expected 0 as its height beside depth_m"),
        ("{id: 1, lla: [46, 7, 1650], depth_m: 1}", "expected 0 as its height beside depth_m"),
        ("{id: 1, follows: {system: 2}, depth_m: 1}", "follows, expected enu, ned or lla beside depth_m"),
        ("{id: 1, enu: [1, 2, 0], depth_m: deep}", "expected a number from -100 to 100"),
    ],
)
def test_a_depth_counts_from_the_ground_alone(tmp_path: Path, transmitter: str, words: str) -> None:
    assert words in mistakes(folder(tmp_path, f"terrain: slope.asc\ntransmitters: [{transmitter}]\n"))[0]


def test_a_depth_is_below_the_grid_and_home_stands_on_it() -> None:
    grid = parse_grid(GRID, "slope.asc")
    every = (Transmitter(1, ned=(50.0, 0.0, 0.0), depth_m=2.0), Transmitter(2, lla=Lla(46.0, 7.0, 0.0), depth_m=1.5))
    north = np.array([50.0, 0.0])
    risen = 100 / LocalFrame(*HOME).ned(46.001, 7.0, 1655.0)[0]  # metres a metre
    at_home = transmitters(Scenario(every, terrain=grid), LocalFrame(*HOME)).positions
    assert at_home[:, 0] == pytest.approx(north, abs=1e-6)
    assert at_home[:, 2] == pytest.approx([2.0 - 50 * risen, 1.5], abs=0.01)
    assert transmitters(Scenario(every, Lla(*HOME), terrain=grid), LocalFrame(*HOME)).positions[:, 2] == pytest.approx(
        at_home[:, 2] + 55.0, abs=0.01
    )


def test_without_a_terrain_the_ground_is_level_with_the_datum() -> None:
    every = (Transmitter(1, ned=(50.0, 3.0, 0.0), depth_m=2.0), Transmitter(2, lla=Lla(46.0, 7.0, 0.0), depth_m=-1.5))
    there = transmitters(Scenario(every), LocalFrame(*HOME)).positions
    assert there[0].tolist() == [50.0, 3.0, 2.0]
    assert there[1] == pytest.approx([0.0, 0.0, -1.5], abs=1e-6)


def test_where_the_grid_has_no_height_a_transmitter_is_silent_and_has_no_range() -> None:
    every = (Transmitter(1, ned=(50.0, 0.0, 0.0), depth_m=2.0), Transmitter(2, ned=(0.0, 9.0, 0.0)))
    there = transmitters(Scenario(every, terrain=parse_grid(GRID, "slope.asc")), LocalFrame(47.0, 7.0, 1655.0))
    assert there.unplaced == {1}
    assert list(there.ranges([0, 0, 0])) == [2]
    assert np.count_nonzero(there.field_at(np.array([0.0, 0.0, -3.0]))[0]) == 0


def test_snow_begins_at_the_ground_of_the_terrain() -> None:
    text = "spec: 2\nmedium: {snow_conductivity_s_m: 1e-2}\ntransmitters: [{id: 1, ned: [50, 0, 0], depth_m: 2}]"
    level = parse(text, "s.yaml")
    sloping = Scenario(level.transmitters, medium=level.medium, terrain=parse_grid(GRID, "slope.asc"))
    losses = [of.medium.loss(of.positions) for of in (transmitters(s, LocalFrame(*HOME)) for s in (level, sloping))]
    assert losses[0][0] < 0.8
    assert losses[1] == pytest.approx(losses[0])


def test_a_terrain_is_written_by_its_name_and_read_back_equal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder(tmp_path, "terrain: slope.asc\ntransmitters: [{id: 1, enu: [20, 5, 0], depth_m: 1}]\n")
    chosen = load(path)
    written = to_dict(chosen)
    assert written["terrain"] == str(tmp_path / "slope.asc")
    assert parse(json.dumps(written), "elsewhere/run.json") == chosen
    assert main(["check", str(path)]) == 0
    capsys.readouterr()
    with pytest.raises(ScenarioError, match="key 'terrain' of spec 2"):
        parse("transmitters: [{id: 1, enu: [20, 5, 0]}]\nterrain: slope.asc", "s.yaml")
