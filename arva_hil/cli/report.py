"""`arva-hil report`: a page about one record, or several beside each other."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from arva_hil.cli.recorded import loaded, output
from arva_hil.cli.terminal import tell
from arva_hil.records.reading import is_record
from arva_hil.records.report.page import page

_MOST: Final = 12  # runs on a page


def main(options: argparse.Namespace) -> None:
    recordings = [loaded(name) for name in _folders(options.run, options.other)]
    with output(options.out or str(Path(options.run) / "report.html"), *recordings) as out:
        out.write(page(recordings).encode())


def _folders(run: str, other: str | None) -> list[str]:
    """Return the records for the report: the named ones, or those in a folder of records."""
    if other is not None:
        return [run, other]

    folder = Path(run)
    if not run or is_record(folder) or not folder.is_dir():
        return [run]
    inside = sorted(path for path in folder.iterdir() if path.is_dir() and is_record(path))
    if len(inside) > _MOST:
        tell(f"note: {folder} holds {len(inside)} records: the report has the first {_MOST}")
    return [str(path) for path in inside[:_MOST]] or [run]
