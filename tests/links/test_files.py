"""Files that are written: new, growing or replaced as a whole, and never through a symlink."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from arva_hil.links import files


@pytest.fixture
def elsewhere(tmp_path: Path) -> Path:
    """Somebody's file, which a symlink in the folder leads to."""
    (tmp_path / "folder").mkdir()
    file = tmp_path / "of somebody"
    file.write_bytes(b"mine")
    return file


@pytest.mark.parametrize("target", ["of somebody", "not there yet"])
def test_a_new_file_is_not_made_through_a_symlink(tmp_path: Path, elsewhere: Path, target: str) -> None:
    link = elsewhere.parent / "folder" / "link"
    link.symlink_to(tmp_path / target)
    assert link.is_symlink()
    with pytest.raises(FileExistsError):
        files.create(link)
    assert not (tmp_path / "not there yet").exists()
    assert elsewhere.read_bytes() == b"mine"


@pytest.mark.parametrize("target", ["of somebody", "not there yet"])
def test_a_file_does_not_grow_through_a_symlink(tmp_path: Path, elsewhere: Path, target: str) -> None:
    link = elsewhere.parent / "folder" / "link"
    link.symlink_to(tmp_path / target)
    with pytest.raises(OSError, match="is a symlink, and this program does not write through symlinks"):
        files.grow(link)
    assert not (tmp_path / "not there yet").exists()
    assert elsewhere.read_bytes() == b"mine"


def test_what_is_replaced_is_the_symlink_and_not_what_it_leads_to(elsewhere: Path) -> None:
    link = elsewhere.parent / "folder" / "link"
    link.symlink_to(elsewhere)
    (elsewhere.parent / "folder" / "link.new").symlink_to(elsewhere)
    files.replace(link, b"ours")
    assert elsewhere.read_bytes() == b"mine"
    assert not link.is_symlink()
    assert link.read_bytes() == b"ours"
    assert os.listdir(link.parent) == ["link"]


def test_the_folder_may_be_a_symlink(tmp_path: Path, elsewhere: Path) -> None:
    folder = tmp_path / "link to folder"
    folder.symlink_to(tmp_path / "folder")
    with files.create(folder / "new") as new, files.grow(folder / "growing") as growing:
        new.write(b"1")
        growing.write(b"2")
    files.replace(folder / "replaced", b"3")
    assert {path.name: path.read_bytes() for path in (tmp_path / "folder").iterdir()} == {
        "new": b"1",
        "growing": b"2",
        "replaced": b"3",
    }


def test_a_growing_file_keeps_what_it_held(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"old ")
    with files.grow(tmp_path / "file") as file:
        file.write(b"new")
    assert (tmp_path / "file").read_bytes() == b"old new"


def test_a_pipe_is_no_file_that_grows_and_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="is not a regular file"):
        files.grow(tmp_path / "pipe")


@pytest.mark.parametrize("name", ["pipe", "link to pipe", "."])
def test_a_pipe_a_device_or_a_folder_is_no_file_that_is_replaced(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link to pipe").symlink_to("pipe")
    with pytest.raises(OSError, match="is not a regular file"), files.replacing(tmp_path / name):
        pytest.fail("it was opened")
    assert not (tmp_path / name).is_file()
    assert sorted(os.listdir(tmp_path)) == ["link to pipe", "pipe"]


def test_a_file_that_cannot_be_replaced_stays_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(28, os.strerror(28))

    (tmp_path / "file").write_bytes(b"old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        files.replace(tmp_path / "file", b"new")
    assert (tmp_path / "file").read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["file"]


def test_a_replaced_file_has_the_mode_asked_for(tmp_path: Path) -> None:
    files.replace(tmp_path / "file", b"secret", 0o600)
    assert (tmp_path / "file").stat().st_mode & 0o777 == 0o600
