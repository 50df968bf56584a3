"""`arva-hil plot`: a sheet, or a folder of pictures."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from arva_hil.campaign import results
from arva_hil.campaign.results import row
from tests.campaign.fakes import fake, planned
from tests.made_records import write

from .far_ends import Arva


def test_a_sheet_is_of_the_kind_that_its_name_says(arva: Arva, tmp_path: Path) -> None:
    run = write(tmp_path / "flight", 0, search=False)
    for name, begins in {"b.svg": b"<?xml", "c.PDF": b"%PDF"}.items():
        assert arva("plot", run, "--out", tmp_path / name) == (0, "", f"written: {tmp_path / name}\n")
        assert (tmp_path / name).read_bytes().startswith(begins)


@pytest.mark.undrawn
def test_without_out_each_picture_is_a_file_in_the_record(arva: Arva, tmp_path: Path) -> None:
    run = write(tmp_path / "flight", 0, search=False)
    assert arva("plot", run, "--format", "svg").code == 0
    assert sorted(path.name for path in (run / "plots").iterdir()) == [
        "distance.svg",
        "lateness.svg",
        "map.svg",
        "streams.svg",
        "timeline.svg",
    ]


def test_pictures_for_a_paper_have_its_size_and_truetype_fonts_and_no_pixels(arva: Arva, tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", 5)
    for width, more in ((3.5, []), (7.16, ["--size", "7.16"])):
        code, _, err = arva("plot", folder, "--paper", *more, "--out", tmp_path / f"{width}")
        assert code == 0, err
        files = list((tmp_path / f"{width}").iterdir())
        assert {file.name for file in files} >= {"map.pdf", "distance.pdf", "timeline.pdf"}
        for file in files:
            data = file.read_bytes()
            box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ", data)
            assert box is not None
            assert float(box[1]) == pytest.approx(72 * width, abs=0.1)
            assert b"/FontFile2" in data  # TrueType
            assert b"/Type3" not in data
            assert b"/Subtype /Image" not in data
    code, _, err = arva("plot", folder, "--paper", "--out", tmp_path / "sheet.pdf")
    assert code == 2
    assert "a sheet has its own size: name a folder" in err


@pytest.mark.undrawn
def test_a_folder_that_cannot_be_made_and_two_kinds_at_once_are_refused(arva: Arva, tmp_path: Path) -> None:
    run = write(tmp_path / "flight", 0, search=False)
    code, _, err = arva("plot", run, "--out", tmp_path / "x.svg", "--format", "png")
    assert (code, err) == (
        2,
        f"arva-hil: --format png: --out {tmp_path}/x.svg says svg: leave one of them out\n",
    )
    code, _, err = arva("plot", run, "--out", run / "run.json" / "x")
    assert (code, err) == (1, f"arva-hil: {run}/run.json/x: cannot be made: Not a directory\n")


def test_without_matplotlib_it_says_how_to_get_it(arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    code, _, err = arva("plot", write(tmp_path / "flight", 3), "--out", tmp_path / "x.png")
    assert code == 2
    assert err == "arva-hil: plot needs matplotlib, which is missing: pip install 'arva-hil[plots]'\n"
    assert not (tmp_path / "x.png").exists()


def test_a_folder_is_made_only_if_there_are_pictures(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = write(tmp_path / "flight", 3)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert arva("plot", run).code == 2
    assert not (run / "plots").exists()


def test_the_charts_of_a_campaign_are_drawn(arva: Arva, tmp_path: Path) -> None:
    with results.opened(tmp_path / "results") as kept:
        kept.add(*(row(one, fake(one.trial)) for one in planned()))
    code, _, err = arva("plot", tmp_path / "results")
    assert code == 1
    assert "the campaign is not complete, or of an older arva-hil: run the same command of `campaign` again" in err
    with results.opened(tmp_path / "results") as kept:
        kept.keep_success(1.5)
    ran = arva("plot", tmp_path / "results", "--format", "png", "--out", tmp_path / "charts")
    assert (ran.code, ran.out) == (0, "")
    drawn = sorted(path.name for path in (tmp_path / "charts").iterdir())
    assert drawn[:3] == ["differences-on-the-same-trials.png", "error-of-the-place-reported.png", "success.png"]
    assert all((tmp_path / "charts" / name).read_bytes().startswith(b"\x89PNG") for name in drawn)
    code, _, err = arva("plot", tmp_path / "results", "--out", tmp_path / "sheet.png")
    assert (code, err) == (
        2,
        f"arva-hil: --out {tmp_path}/sheet.png: a campaign has a file for each chart: name a folder\n",
    )
