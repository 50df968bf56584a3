"""`arva-hil plot`: draws a record or a campaign, on one sheet or in a file for each picture."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

from arva_hil.cli.options import CommandParser, number, whole
from arva_hil.cli.outcome import FAILED, OK, Failure, UsageError

if TYPE_CHECKING:
    from arva_hil.records.pictures.style import Format, Print


def options(parser: CommandParser) -> None:
    """Draw a record or a campaign.

    RUN is a folder that --record has written: track over flux lines, d against the true range, timeline, lateness,
    rates of the streams. Or it is the folder of a campaign's results: success, time, error. Needs matplotlib: pip
    install 'arva-hil[plots]'.
    """
    parser.add_argument("run", metavar="RUN", help="folder of a record or of a campaign's results")
    parser.option(
        "--out DIR|FILE",
        "folder for one file per picture, or a file name that ends with .png, .svg or .pdf for one sheet; "
        "default: the folder RUN/plots",
    )
    what, kinds = "format of the pictures in a folder; default png", ("png", "svg", "pdf")
    parser.option("--format", what, environment=False, dest="picture_format", choices=kinds)
    paper = "pictures for a paper: PDF, 3.5 inches wide, 8 points, embedded TrueType fonts, no titles"
    parser.option("--paper", paper, environment=False)
    size = "width of a picture, e.g. 7.16 for both columns"
    parser.option("--size INCHES", size, number(1, 20, " of inches"), environment=False)
    parser.option("--dpi N", "resolution of PNG", whole(50, 1200), environment=False)
    parser.option("--latex", "of a campaign also the table, table.tex, for LaTeX with booktabs", environment=False)


def main(options: argparse.Namespace) -> int:
    from arva_hil.cli.recorded import is_campaign, loaded, make_folder, needing, write  # slow, as those below
    from arva_hil.records.pictures.run import pictures, sheets
    from arva_hil.records.pictures.style import COLUMN_IN, FORMATS, Print

    out = Path(options.out or Path(options.run) / "plots")
    sheet = next((one for one in FORMATS if out.suffix.lower() == f".{one}" and not out.is_dir()), None)
    if sheet and options.picture_format not in (None, sheet):
        raise UsageError(f"--format {options.picture_format}: --out {out} says {sheet}: leave one of them out")
    format: Format = sheet or options.picture_format or ("pdf" if options.paper else "png")
    if sheet and (options.paper or options.size or options.dpi):
        raise UsageError(
            f"--out {out}: a sheet has its own size: name a folder, or leave out --paper, --size and --dpi"
        )
    form = Print(options.size or (COLUMN_IN if options.paper else None), options.dpi, options.paper)
    if is_campaign(options.run):
        return _campaign(options, out, format, sheet, form)
    if options.latex:
        raise UsageError(f"--latex: {options.run} is a record: the table is of a campaign")
    recording = loaded(options.run)
    with needing("plots", "plot"):
        if sheet:
            drawn = [(_named(out, receiver), data) for receiver, data in sheets(recording, format)]
        else:
            every = pictures(recording, format, form=form)
            drawn = [(_named(out / f"{name}.{format}", receiver), data) for receiver, name, data in every]
    if not sheet:
        make_folder(out)
    for path, data in drawn:
        write(path, data, recording)
    return OK


def _campaign(options: argparse.Namespace, out: Path, format: Format, sheet: str | None, form: Print) -> int:
    """Draw the charts of a campaign's results into a folder."""
    from arva_hil.campaign import charts, report, results
    from arva_hil.cli.recorded import make_folder, needing, write

    if sheet:
        raise UsageError(f"--out {out}: a campaign has a file for each chart: name a folder")
    try:
        with results.opened(Path(options.run)) as kept, needing("plots", "plot"):
            rows = list(kept.rows.values()), kept.success_m()
            drawn = charts.draw(*rows, format, form)
    except results.ResultsError as error:
        raise Failure(FAILED, error) from None
    make_folder(out)
    for caption, data in drawn.items():
        name = re.sub("[^a-z]+", "-", re.split("[,:(]", caption.lower())[0]).strip("-")
        write(out / f"{name}.{format}", data)
    if options.latex:
        write(out / "table.tex", report.latex(*rows).encode())
    return OK


def _named(path: Path, receiver: str) -> Path:
    """Return the file of a receiver's picture: with one receiver the path itself."""
    return path.with_name(f"{receiver.replace('/', '-')}-{path.name}") if receiver else path
