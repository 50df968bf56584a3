"""The rows of the benchmark: measured, printed as a table, written as JSON, compared with those of another run.

Times are the least of several, because others use the machine too.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

_SLOWER = 1.25  # factor by which two runs on a shared machine may differ


@dataclass(frozen=True)
class Row:
    """One piece of work. `ours` and `beside`: its cost in `unit`, ours and that of the `peer`.

    `cost`: the judged value, smaller is better: mostly ours over the peer's. It should be at most `reach`.
    """

    work: str
    peer: str
    ours: float
    beside: float
    unit: str
    cost: float
    reach: float

    @property
    def reached(self) -> bool:
        return self.cost <= self.reach

    def line(self) -> str:
        found = f"{self.ours:9.4g} {self.beside:9.4g} {self.unit:12} {self.cost:8.3g} {self.reach:8.3g}"
        return f"{self.work:58} {self.peer:28} {found} {'' if self.reached else 'MISSED'}"


def ratio(work: str, peer: str, ours: float, beside: float, unit: str, reach: float) -> Row:
    """A row judged by ours over the peer's."""
    return Row(work, peer, ours, beside, unit, ours / beside, reach)


def show(rows: Iterable[Row]) -> None:
    print(f"{'work':58} {'beside':28} {'ours':>9} {'peer':>9} {'unit':12} {'cost':>8} {'reach':>8}")
    for row in rows:
        print(row.line().rstrip(), flush=True)


def write(rows: Sequence[Row], path: Path) -> None:
    """Write rows and the conditions of their measurement. Raises OSError."""
    about = {"with": conditions(), "rows": [asdict(row) for row in rows]}
    path.write_text(json.dumps(about, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def conditions() -> dict[str, str]:
    """Return the conditions of a run besides the code: machine, Python, and commit."""
    git = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--exclude=*"]
    try:
        commit = subprocess.run(git, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        commit = "unknown"
    machine = f"{_processor() or platform.machine()}, {os.cpu_count()} cores"
    return {"machine": machine, "Python": platform.python_version(), "commit": commit}


def _processor() -> str:
    """Its name as Linux tells it, "" elsewhere."""
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return ""


class Baseline(NamedTuple):
    """A file of `write`: rows by their work, and the conditions."""

    rows: dict[str, Row]
    conditions: dict[str, str]


def read(path: Path) -> Baseline:
    """Read a file of `write`. Raises ValueError for another file."""
    try:
        about = json.loads(path.read_text(encoding="utf-8"))
        rows = [Row(**row) for row in about["rows"]]
        if not all(isinstance(row.work, str) and isinstance(row.cost, int | float) for row in rows):
            raise ValueError("a row whose work is no text, or whose cost is no number")
        return Baseline({row.work: row for row in rows}, {str(k): str(v) for k, v in about["with"].items()})
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}; write a baseline with --json") from None
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: is no baseline ({error}); write one with --json") from None


def differs(before: dict[str, str], now: dict[str, str]) -> list[str]:
    """Return the differences of the conditions from the baseline, in words."""
    return [f"{what} {before.get(what, 'unknown')}, now {is_}" for what, is_ in now.items() if before.get(what) != is_]


def slower(rows: Iterable[Row], before: dict[str, Row]) -> list[str]:
    """Return the slower rows, in words."""
    pairs = [(row, before[row.work]) for row in rows if row.work in before]
    return [f"{row.work}: {row.cost:.3g}, before {old.cost:.3g}" for row, old in pairs if row.cost > _SLOWER * old.cost]


def cpu_of(work: Callable[[], object], times: int = 3) -> float:
    """Return the CPU seconds of a function in this process."""
    return min(once(work, time.process_time) for _ in range(times))


def wall_of(work: Callable[[], object], times: int = 3) -> float:
    """Return the wall time [s] of work on several cores."""
    return min(once(work, time.perf_counter) for _ in range(times))


def once(work: Callable[[], object], clock: Callable[[], float]) -> float:
    start = clock()
    work()
    return clock() - start
