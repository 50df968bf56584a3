"""`arva-hil export`: a record, a format, a file."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from arva_hil.registry import EXPORTS
from tests.made_records import write

from .far_ends import Arva


@pytest.mark.parametrize("name", EXPORTS)
def test_a_record_is_written_in_each_format_named_or_by_the_name_of_the_file(
    name: str, arva: Arva, tmp_path: Path
) -> None:
    run = write(tmp_path / "flight", 5)
    path = tmp_path / f"flight.{name}"
    assert arva("export", run, "--out", path) == (0, "", f"written: {path}\n")
    assert arva("export", run, "--format", name, "--out", tmp_path / "other").code == 0
    assert (tmp_path / "other").read_bytes() == path.read_bytes() != b""
    before = sorted(tmp_path.iterdir())
    assert arva("export", run, "--out", path).code == 0  # again: it is replaced
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
    code, out, err = arva("export", write(tmp_path / "flight", 3), *words)
    assert (code, out) == (2, "")
    assert said in err


def test_what_is_no_record_a_folder_for_a_file_and_a_file_of_the_record_are_refused(arva: Arva, tmp_path: Path) -> None:
    code, _, err = arva("export", tmp_path / "none", "--out", tmp_path / "x.kml")
    assert (code, err) == (2, f"arva-hil: {tmp_path}/none: no such folder; name one that --record has written\n")
    run = write(tmp_path / "flight", 3)
    before = (run / "readings.csv").read_bytes()
    code, _, err = arva("export", run, "--format", "csv", "--out", run / "readings.csv")
    assert (code, err) == (2, f"arva-hil: {run}/readings.csv: this is a file of the record itself: name another one\n")
    assert (run / "readings.csv").read_bytes() == before
    code, _, err = arva("export", run, "--out", tmp_path / "nowhere" / "x.kml")
    assert (code, err) == (1, f"arva-hil: {tmp_path}/nowhere/x.kml: cannot be written: No such file or directory\n")


def test_a_cut_record_is_used_and_a_note_says_so(arva: Arva, tmp_path: Path) -> None:
    run = write(tmp_path / "flight", 5)
    (run / "readings.csv").write_bytes((run / "readings.csv").read_bytes()[:-5])
    code, _, err = arva("export", run, "--out", tmp_path / "x.csv")
    assert code == 0
    assert f"note: {run}/readings.csv: the last frame is cut, what is before it is used\n" in err
    assert (tmp_path / "x.csv").read_text().count("\n") == 1 + 4 * 4


def test_a_missing_package_is_told_with_its_extra(arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def needing(recording: object, out: object) -> None:
        import no_such_package  # type: ignore[import-not-found]  # noqa: F401

    monkeypatch.setitem(EXPORTS.loaded, "kml", needing)
    code, _, err = arva("export", write(tmp_path / "flight", 3), "--out", tmp_path / "x.kml")
    assert code == 2
    assert err == "arva-hil: --format kml needs no_such_package, which is missing: pip install 'arva-hil[kml]'\n"
    assert not (tmp_path / "x.kml").exists()


@pytest.mark.parametrize("name", EXPORTS)
def test_what_a_pipe_gets_is_what_a_file_gets(name: str, arva: Arva, start: Callable[..., Any], tmp_path: Path) -> None:
    run = write(tmp_path / "flight", 5)
    assert arva("export", run, "--format", name, "--out", tmp_path / "file").code == 0
    program = start("export", run, "--format", name, "--out", "-", stdout=subprocess.PIPE)
    assert program.process.stdout.read() == (tmp_path / "file").read_bytes()
    assert program.ends() == 0
