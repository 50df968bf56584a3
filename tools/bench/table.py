"""The rows of the benchmark: printed as a table, written as JSON, compared with those of another run."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

_SLOWER = 1.25  # times the ratio of the baseline: what two runs on a shared machine differ by anyway


@dataclass(frozen=True)
class Row:
    """One piece of work. `ours` and `beside`: its cost in `unit`, ours and that of the `peer`.

    `cost`: what is judged, smaller is better: mostly ours over the peer's. It should be at most `reach`.
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
    path.write_text(json.dumps([asdict(row) for row in rows], indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def read(path: Path) -> dict[str, Row]:
    """Rows by their work. Raises ValueError for a file that is no such list."""
    try:
        return {row.work: row for row in (Row(**row) for row in json.loads(path.read_text(encoding="utf-8")))}
    except (OSError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: no rows of a benchmark: {error}; write one with --json") from None


def slower(rows: Iterable[Row], before: dict[str, Row]) -> list[str]:
    """What got slower, in words."""
    pairs = [(row, before[row.work]) for row in rows if row.work in before]
    return [f"{row.work}: {row.cost:.3g}, before {old.cost:.3g}" for row, old in pairs if row.cost > _SLOWER * old.cost]
