"""Statistics of the rows of a campaign, with their uncertainty."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from arva_hil.campaign.results import TrialRow

__all__ = ["Pair", "Summary", "groups", "summary", "wilson"]

_Z: Final = 1.959963984540054  # of the standard normal distribution, 97.5 %

Pair = tuple[float, float]


@dataclass(frozen=True)
class Summary:
    """Statistics of some runs. `interval`: the 95 % confidence interval of the success rate. `time_s`, `path_m` (of
    successes) and `error_m` (of all places reported): median and 90th percentile, None without values."""

    runs: int
    failed: int
    successes: int
    interval: Pair
    time_s: Pair | None
    path_m: Pair | None
    error_m: Pair | None

    @property
    def rate(self) -> float:
        return self.successes / self.runs if self.runs else math.nan


def wilson(successes: int, runs: int) -> Pair:
    """The 95 % confidence interval of a rate (E. B. Wilson, 1927)."""
    if not runs:
        return 0.0, 1.0
    p, n = successes / runs, runs
    centre = (p + _Z**2 / (2 * n)) / (1 + _Z**2 / n)
    half = _Z / (1 + _Z**2 / n) * math.sqrt(p * (1 - p) / n + _Z**2 / (4 * n**2))
    return max(centre - half, 0.0), min(centre + half, 1.0)


def summary(rows: Sequence[TrialRow], success_m: float) -> Summary:
    """The statistics of rows. A run that failed with an error of the program counts as a run without success."""
    good = [row for row in rows if row.success(success_m)]
    return Summary(
        len(rows),
        sum(row.failed for row in rows),
        len(good),
        wilson(len(good), len(rows)),
        _spread([row.time_s for row in good]),
        _spread([row.path_m for row in good]),
        _spread([row.error_m for row in rows if row.error_m is not None]),
    )


def groups(rows: Iterable[TrialRow], *columns: str) -> dict[tuple[Any, ...], list[TrialRow]]:
    """The rows by their values in some columns, in the order in which the values first appear."""
    found: dict[tuple[Any, ...], list[TrialRow]] = {}
    for row in rows:
        found.setdefault(tuple(getattr(row, column) for column in columns), []).append(row)
    return found


def _spread(values: list[float]) -> Pair | None:
    if not values:
        return None
    median, most = np.percentile(values, [50, 90])
    return float(median), float(most)
