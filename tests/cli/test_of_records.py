"""`arva-hil plot`, `report`, `export` and `range-test`: what is made of a record, and a data sheet."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from arva_hil.campaign import report, results
from arva_hil.campaign.results import row
from arva_hil.cli import range_test
from arva_hil.records.report import page
from arva_hil.registry import EXPORTS
from tests.campaign.fakes import PLAN, fake, planned
from tests.files import rows as table
from tests.made_records import write, write_several

from .far_ends import Arva

FIGURE = "matplotlib.figure.Figure.savefig"


def test_a_sheet_is_of_the_kind_that_its_name_says(arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run, kinds = write(tmp_path / "flight", 0, search=False), []
    monkeypatch.setattr(FIGURE, lambda figure, out, format, **_: kinds.append(format))
    for name in "b.svg", "c.PDF":
        assert arva("plot", run, "--out", tmp_path / name) == (0, "", f"written: {tmp_path / name}\n")
    assert kinds == ["svg", "pdf"]


@pytest.mark.undrawn
def test_without_out_each_picture_is_a_file_in_the_record(arva: Arva, tmp_path: Path) -> None:
    run = write(tmp_path / "flight", 0, search=False)
    arva("plot", run, "--format", "svg")
    assert sorted(path.name for path in (run / "plots").iterdir()) == [
        "distance.svg",
        "lateness.svg",
        "map.svg",
        "streams.svg",
        "timeline.svg",
    ]


@pytest.mark.undrawn
def test_the_pictures_of_two_receivers_never_have_one_name(arva: Arva, tmp_path: Path) -> None:
    run = write_several(tmp_path / "flight", 0, [("a-b", "c"), ("a", "b-c")])
    arva("plot", run)
    assert len(list((run / "plots").iterdir())) == 10
    arva("plot", run, "--out", tmp_path / "sheet.png")
    assert sorted(path.name for path in tmp_path.glob("*.png")) == ["a+b-c-sheet.png", "a-b+c-sheet.png"]


def test_pictures_for_a_paper_have_its_size_and_truetype_fonts_and_no_pixels(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write(tmp_path / "flight", 5)
    arva("plot", folder, "--paper", "--out", tmp_path / "paper")
    files = list((tmp_path / "paper").iterdir())
    assert {file.name for file in files} >= {"map.pdf", "distance.pdf", "timeline.pdf"}
    for file in files:
        data = file.read_bytes()
        assert float(re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ", data)[1]) == pytest.approx(72 * 3.5, abs=0.1)
        assert b"/FontFile2" in data  # TrueType
        assert b"/Type3" not in data
        assert b"/Subtype /Image" not in data
    widths: list[float] = []
    monkeypatch.setattr(FIGURE, lambda figure, *_, **__: widths.append(figure.get_figwidth()))
    arva("plot", folder, "--paper", "--size", "7.16", "--out", tmp_path / "wide")
    assert widths == [7.16] * len(files)
    assert "a sheet has its own size: name a folder" in arva.refused(
        "plot", folder, "--paper", "--out", tmp_path / "sheet.pdf"
    )


@pytest.mark.undrawn
def test_a_folder_that_cannot_be_made_and_two_kinds_at_once_are_refused(arva: Arva, tmp_path: Path) -> None:
    run = write(tmp_path / "flight", 0, search=False)
    assert (
        arva.refused("plot", run, "--out", tmp_path / "x.svg", "--format", "png")
        == f"arva-hil: --format png: --out {tmp_path}/x.svg says svg: leave one of them out\n"
    )
    assert (
        arva.refused("plot", run, "--out", run / "run.json" / "x")
        == f"arva-hil: {run}/run.json/x: cannot be made a folder: Not a directory\n"
    )


def test_without_matplotlib_it_says_how_to_get_it(arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    run = write(tmp_path / "flight", 3)
    err = arva.refused("plot", run, "--out", tmp_path / "x.png")
    assert err == "arva-hil: plot needs matplotlib, which is missing: pip install 'arva-hil[plots]'\n"
    assert not (tmp_path / "x.png").exists()
    assert arva.refused("plot", run) == err
    assert not (run / "plots").exists()


def test_the_charts_of_a_campaign_are_drawn(arva: Arva, tmp_path: Path) -> None:
    with results.opened(tmp_path / "results") as kept:
        kept.add(*(row(one, fake(one.trial)) for one in planned()))
    err = arva.refused("plot", tmp_path / "results")
    assert "the campaign is not complete, or of an older arva-hil: run the same command of `campaign` again" in err
    with results.opened(tmp_path / "results") as kept:
        kept.keep_plan([one.key for one in planned()], 1.5)
    assert arva("plot", tmp_path / "results", "--format", "png", "--out", tmp_path / "charts").out == ""
    drawn = sorted(path.name for path in (tmp_path / "charts").iterdir())
    assert drawn[:3] == ["differences-on-the-same-trials.png", "error-of-the-place-reported.png", "success.png"]
    assert all((tmp_path / "charts" / name).read_bytes().startswith(b"\x89PNG") for name in drawn)
    assert (
        arva.refused("plot", tmp_path / "results", "--out", tmp_path / "sheet.png")
        == f"arva-hil: --out {tmp_path}/sheet.png: a campaign has a file for each chart: name a folder\n"
    )


@pytest.mark.undrawn
def test_the_table_of_a_campaign_is_of_its_plan_in_whatever_order_the_trials_ended(arva: Arva, tmp_path: Path) -> None:
    plan, other = planned(), planned(PLAN.replace("seeds: 6", "seeds: [77]"))
    with results.opened(tmp_path / "results") as kept:
        kept.add(*(row(one, fake(one.trial)) for one in [*other, *plan[::-1]]))
        kept.keep_plan([one.key for one in plan], 2.0)
    arva("plot", tmp_path / "results", "--latex", "--out", tmp_path / "charts")
    table = (tmp_path / "charts" / "table.tex").read_text()
    assert table == report.latex([row(one, fake(one.trial)) for one in plan], 2.0)
    assert "% estimate against flux on 12 trials: " in table


# -- `arva-hil report`: a page about a record, two, or those in a folder ---------------------------------------


@pytest.mark.undrawn
def test_the_page_is_in_the_record_or_where_it_is_wanted(arva: Arva, tmp_path: Path) -> None:
    run = write(tmp_path / "flight", 0, search=False)
    assert arva("report", run) == (0, "", f"written: {run}/report.html\n")
    assert (run / "report.html").read_text().count("data:image/svg+xml;base64,") == 5
    assert arva("report", run, "--out", tmp_path / "x.html").err == f"written: {tmp_path}/x.html\n"
    assert (tmp_path / "x.html").read_text().startswith("<!doctype html>")


def test_two_records_and_those_of_a_folder_are_on_one_page(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "pictures", lambda *_, **__: [])
    one, two = write(tmp_path / "one", 3), write(tmp_path / "two", 4)
    arva("report", one, two, "--out", tmp_path / "x.html")
    assert arva("report", tmp_path).err == f"written: {tmp_path}/report.html\n"
    assert (tmp_path / "report.html").read_text() == (tmp_path / "x.html").read_text()
    for n in range(12):
        write(tmp_path / f"more-{n:02}", 1, search=False)
    assert f"note: {tmp_path} holds 14 records: the report has the first 12" in arva("report", tmp_path).err


@pytest.mark.undrawn
def test_a_folder_without_a_record_and_a_file_of_the_record_are_refused(arva: Arva, tmp_path: Path) -> None:
    assert (
        arva.refused("report", tmp_path)
        == f"arva-hil: {tmp_path}: there is no run.json and no search.csv in it; name one that --record has written\n"
    )
    run = write(tmp_path / "flight", 0, search=False)
    assert (
        arva.refused("report", run, tmp_path / "nowhere")
        == f"arva-hil: {tmp_path}/nowhere: no such folder; name one that --record has written\n"
    )
    assert (
        arva.refused("report", run, "--out", run / "run.json")
        == f"arva-hil: {run}/run.json: this is a file of the record itself: name another one\n"
    )


@pytest.mark.undrawn
def test_the_page_of_view_does_not_replace_the_record_or_the_log_it_shows(arva: Arva, tmp_path: Path) -> None:
    run = write(tmp_path / "flight", 0, search=False)
    before = (run / "run.json").read_bytes()
    assert (
        arva("view", run, "--out", run / "run.json", code=2).err.splitlines()[-1]
        == f"arva-hil: {run}/run.json: this is a file of the record itself: name another one"
    )
    assert (run / "run.json").read_bytes() == before
    (log := tmp_path / "x.tlog").write_bytes(b"flight")
    assert arva.refused("view", log, "--out", log) == (
        f"arva-hil: --out {log}: this is the log itself: name another file\n"
    )
    assert log.read_bytes() == b"flight"


def test_a_page_typed_is_stronger_than_a_file_of_the_environment(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, file = write(tmp_path / "flight", 0, search=False), tmp_path / "flight.html"
    monkeypatch.setenv("ARVA_HIL_OUT", str(file))
    assert "page: http://127.0.0.1:" in arva("view", run, "--web", "127.0.0.1:0", "--duration", 0.01).err
    assert "page: http://127.0.0.1:" in arva("view", run, "--duration", 0.01).err
    assert not file.exists()
    assert "page: " not in arva("view", run, "--web", "off").err
    assert file.exists()


@pytest.mark.parametrize("usual", ["on", "off"])
def test_view_has_its_page_whatever_the_environment_says_of_other_runs(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, usual: str
) -> None:
    run = write(tmp_path / "flight", 0, search=False)
    monkeypatch.setenv("ARVA_HIL_WEB", usual)
    assert re.search(r"^page: http://127\.0\.0\.1:\d+/", arva("view", run, "--duration", 0.01).err, re.MULTILINE)
    assert arva.refused("view", run, "--web", "off") == (
        "arva-hil: --web off: this command serves the page: leave it out, or name a file with --out FILE\n"
    )


# -- `arva-hil export`: a record, a format, a file -------------------------------------------------------------


@pytest.mark.parametrize("name", EXPORTS)
def test_a_record_is_written_in_each_format_named_or_by_the_name_of_the_file(
    name: str, arva: Arva, tmp_path: Path
) -> None:
    run = write(tmp_path / "flight", 5)
    path = tmp_path / f"flight.{name}"
    assert arva("export", run, "--out", path) == (0, "", f"written: {path}\n")
    arva("export", run, "--format", name, "--out", tmp_path / "other")
    assert (tmp_path / "other").read_bytes() == path.read_bytes() != b""
    before = sorted(tmp_path.iterdir())
    arva("export", run, "--out", path)  # again: it is replaced
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "--out is missing"),
        (["--out", "flight"], "--format is missing: choose kml, gpx, geojson, csv"),
        (["--out", "flight.kmz"], "--format is missing"),
        (["--out", "x", "--format", "kmll"], "no export format 'kmll': did you mean kml?"),
    ],
)
def test_a_wrong_option_is_told_with_the_cure(words: list[str], said: str, arva: Arva, tmp_path: Path) -> None:
    assert said in arva.refused("export", write(tmp_path / "flight", 3), *words)


def test_what_is_no_record_a_folder_for_a_file_and_a_file_of_the_record_are_refused(arva: Arva, tmp_path: Path) -> None:
    assert (
        arva.refused("export", tmp_path / "none", "--out", tmp_path / "x.kml")
        == f"arva-hil: {tmp_path}/none: no such folder; name one that --record has written\n"
    )
    run = write(tmp_path / "flight", 3)
    before = (run / "readings.csv").read_bytes()
    assert (
        arva.refused("export", run, "--format", "csv", "--out", run / "readings.csv")
        == f"arva-hil: {run}/readings.csv: this is a file of the record itself: name another one\n"
    )
    assert (run / "readings.csv").read_bytes() == before
    assert (
        arva.refused("export", run, "--out", tmp_path / "nowhere" / "x.kml")
        == f"arva-hil: {tmp_path}/nowhere/x.kml: cannot be written: No such file or directory\n"
    )


def test_a_cut_record_is_used_and_a_note_says_so(arva: Arva, tmp_path: Path) -> None:
    run = write(tmp_path / "flight", 5)
    (run / "readings.csv").write_bytes((run / "readings.csv").read_bytes()[:-5])
    err = arva("export", run, "--out", tmp_path / "x.csv").err
    assert f"note: {run}/readings.csv: the last frame is cut, what is before it is used\n" in err
    assert (tmp_path / "x.csv").read_text().count("\n") == 1 + 4 * 4


def test_a_missing_package_is_told_with_its_extra(arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def needing(recording: object, out: object) -> None:
        import no_such_package  # type: ignore[import-not-found]  # noqa: F401

    monkeypatch.setitem(EXPORTS.loaded, "kml", needing)
    err = arva.refused("export", write(tmp_path / "flight", 3), "--out", tmp_path / "x.kml")
    assert err == "arva-hil: --format kml needs no_such_package, which is missing: pip install 'arva-hil[kml]'\n"
    assert not (tmp_path / "x.kml").exists()


@pytest.mark.parametrize("name", EXPORTS)
def test_what_a_pipe_gets_is_what_a_file_gets(name: str, arva: Arva, start: Callable[..., Any], tmp_path: Path) -> None:
    run = write(tmp_path / "flight", 5)
    arva("export", run, "--format", name, "--out", tmp_path / "file")
    program = start("export", run, "--format", name, "--out", "-", stdout=subprocess.PIPE)
    assert program.process.stdout.read() == (tmp_path / "file").read_bytes()
    program.ends()


# -- `arva-hil range-test`: a data sheet on stdout, and in a folder with its picture ---------------------------


@pytest.fixture
def few_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Along search strips, which take most of the time."""
    monkeypatch.setattr(range_test, "_PASSES", 2)


@pytest.mark.usefixtures("few_passes")
def test_it_prints_a_sheet_and_leaves_it_with_a_table_and_a_picture_in_a_folder(arva: Arva, tmp_path: Path) -> None:
    _, out, err = arva("range-test", "--walks", 2, "--seed", 3, "--out", tmp_path / "sheet")
    assert out.startswith("range test of receiver: model paper, 1 Hz; scenario default scenario\n")
    assert "2 walks a coupling at 1 m/s, 3 m above the transmitter; stable: no gap for 10 s; seeds from 3 on" in out
    assert [line.rpartition("/")[2] for line in err.splitlines()] == [
        "range-test.txt",
        "range-test.csv",
        "range-test.png",
    ]
    assert (tmp_path / "sheet" / "range-test.txt").read_text() == out
    assert len(table(tmp_path / "sheet" / "range-test.csv")) == 6
    assert (tmp_path / "sheet" / "range-test.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("few_passes")
def test_the_seed_that_is_typed_is_that_of_every_receiver(arva: Arva) -> None:
    out = arva("range-test", "--scenario", "builtin:two_vehicles", "--seed", 9, "--walks", 1).out
    assert out.count("seeds from 9 on") == 3


@pytest.mark.usefixtures("few_passes")
def test_each_receiver_of_a_scenario_has_a_sheet_of_its_own(arva: Arva) -> None:
    out = arva("range-test", "--scenario", "builtin:two_vehicles", "--walks", 1, "--json").out
    sheets = [json.loads(line) for line in out.splitlines()]
    assert len(sheets) > 1
    assert len({sheet["receiver"] for sheet in sheets}) == len(sheets)


def test_what_is_wrong_is_told_before_anybody_walks(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "none.yaml" in arva.refused("range-test", "--scenario", tmp_path / "none.yaml")
    arva("range-test", "--walks", "0", code=2)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert arva.refused("range-test", "--out", tmp_path / "sheet") == (
        "arva-hil: the picture of --out needs matplotlib, which is missing: pip install 'arva-hil[plots]'\n"
    )
