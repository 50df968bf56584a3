"""Measures our speed and that of other libraries, and prints one table.

    python -m tools bench --flight px4.tlog [--json FILE] [--check BASELINE]
                          [model streams live loops starts fleet]

`--check` lists the rows that are slower than in a file of `--json`; the exit code is then 1, also if no row can be
compared. It also lists differences of machine, Python and commit. Each cost is the least of several measurements, of
processor time by default, and ours is measured beside its peer's.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from tools.bench.table import Baseline, Row, conditions, differs, read, show, slower, write
from tools.options import parser


def _rows(module: str, function: str, options: argparse.Namespace) -> Iterator[Row]:
    """Measure a group by a function of a module of this folder, imported when it is wanted."""
    rows: Iterator[Row] = getattr(importlib.import_module(f"tools.bench.{module}"), function)(options)
    return rows


_GROUPS: dict[str, Callable[[argparse.Namespace], Iterator[Row]]] = {
    "model": partial(_rows, "model", "rows"),
    **{name: partial(_rows, "commands", name) for name in ("streams", "live", "loops", "starts")},
    "fleet": partial(_rows, "fleet", "rows"),
}
_LEAST_S = 5.0  # shortest live flight, without its start


def main() -> int:
    made = parser(
        __doc__,
        flight=(Path, "a recorded flight at 50 Hz"),
        seconds=(20.0, "of each live flight"),
        json=(Path, "write the rows here"),
        check=(Path, "name what got slower than in this file"),
    )
    made.add_argument("groups", nargs="*", metavar="GROUP", help=f"of {', '.join(_GROUPS)}; default: all")
    options = made.parse_args()
    groups = options.groups or list(_GROUPS)
    if unknown := [name for name in groups if name not in _GROUPS]:
        made.error(f"{unknown[0]}: no such group; there are {', '.join(_GROUPS)}")
    if options.flight is None and "streams" in groups:
        made.error("--flight: which recorded flight?")
    if options.flight is not None and not options.flight.is_file():
        made.error(f"--flight: {options.flight}: no such file")
    if "live" in groups and options.seconds < _LEAST_S:
        made.error(f"--seconds {options.seconds:g}: {_LEAST_S:g} at least, or live has too few frames to judge")
    try:
        before = read(options.check) if options.check else None
    except ValueError as error:
        made.error(str(error))
    rows = [row for name in groups for row in _told(_GROUPS[name](options))]
    show(rows)
    if options.json:
        write(rows, options.json)
    return _checked(rows, before, options.check) if before else 0


def _checked(rows: list[Row], before: Baseline, path: Path) -> int:
    """Print the slower rows, and those that cannot be compared. Returns the exit code."""
    for words in differs(before.conditions, conditions()):
        print(f"{path}: measured with another {words}")
    for row in rows:
        if row.work not in before.rows:
            print(f"not compared: {row.work}: {path} has no such row")
    for words in (worse := slower(rows, before.rows)):
        print(f"slower: {words}")
    compared = any(row.work in before.rows for row in rows)
    if not compared:
        print(f"error: {path} has none of these rows: nothing was compared")
    return int(bool(worse) or not compared)


def _told(rows: Iterator[Row]) -> Iterator[Row]:
    """Yield rows, and print each on stderr: the whole takes minutes."""
    for row in rows:
        print(row.line(), file=sys.stderr, flush=True)
        yield row
