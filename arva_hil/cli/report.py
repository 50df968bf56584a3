"""`arva-hil report`: a page about one record, or several beside each other."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from arva_hil.cli.options import CommandParser
from arva_hil.cli.outcome import OK
from arva_hil.cli.terminal import tell

_MOST: Final = 12  # runs on a page


def options(parser: CommandParser) -> None:
    """Write a report of a record: one HTML page that needs no other file, and can be sent by mail.

    RUN is a folder that --record has written. The page shows two records side by side, and all records of a folder
    of records. Its pictures need matplotlib: pip install 'arva-hil[plots]'.
    """
    parser.add_argument("run", metavar="RUN", help="folder of a record, or a folder with records in it")
    parser.add_argument("other", nargs="?", metavar="RUN2", help="another record, to compare")
    parser.option("--out FILE", "the page; default: report.html in RUN; - is stdout")


def main(options: argparse.Namespace) -> int:
    from arva_hil.cli.recorded import loaded, output
    from arva_hil.records.report.page import page

    recordings = [loaded(name) for name in _folders(options.run, options.other)]
    text = page(recordings).encode()
    with output(options.out or str(Path(options.run) / "report.html"), *recordings) as out:
        out.write(text)
    return OK


def _folders(run: str, other: str | None) -> list[str]:
    """Return the records for the report: the named ones, or those in a folder of records."""
    if other is not None:
        return [run, other]
    from arva_hil.records.reading import is_record

    folder = Path(run)
    if not run or is_record(folder) or not folder.is_dir():
        return [run]
    inside = sorted(path for path in folder.iterdir() if path.is_dir() and is_record(path))
    if len(inside) > _MOST:
        tell(f"note: {folder} holds {len(inside)} records: the report has the first {_MOST}")
    return [str(path) for path in inside[:_MOST]] or [run]
