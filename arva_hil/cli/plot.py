"""`arva-hil plot`: draws a record or a campaign, on one sheet or in a file for each picture."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from arva_hil.cli.outcome import UsageError
from arva_hil.cli.recorded import is_campaign, loaded, make_folder, needing, write
from arva_hil.records.pictures.run import pictures, sheets
from arva_hil.records.pictures.style import COLUMN_IN, FORMATS, Format, Print


def main(options: argparse.Namespace) -> None:
    out = Path(options.out or Path(options.run) / "plots")
    sheet = next((one for one in FORMATS if out.suffix.lower() == f".{one}" and not out.is_dir()), None)
    if sheet and options.picture_format not in (None, sheet):
        raise UsageError(f"--format {options.picture_format}: --out {out} says {sheet}: leave one of them out")
    format: Format = sheet or options.picture_format or ("pdf" if options.paper else "png")
    if sheet and (options.paper or options.size or options.dpi):
        raise UsageError(
            f"--out {out}: a sheet has its own size: name a folder, or leave out --paper, --size and --dpi"
        )
    if options.dpi and format != "png":
        raise UsageError(f"--dpi: of PNG, and the pictures are {format}: leave it out")
    form = Print(options.size or (COLUMN_IN if options.paper else None), options.dpi, options.paper)
    if is_campaign(options.run):
        _campaign(options, out, format, sheet, form)
        return
    if options.latex:
        raise UsageError(f"--latex: {options.run} is a record: the table is of a campaign")
    recording = loaded(options.run)
    with needing("plots", "plot"):
        if sheet:
            drawn = [(_named(out, receiver), data) for receiver, data in sheets(recording, format)]
        else:
            drawn = [
                (_named(out / f"{name}.{format}", receiver), data)
                for receiver, name, data in pictures(recording, format, form=form)
            ]
    if not sheet:
        make_folder(out)
    for path, data in drawn:
        write(path, data, recording)


def _campaign(options: argparse.Namespace, out: Path, format: Format, sheet: str | None, form: Print) -> None:
    """Draw the charts of a campaign's results into a folder."""
    from arva_hil.campaign import charts, report, results  # slow to import

    if sheet:
        raise UsageError(f"--out {out}: a campaign has a file for each chart: name a folder")
    with results.opened(Path(options.run)) as kept, needing("plots", "plot"):
        rows = kept.planned()
        drawn = charts.draw(*rows, format, form)
    make_folder(out)
    for caption, data in drawn.items():
        name = re.sub("[^a-z]+", "-", re.split("[,:(]", caption.lower())[0]).strip("-")
        write(out / f"{name}.{format}", data)
    if options.latex:
        write(out / "table.tex", report.latex(*rows).encode())


def _named(path: Path, receiver: str) -> Path:
    """Return the file of a receiver's picture: with one receiver the path itself. No name has a +."""
    return path.with_name(f"{receiver.replace('/', '+')}-{path.name}") if receiver else path
