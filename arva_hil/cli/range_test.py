"""`arva-hil range-test`: measures the range of the scenario's receivers."""

from __future__ import annotations

import argparse
import csv
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from arva_hil.cli.options import CommandParser, number, whole
from arva_hil.cli.outcome import OK
from arva_hil.cli.terminal import show, show_json
from arva_hil.config.ranges import LARGEST_SEED

if TYPE_CHECKING:
    from arva_hil.campaign.range_test.data_sheet import DataSheet
    from arva_hil.config import Scenario

_PASSES: Final = 100


def options(parser: CommandParser) -> None:
    """Carry the scenario's receiver towards its first transmitter, several times, and print its range.

    In three couplings: coaxial, turned by 90°, and with the dipole upright. Only stable signals count, as in the tests
    of receivers: a single signal from farther away does not. With --out it also writes range-test.txt, .csv and .png
    to a folder.
    """
    what = "scenario (YAML), or builtin:NAME, for its receivers and the strength of its first transmitter"
    parser.option("--scenario FILE", what)
    parser.option("--seed N", "seed of the first walk", whole(0, LARGEST_SEED))
    parser.option("--walks N", "walks in each coupling", whole(1, 1000), 10, environment=False)
    height, height_m = "height of the receiver above the transmitter", number(0, 100, " of m")
    parser.option("--height M", height, height_m, 3.0, environment=False, dest="range_height")
    speed = number(0.1, 30, " of m/s")
    parser.option("--speed M/S", "walking speed", speed, 1.0, environment=False, dest="walking_speed")
    stable = "a signal without a gap for this time is stable"
    parser.option("--stable S", stable, number(0, 1000, " of s"), 10.0, environment=False)
    parser.option("--out DIR", "folder for the data sheet and its picture")
    parser.option("--json", "print the data sheet as a JSON object for each receiver")


def main(options: argparse.Namespace) -> int:
    from arva_hil.campaign.range_test.data_sheet import as_dict, lines, measured  # slow, as those below
    from arva_hil.campaign.range_test.walk import RangePlan
    from arva_hil.cli.recorded import make_folder, needing

    plan = RangePlan(options.range_height, options.walking_speed, options.stable, options.walks, passes=_PASSES)
    if options.out:
        with needing("plots", "the picture of --out"):
            import matplotlib  # noqa: F401 (before minutes of walking)
        make_folder(Path(options.out))
    sheets = [measured(scenario, plan, name) for name, scenario in _receivers(options)]
    for n, sheet in enumerate(sheets):
        if options.json:
            show_json(as_dict(sheet))
            continue
        for line in ["", *lines(sheet)][n == 0 :]:
            show(line)
    if options.out:
        _write(Path(options.out), sheets)
    return OK


def _receivers(options: argparse.Namespace) -> list[tuple[str, Scenario]]:
    """Return each receiver of the scenario with its name, "" if it is the only one."""
    from arva_hil.config import DEFAULT, load
    from arva_hil.emulator.setup import scenario_of

    chosen = load(options.scenario) if options.scenario else DEFAULT
    if options.seed is not None:
        chosen = replace(chosen, seed=options.seed)
    every = [
        (f"{vehicle.name}/{receiver.name}", scenario_of(chosen, receiver))
        for vehicle in chosen.vehicles
        for receiver in vehicle.receivers
    ]
    return every or [("", chosen)]


def _write(folder: Path, sheets: Sequence[DataSheet]) -> None:
    from arva_hil.campaign.range_test.data_sheet import lines, table
    from arva_hil.campaign.range_test.picture import drawn
    from arva_hil.cli.recorded import write

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
