"""`arva-hil plot`: draws a record, on one sheet or in a file for each picture."""

from __future__ import annotations

import argparse
from pathlib import Path

from arva_hil.cli.outcome import OK, UsageError
from arva_hil.cli.recorded import loaded, make_folder, needing, write
from arva_hil.records.pictures.run import pictures, sheets
from arva_hil.records.pictures.style import FORMATS, Format


def main(options: argparse.Namespace) -> int:
    out = Path(options.out or Path(options.run) / "plots")
    sheet = next((one for one in FORMATS if out.suffix.lower() == f".{one}" and not out.is_dir()), None)
    if sheet and options.picture_format not in (None, sheet):
        raise UsageError(f"--format {options.picture_format}: --out {out} says {sheet}: leave one of them out")
    format: Format = sheet or options.picture_format or "png"
    recording = loaded(options.run)
    if not sheet:
        make_folder(out)
    with needing("plots", "plot"):
        if sheet:
            drawn = [(_named(out, receiver), data) for receiver, data in sheets(recording, format)]
        else:
            every = pictures(recording, format)
            drawn = [(_named(out / f"{name}.{format}", receiver), data) for receiver, name, data in every]
    for path, data in drawn:
        write(path, data, recording)
    return OK


def _named(path: Path, receiver: str) -> Path:
    """The file of a receiver's picture: with one receiver the path itself."""
    return path.with_name(f"{receiver.replace('/', '-')}-{path.name}") if receiver else path
