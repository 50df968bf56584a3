"""`arva-hil range-test`: a data sheet on stdout, and in a folder with its picture."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import pytest

from .far_ends import Arva


def test_it_prints_a_sheet_and_leaves_it_with_a_table_and_a_picture_in_a_folder(arva: Arva, tmp_path: Path) -> None:
    code, out, err = arva("range-test", "--walks", 2, "--seed", 3, "--out", tmp_path / "sheet")
    assert code == 0
    assert out.startswith("range test of receiver: model paper, 1 Hz; scenario default scenario\n")
    assert "2 walks a coupling at 1 m/s, 3 m above the transmitter; stable: no gap for 10 s; seeds from 3 on" in out
    assert [line.rpartition("/")[2] for line in err.splitlines()] == [
        "range-test.txt",
        "range-test.csv",
        "range-test.png",
    ]
    assert (tmp_path / "sheet" / "range-test.txt").read_text() == out
    with (tmp_path / "sheet" / "range-test.csv").open(newline="") as file:
        assert len(list(csv.DictReader(file))) == 6
    assert (tmp_path / "sheet" / "range-test.png").read_bytes().startswith(b"\x89PNG")


def test_each_receiver_of_a_scenario_has_a_sheet_of_its_own(arva: Arva) -> None:
    code, out, _ = arva("range-test", "--scenario", "builtin:two_vehicles", "--walks", 1, "--json")
    sheets = [json.loads(line) for line in out.splitlines()]
    assert code == 0
    assert len(sheets) > 1
    assert len({sheet["receiver"] for sheet in sheets}) == len(sheets)


def test_what_is_wrong_is_told_before_anybody_walks(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, _, err = arva("range-test", "--scenario", tmp_path / "none.yaml")
    assert (code, "none.yaml" in err) == (2, True)
    assert arva("range-test", "--walks", "0").code == 2
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    code, out, err = arva("range-test", "--out", tmp_path / "sheet")
    assert (code, out) == (2, "")
    assert err == ("arva-hil: the picture of --out needs matplotlib, which is missing: pip install 'arva-hil[plots]'\n")
