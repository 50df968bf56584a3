"""The benchmark's rows: what is reached, and what got slower since another run."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from tools.bench import speed as bench
from tools.bench.table import Row, conditions, ratio, read, slower, write

ROW = ratio("work", "peer", 1.0, 4.0, "s", 0.25)


def test_a_row_is_judged_by_ours_over_the_peers() -> None:
    assert ROW.cost == 0.25
    assert ROW.reached
    assert not replace(ROW, cost=0.26).reached
    assert "MISSED" in replace(ROW, cost=0.26).line()


def test_rows_are_written_and_read_again(tmp_path: Path) -> None:
    rows = [ROW, Row("größer", "peer", 1, 2, "µs", 0.5, 1)]
    write(rows, tmp_path / "rows.json")
    found = read(tmp_path / "rows.json")
    assert found.rows == {row.work: row for row in rows}
    assert found.conditions == conditions()
    assert found.conditions.keys() == {"machine", "Python", "commit"}


NO_COST = json.dumps({"with": {}, "rows": [asdict(ROW) | {"cost": "0.25"}]})


@pytest.mark.parametrize("text", ["", "{}x", "{}", "[1]", '{"with": {}, "rows": [{"work": "alone"}]}', NO_COST])
def test_a_file_without_rows_is_refused_by_name(text: str, tmp_path: Path) -> None:
    (tmp_path / "rows.json").write_text(text)
    with pytest.raises(ValueError, match=r"rows\.json: is no baseline \(.+\); write one with --json$"):
        read(tmp_path / "rows.json")


def test_a_baseline_that_is_missing_is_refused_by_name_once() -> None:
    with pytest.raises(ValueError, match=r"^none\.json: No such file or directory; write a baseline with --json$"):
        read(Path("none.json"))


def test_what_got_slower_is_named_and_nothing_else() -> None:
    before = {"work": ROW}
    assert slower([replace(ROW, cost=0.3)], before) == []  # as two runs differ
    assert slower([replace(ROW, cost=0.35)], before) == ["work: 0.35, before 0.25"]
    assert slower([replace(ROW, work="new", cost=9.0)], before) == []


def test_check_names_what_got_slower_than_the_baseline_and_ends_with_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    write([ROW], tmp_path / "before.json")
    for cost, code, said in (0.25, 0, ""), (0.5, 1, "slower: work: 0.5, before 0.25\n"):
        group = [replace(ROW, cost=cost)]
        monkeypatch.setattr(bench, "_GROUPS", {"model": lambda _, rows=group: iter(rows)})
        monkeypatch.setattr(sys, "argv", ["bench", "--check", str(tmp_path / "before.json"), "model"])
        assert bench.main() == code
        assert capsys.readouterr().out.endswith(said)


def test_check_says_what_it_did_not_compare_and_what_else_was_different(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "before.json"
    path.write_text(json.dumps({"with": conditions() | {"commit": "0123abc"}, "rows": [asdict(ROW)]}))
    for new, code, said in (
        ("also", 0, ""),
        ("only", 1, f"error: {path} has none of these rows: nothing was compared\n"),
    ):
        group = [replace(ROW, work=new)] if new == "only" else [ROW, replace(ROW, work=new)]
        monkeypatch.setattr(bench, "_GROUPS", {"model": lambda _, rows=group: iter(rows)})
        monkeypatch.setattr(sys, "argv", ["bench", "--check", str(path), "model"])
        assert bench.main() == code
        out = capsys.readouterr().out
        assert out.endswith(f"not compared: {new}: {path} has no such row\n{said}")
        assert f"{path}: measured with another commit 0123abc, now " in out
        assert "another machine" not in out


def test_the_kept_baseline_has_the_work_that_does_not_need_an_idle_machine() -> None:
    works = " ".join(read(Path(bench.__file__).with_name("baseline.json")).rows)
    for work in (
        "field of 4",
        "1,000,000 readings",
        "one reading",
        "MAVLink in",
        "whole replay",
        "closed loop",
        "--help",
    ):
        assert work in works


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--flight", "none.tlog", "starts"], "--flight: none.tlog: no such file"),
        (["--flight", __file__, "--seconds", "2", "live"], "--seconds 2: 5 at least"),
    ],
)
def test_what_cannot_be_measured_is_said_before_anything_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    monkeypatch.setattr(sys, "argv", ["bench", *words])
    with pytest.raises(SystemExit) as ended:
        bench.main()
    assert ended.value.code == 2
    assert said in capsys.readouterr().err
