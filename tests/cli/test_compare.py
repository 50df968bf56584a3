"""`arva-hil compare`: a table, objects or a picture; what cannot be compared is said."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.rehearsed import rehearse
from tools.real.rehearsal import Waypoint

from ..records.test_comparing import FLIGHT
from ..records.test_received import QUIET
from .far_ends import Arva


@pytest.fixture
def record(tmp_path: Path) -> Path:
    return rehearse(tmp_path / "r", QUIET, FLIGHT)


def test_a_table_objects_and_a_picture(arva: Arva, record: Path, tmp_path: Path) -> None:
    code, out, err = arva("compare", record, "--scenario", "builtin:default", "--out", tmp_path / "c.png")
    assert code == 0, err
    assert "transmitter 1: 60 of 61 frames in both" in out
    assert "by zone" in out
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")
    code, out, _ = arva("compare", record, "--scenario", "builtin:default", "--json")
    assert code == 0
    assert json.loads(out)["both"] == 60


def test_two_records(arva: Arva, record: Path, tmp_path: Path) -> None:
    other = rehearse(tmp_path / "other", replace(QUIET, seed=3), FLIGHT)
    code, out, _ = arva("compare", record, other)
    assert code == 0
    assert "frames in both" in out


def test_what_cannot_be_compared_is_said(arva: Arva, record: Path, tmp_path: Path) -> None:
    def refused(*words: object) -> str:
        code, _, err = arva("compare", *words)
        assert code in (1, 2)
        return err

    assert "name one to compare with" in refused(record)
    assert "name one to compare with" in refused(record, record, "--scenario", "builtin:default")
    assert "expected a file name" in refused(record, "--scenario", "builtin:default", "--out", "x.gif")
    assert "vehicles: name a scenario of one receiver" in refused(record, "--scenario", "builtin:two_vehicles")
    far = [Waypoint(point.time_s, point.north + 60, point.east, point.down, 45) for point in FLIGHT]
    other = rehearse(tmp_path / "other", QUIET, far)
    assert "are of two flights, and only 0 frames are at common places" in refused(record, other)
    (record / "autopilot.tlog").unlink()
    assert "there are no poses in it" in refused(record, "--scenario", "builtin:default")


@pytest.mark.parametrize(("cell", "why"), [(3, "frames without poses"), (None, "poses without frames")])
def test_a_record_that_lacks_a_side_is_said(arva: Arva, record: Path, cell: int | None, why: str) -> None:
    head, *rows = (record / "readings.csv").read_text().splitlines()
    kept = []
    for row in rows if cell else ():
        cells = row.split(",")
        cells[3:9] = [""] * 6
        kept.append(",".join(cells))
    (record / "readings.csv").write_text("\n".join([head, *kept]) + "\n")
    code, _, err = arva("compare", record, "--scenario", "builtin:default")
    assert code == 1
    assert why in err
