"""`arva-hil report`: a page about a record, two, or those in a folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from arva_hil.records.report import page
from tests.made_records import write

from .far_ends import Arva


@pytest.mark.undrawn
def test_the_page_is_in_the_record_or_where_it_is_wanted(arva: Arva, tmp_path: Path) -> None:
    run = write(tmp_path / "flight", 0, search=False)
    assert arva("report", run) == (0, "", f"written: {run}/report.html\n")
    html = (run / "report.html").read_text()
    assert html.count("data:image/svg+xml;base64,") == 5
    assert arva("report", run, "--out", tmp_path / "x.html").err == f"written: {tmp_path}/x.html\n"
    assert (tmp_path / "x.html").read_text().startswith("<!doctype html>")


def test_two_records_and_those_of_a_folder_are_on_one_page(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "pictures", lambda *_, **__: [])
    one, two = write(tmp_path / "one", 3), write(tmp_path / "two", 4)
    assert arva("report", one, two, "--out", tmp_path / "x.html").code == 0
    assert arva("report", tmp_path).err == f"written: {tmp_path}/report.html\n"
    assert (tmp_path / "report.html").read_text() == (tmp_path / "x.html").read_text()
    for n in range(12):
        write(tmp_path / f"more-{n:02}", 1, search=False)
    assert f"note: {tmp_path} holds 14 records: the report has the first 12" in arva("report", tmp_path).err


@pytest.mark.undrawn
def test_a_folder_without_a_record_and_a_file_of_the_record_are_refused(arva: Arva, tmp_path: Path) -> None:
    code, _, err = arva("report", tmp_path)
    assert (code, err) == (
        2,
        f"arva-hil: {tmp_path}: there is no run.json and no search.csv in it; name one that --record has written\n",
    )
    run = write(tmp_path / "flight", 0, search=False)
    code, _, err = arva("report", run, tmp_path / "nowhere")
    assert (code, err) == (2, f"arva-hil: {tmp_path}/nowhere: no such folder; name one that --record has written\n")
    code, _, err = arva("report", run, "--out", run / "run.json")
    assert (code, err) == (2, f"arva-hil: {run}/run.json: this is a file of the record itself: name another one\n")
