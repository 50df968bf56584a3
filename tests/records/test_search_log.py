"""The log of a search: one row a step, and how it ended."""

from __future__ import annotations

import csv
import json
import threading
from pathlib import Path

import pytest

from arva_hil.cli.search_report import close_log
from arva_hil.clock import StepClock
from arva_hil.records.writing import RecordError
from arva_hil.records.writing.search_log import SearchLog
from arva_hil.search.mission.outcome import Outcome, SearchStep

COLUMNS = "time_s,phase,north_m,east_m,down_m,heading_deg,v_north,v_east,v_down,id,d_cm,delta_deg,zone"


def row(n: int) -> SearchStep:
    reading = (7, 1234 + n, -15, 1) if n % 5 == 0 else (None, None, None, None)
    return SearchStep(n * 0.2, "flying", 1 / 3 + n, -n / 7, -1.0, 359.9, 0.5, -0.25, 0.0, *reading)


@pytest.mark.parametrize("count", [0, 1, 500])
def test_every_row_is_there_to_the_last_digit(tmp_path: Path, count: int) -> None:
    log = SearchLog(tmp_path / "deep" / "er")
    rows = [row(n) for n in range(count)]
    for one in rows:
        log.row(one)
    log.close({"outcome": "found"})
    assert log.error == ""
    with open(tmp_path / "deep" / "er" / "search.csv", newline="") as file:
        header, *lines = csv.reader(file)
    assert ",".join(header) == COLUMNS
    for line, one in zip(lines, rows, strict=True):
        assert [value == "" for value in line] == [value is None for value in one]
        assert float(line[2]) == one.north_m
        assert float(line[3]) == one.east_m
    assert json.loads((tmp_path / "deep" / "er" / "search.json").read_text()) == {"outcome": "found"}


def test_it_may_lie_beside_the_record_of_a_run(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("{}")
    (tmp_path / "readings.csv").write_text("seq\n")
    SearchLog(tmp_path).close({})
    assert (tmp_path / "readings.csv").read_text() == "seq\n"


@pytest.mark.parametrize("name", ["search.csv", "search.json"])
def test_another_search_is_never_overwritten(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("of yesterday")
    with pytest.raises(RecordError, match=rf"{tmp_path}: holds a search already \({name}\); name another folder"):
        SearchLog(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "of yesterday"


def test_a_picture_is_not_drawn_through_a_symlink(tmp_path: Path) -> None:
    (tmp_path / "of somebody").write_text("mine")
    (tmp_path / "search.png").symlink_to(tmp_path / "of somebody")
    log = SearchLog(tmp_path)
    log.row(row(0))
    assert close_log(log, Outcome("found", ()), 0, 0.0) == [
        f"log: {tmp_path / 'search.csv'}, picture: {tmp_path / 'search.png'}"
    ]
    assert (tmp_path / "of somebody").read_text() == "mine"
    assert (tmp_path / "search.png").read_bytes().startswith(b"\x89PNG")
    assert not (tmp_path / "search.png").is_symlink()


def test_rows_are_on_the_disk_soon_whatever_ends_the_program(tmp_path: Path) -> None:
    clock, over = StepClock(), threading.Event()
    log = SearchLog(tmp_path, clock)
    for n in range(5):
        clock.wait(n * 0.25)
        log.row(row(n))
        for _ in range(6000):
            if (tmp_path / "search.csv").read_bytes().count(b"\n") == n + 2:
                break
            over.wait(0.01)
        else:
            raise AssertionError("the deadline passed")
    log.close({})


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(RecordError, match=f"{file}: cannot record: File exists"):
        SearchLog(file)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")  # it is told by the log
def test_what_goes_wrong_is_told_at_the_end_and_holds_nobody_up(tmp_path: Path) -> None:
    log = SearchLog(tmp_path)
    log._files["search.csv"].close()
    for n in range(500):
        log.row(row(n))
    with pytest.raises(RecordError, match=f"{tmp_path}: cannot record: .*closed file"):
        log.close({"outcome": "found"})
    assert "closed file" in log.error
    assert json.loads((tmp_path / "search.json").read_text()) == {"outcome": "found"}


def test_a_folder_that_has_gone_is_told_too(tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    log = SearchLog(folder)
    (folder / "search.csv").unlink()
    folder.rmdir()
    with pytest.raises(RecordError, match="No such file or directory"):
        log.close({})
