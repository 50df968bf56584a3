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


def _rows(group: str, options: argparse.Namespace) -> Iterator[Row]:
    """Measure a group: a module of this folder, imported when it is wanted."""
    rows: Iterator[Row] = importlib.import_module(f"tools.bench.{group}").rows(options)
    return rows


_GROUPS: dict[str, Callable[[argparse.Namespace], Iterator[Row]]] = {
    name: partial(_rows, name) for name in ("model", "streams", "live", "loops", "starts", "fleet")
}
_LEAST_S = 5.0  # shortest live flight, without its start


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("groups", nargs="*", metavar="GROUP", help=f"of {', '.join(_GROUPS)}; default: all")
    parser.add_argument("--flight", type=Path, metavar="FLIGHT.tlog", help="a recorded flight at 50 Hz")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each live flight; default 20")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows here")
    parser.add_argument("--check", type=Path, metavar="BASELINE", help="name what got slower than there")
    options = parser.parse_args()
    groups = options.groups or list(_GROUPS)
    if unknown := [name for name in groups if name not in _GROUPS]:
        parser.error(f"{unknown[0]}: no such group; there are {', '.join(_GROUPS)}")
    if options.flight is None and "streams" in groups:
        parser.error("--flight: which recorded flight?")
    if options.flight is not None and not options.flight.is_file():
        parser.error(f"--flight: {options.flight}: no such file")
    if "live" in groups and options.seconds < _LEAST_S:
        parser.error(f"--seconds {options.seconds:g}: {_LEAST_S:g} at least, or live has too few frames to judge")
    try:
        before = read(options.check) if options.check else None
    except ValueError as error:
        parser.error(str(error))
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
