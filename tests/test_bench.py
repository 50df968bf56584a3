"""The benchmark's rows: what is reached, and what got slower since another run."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from tools.bench import __main__ as bench
from tools.bench.table import Row, ratio, read, slower, write

ROW = ratio("work", "peer", 1.0, 4.0, "s", 0.25)


def test_a_row_is_judged_by_ours_over_the_peers() -> None:
    assert ROW.cost == 0.25
    assert ROW.reached
    assert not replace(ROW, cost=0.26).reached
    assert "MISSED" in replace(ROW, cost=0.26).line()


def test_rows_are_written_and_read_again(tmp_path: Path) -> None:
    rows = [ROW, Row("größer", "peer", 1, 2, "µs", 0.5, 1)]
    write(rows, tmp_path / "rows.json")
    assert read(tmp_path / "rows.json") == {row.work: row for row in rows}


@pytest.mark.parametrize("text", ["", "{}x", "[1]", '[{"work": "alone"}]'])
def test_a_file_without_rows_is_refused_by_name(text: str, tmp_path: Path) -> None:
    (tmp_path / "rows.json").write_text(text)
    with pytest.raises(ValueError, match=r"rows\.json: no rows of a benchmark"):
        read(tmp_path / "rows.json")


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


def test_the_kept_baseline_has_the_work_that_does_not_need_an_idle_machine() -> None:
    works = " ".join(read(Path(bench.__file__).with_name("baseline.json")))
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


def test_a_flight_that_is_not_there_is_said_before_anything_is_measured(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["bench", "--flight", "none.tlog", "limits"])
    with pytest.raises(SystemExit) as ended:
        bench.main()
    assert ended.value.code == 2
    assert "--flight: none.tlog: no such file" in capsys.readouterr().err
