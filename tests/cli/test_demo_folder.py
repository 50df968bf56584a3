"""A demo without --record: its folder is named, and those of earlier ones do not pile up."""

from __future__ import annotations

import os
import re
import tempfile
import time
from pathlib import Path

import pytest

from arva_hil.cli.demo import new_folder

from .far_ends import Arva

WEEK_S = 7 * 86400


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def folder(path: Path, age_s: float, *names: str) -> Path:
    path.mkdir()
    for name in names:
        (path / name).touch()
    os.utime(path, (time.time() - age_s,) * 2)
    return path


def test_a_demo_says_where_its_record_is_and_for_how_long(arva: Arva, temporary: Path) -> None:
    code, _, err = arva("demo", "--speed", "max", "--headless", "--limit", 1)
    assert code == 1
    (made,) = temporary.iterdir()
    assert re.fullmatch(r"arva-demo-\d{8}T\d{6}-\w+", made.name)
    assert err.startswith(f"record: {made}, kept for 7 days; --record DIR keeps it elsewhere\n")
    assert (made / "run.json").exists()


def test_an_old_demos_folder_is_removed_and_a_younger_one_is_kept(temporary: Path) -> None:
    old = folder(temporary / "arva-demo-a", WEEK_S + 100, "run.json", "frames.csv", "search.csv", "search.png")
    young = folder(temporary / "arva-demo-b", WEEK_S - 100, "run.json")
    made = new_folder()
    assert not old.exists()
    assert (young / "run.json").exists()
    assert made.is_dir()


@pytest.mark.parametrize("kind", ["holds a file of the user's", "has another name", "is a symlink", "is a file"])
def test_what_is_not_a_demos_stays_whole(temporary: Path, kind: str) -> None:
    name = "my-results" if kind == "has another name" else "arva-demo-a"
    theirs = [*["notes.txt"][: kind.startswith("holds")], "run.json"]
    path = folder(temporary / name, 2 * WEEK_S, *theirs)
    if kind == "is a symlink":
        path.rename(temporary / "elsewhere")
        path.symlink_to(temporary / "elsewhere")
        os.utime(path, (0, 0), follow_symlinks=False)
    elif kind == "is a file":
        (path / "run.json").rename(temporary / "file")
        path.rmdir()
        (temporary / "file").rename(path)
        os.utime(path, (0, 0))
    new_folder()
    assert path.exists()
    assert kind == "is a file" or sorted(os.listdir(path)) == sorted(theirs)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_another_users_folder_stays(temporary: Path) -> None:
    path = folder(temporary / "arva-demo-a", 2 * WEEK_S, "run.json")
    os.chown(path, 12345, 12345)
    os.utime(path, (0, 0))
    new_folder()
    assert (path / "run.json").exists()
