"""`arva-hil range-test`: measures the range of the scenario's receivers."""

from __future__ import annotations

import argparse
import csv
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from arva_hil.campaign.range_test.data_sheet import DataSheet, as_dict, lines, measured, table
from arva_hil.campaign.range_test.walk import RangePlan
from arva_hil.cli.recorded import make_folder, needing, write
from arva_hil.cli.terminal import show_one
from arva_hil.config import DEFAULT, Scenario, load
from arva_hil.emulator.setup import scenario_of

_PASSES: Final = 100


def main(options: argparse.Namespace) -> None:
    plan = RangePlan(options.range_height, options.walking_speed, options.stable, options.walks, passes=_PASSES)
    if options.out:
        with needing("plots", "the picture of --out"):
            import matplotlib  # noqa: F401 (before minutes of walking)
        make_folder(Path(options.out))
    sheets = [measured(scenario, plan, name) for name, scenario in _receivers(options)]
    for n, sheet in enumerate(sheets):
        show_one(as_dict(sheet), *["", *lines(sheet)][n == 0 :], as_json=options.json)
    if options.out:
        _write(Path(options.out), sheets)


def _receivers(options: argparse.Namespace) -> list[tuple[str, Scenario]]:
    """Return each receiver of the scenario with its name, "" if it is the only one."""
    chosen = load(options.scenario) if options.scenario else DEFAULT
    every = [
        (f"{vehicle.name}/{receiver.name}", scenario_of(chosen, receiver))
        for vehicle in chosen.vehicles
        for receiver in vehicle.receivers
    ] or [("", chosen)]
    if options.seed is None:
        return every
    return [(name, replace(scenario, seed=options.seed)) for name, scenario in every]


def _write(folder: Path, sheets: Sequence[DataSheet]) -> None:
    from arva_hil.campaign.range_test.picture import drawn

    rows = io.StringIO()
    csv.writer(rows, lineterminator="\n").writerows(table(sheets))
    text = "\n\n".join("\n".join(lines(sheet)) for sheet in sheets) + "\n"
    files = {
        "range-test.txt": text.encode(),
        "range-test.csv": rows.getvalue().encode(),
        "range-test.png": drawn(sheets),
    }
    for name, data in files.items():
        write(folder / name, data)
