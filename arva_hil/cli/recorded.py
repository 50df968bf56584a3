"""Common parts of commands that read records: loading one, writing a file, missing extras."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from arva_hil.cli.outcome import NotWritten, UsageError
from arva_hil.cli.terminal import binary_stdout, tell
from arva_hil.links import files
from arva_hil.records.reading import Recording, load


def loaded(folder: str) -> Recording:
    """Load the record in a folder, and print its notes. Raises UsageError and RecordingError."""
    if not folder:
        raise UsageError("the record's name is empty: write the folder that --record has written")
    recording = load(Path(folder))
    tell(*(f"note: {note}" for note in recording.notes))
    return recording


def is_campaign(folder: str) -> bool:
    """Return True for the folder of a campaign's results."""
    return os.path.isfile(Path(folder) / "results.sqlite")


@contextlib.contextmanager
def output(name: str, *recordings: Recording) -> Iterator[BinaryIO]:
    """Open a file that replaces the one of this name when it is complete; stdout for "-".

    Raises UsageError for one of the records' own files, and NotWritten.
    """
    if name == "-":
        with binary_stdout() as out:
            yield out
        return
    path = Path(name)
    own = [recording.folder / name for recording in recordings for name in recording.files]
    try:
        if any(path.exists() and one.exists() and path.samefile(one) for one in own):
            raise UsageError(f"{path}: this is a file of the record itself: name another one")
        with files.replacing(path) as out:
            yield out
    except OSError as error:
        raise NotWritten(path, error) from None
    tell(f"written: {path}")


def write(path: Path, data: bytes, *recordings: Recording) -> None:
    """Replace a file as a whole, as `output` does."""
    with output(str(path), *recordings) as out:
        out.write(data)


def make_folder(folder: Path) -> None:
    """Make a folder, if there is none. Raises NotWritten."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise NotWritten(folder, error, "made a folder") from None


@contextlib.contextmanager
def needing(extra: str, what: str) -> Iterator[None]:
    """Raise UsageError with the cure if an optional package is missing in the block."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "arva_hil").startswith("arva_hil"):
            raise
        raise UsageError(f"{what} needs {error.name}, which is missing: pip install 'arva-hil[{extra}]'") from None
