"""The results of a campaign: rows in `results.sqlite`, each committed as soon as its trial has ended; their statistics.

Committed rows stay even if the campaign is killed. The database is locked while a campaign runs. Its write-ahead log is
not used, because that does not work on a network disk. `results.csv` is exported at the end.
"""

from __future__ import annotations

import contextlib
import csv
import io
import math
import os
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, astuple, dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np

from arva_hil import __version__
from arva_hil.campaign.plan import Planned
from arva_hil.campaign.trial import FOUND, Result
from arva_hil.errors import ArvaError
from arva_hil.links import files
from arva_hil.safe_text import cell, one_line
from arva_hil.search.strategies.analysis import FAILED as STRATEGY_FAILED

NAME: Final = "results.sqlite"
TABLE: Final = "results.csv"
REPORT: Final = "report.html"
FAILED: Final = "failed: "  # begins the outcome of a trial that ended with an error of the program

_APPLICATION: Final = 0x41525641  # "ARVA", in the header of the database
_FORMAT: Final = 4  # of the table, also in the header
_ALIKE: Final = 0.05  # m and s: results that differ by this much are alike; kernels of BLAS round differently
_FALSE_M: Final = 2.0  # a place found with a larger error is false
_WAIT_S: Final = 1.0  # for another program to release the database
_ELSEWHERE: Final = "it is left as it is; name another folder with --out"


class ResultsError(ArvaError):
    """The results cannot be read or written. `str()` says where and why."""


@dataclass(frozen=True)
class Conditions:
    """The first columns of results.csv. `distance_m`: from the take-off to the nearest transmitter at the start."""

    key: str
    seed: int
    scenario: str
    noise: str
    wind_m_s: float
    gps_noise_m: float
    take_off_m: float
    drones: int
    strategy: str
    height_m: float
    speed_m_s: float
    limit_s: float
    distance_m: float | None


@dataclass(frozen=True)
class TrialRow(Result, Conditions):
    """One line of results.csv: the conditions, the result, and the versions that flew it.

    The columns of the last base come first.
    """

    arva_hil: str = __version__
    numpy: str = np.__version__

    @property
    def failed(self) -> bool:
        return self.outcome.startswith((FAILED, STRATEGY_FAILED))

    def success(self, within_m: float) -> bool:
        return self.outcome == FOUND and self.error_m is not None and self.error_m <= within_m

    def difference(self, other: TrialRow) -> str:
        """Return the first result that differs, with both values; "" if the rows are alike."""
        for name in _COLUMNS[: -len(_VERSIONS)]:
            mine, its = getattr(self, name), getattr(other, name)
            alike = isinstance(mine, float) and isinstance(its, float) and abs(mine - its) <= _ALIKE
            if mine != its and not alike:
                return f"{name} {its} instead of {mine}"
        return ""


_VERSIONS: Final = ("arva_hil", "numpy")  # the last columns
_TYPES: Final = {
    "str": "text check (typeof({0}) = 'text')",
    "int": "integer check (typeof({0}) = 'integer')",
    "float": "real check (typeof({0}) = 'real')",
    "float | None": "real check (typeof({0}) in ('real', 'null'))",
}
_COLUMNS: Final = [field.name for field in fields(TrialRow)]
_CREATE: Final = ", ".join(f"{field.name} {_TYPES[str(field.type)].format(field.name)}" for field in fields(TrialRow))


def flown(planned: Planned) -> dict[str, Any]:
    """Return the conditions of a trial: the columns up to `distance_m`."""
    trial = planned.trial
    same = "gps_noise_m take_off_m drones strategy height_m speed_m_s limit_s".split()
    places = [t.path.points_ned[0][1:] if t.path else t.ned for t in trial.scenario.transmitters]
    return {
        "key": planned.key,
        "seed": trial.scenario.seed,
        "scenario": one_line(planned.scenario),
        "noise": trial.scenario.receiver.noise.kind,
        "wind_m_s": planned.wind_m_s,
        **{name: getattr(trial, name) for name in same},
        "distance_m": min((round(math.hypot(*place[:2]), 3) for place in places if place), default=None),
    }


def row(planned: Planned, result: Result) -> TrialRow:
    """Return the row of a trial with its result, in millimetres and milliseconds."""
    outcome = one_line(" ".join(result.outcome.split())[:300])
    values = {name: round(value, 3) for name, value in asdict(result).items() if isinstance(value, float)}
    return TrialRow(**flown(planned), **asdict(result) | values | {"outcome": outcome})


class Results:
    """The rows in a folder, by key; a later row of the same key replaces the first."""

    def __init__(self, folder: Path) -> None:
        """Read all rows, and keep the database for this program alone. Raises OSError, sqlite3.Error, ResultsError."""
        self.path = folder / NAME
        for path in (self.path, folder / TABLE, folder / REPORT):
            files.refuse_special(path)
            if os.path.lexists(path) and not os.path.lexists(self.path):
                raise ResultsError(f"{path}: not from a campaign, or of an older arva-hil without {NAME}: {_ELSEWHERE}")
        self._database = sqlite3.connect(self.path, timeout=_WAIT_S, isolation_level=None)
        try:
            self.rows = self._load()
        except BaseException:
            self._database.close()
            raise

    def _load(self) -> dict[str, TrialRow]:
        ask = self._database.execute
        ask("PRAGMA locking_mode = EXCLUSIVE")
        ask("BEGIN EXCLUSIVE")
        (found,) = ask("SELECT count(*) FROM sqlite_master").fetchone()
        (application,), (version,) = ask("PRAGMA application_id").fetchone(), ask("PRAGMA user_version").fetchone()
        if not found:
            ask(f"CREATE TABLE results ({_CREATE}, PRIMARY KEY (key))")
            ask(f"PRAGMA application_id = {_APPLICATION}")
        elif application != _APPLICATION:
            raise ResultsError(f"{self.path}: not from a campaign: {_ELSEWHERE}")
        elif version != _FORMAT:
            raise ResultsError(f"{self.path}: format {version} of another arva-hil, not {_FORMAT}: {_ELSEWHERE}")
        if (mistake := ask("PRAGMA quick_check(1)").fetchone()[0]) != "ok":
            raise sqlite3.DatabaseError(mistake)
        ask(f"PRAGMA user_version = {_FORMAT}")  # raises now if the file cannot be written
        rows = [TrialRow(*values) for values in ask(f"SELECT {', '.join(_COLUMNS)} FROM results ORDER BY rowid")]
        ask("COMMIT")
        return {one.key: one for one in rows}

    def done(self, key: str) -> bool:
        """Return True if a trial has a result. A failed trial has none."""
        return key in self.rows and not self.rows[key].failed

    def add(self, *rows: TrialRow) -> None:
        """Store rows: all are on the disk when this returns, or none. Raises ResultsError, e.g. if the disk is full."""
        marks = ", ".join("?" * len(_COLUMNS))
        try:
            with self._database as database:  # commits, or rolls back
                database.execute("BEGIN")
                database.executemany(f"INSERT OR REPLACE INTO results VALUES ({marks})", map(astuple, rows))
        except sqlite3.Error as error:
            raise ResultsError(f"{self.path}: cannot be written: {error}") from None
        self.rows.update((one.key, one) for one in rows)

    def merge(self, folder: Path) -> None:
        """Copy the missing rows from the folder of another campaign, which has results.

        Raises ResultsError, also if a trial has different results in the two campaigns.
        """
        with opened(folder) as other:
            ended = [one for one in other.rows.values() if not one.failed]
        both = [(self.rows[one.key], one) for one in ended if self.done(one.key)]
        if differing := [(mine, its, difference) for mine, its in both if (difference := mine.difference(its))]:
            mine, its, difference = differing[0]
            raise ResultsError(
                f"{folder}: {len(differing)} trials ended differently than in {self.path.parent}, e.g. {mine.key} "
                f"({mine.strategy}, seed {mine.seed}), {difference}: {_cause(mine, its)}; leave it out"
            )
        self.add(*(one for one in ended if not self.done(one.key)))

    def export(self, keys: Iterable[str]) -> None:
        """Write `results.csv`: the rows of `keys` in their order, then those of other trials. Raises ResultsError."""
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow(_COLUMNS)
        for key in dict.fromkeys([*keys, *self.rows]):
            table.writerow(cell(value) if isinstance(value, str) else value for value in astuple(self.rows[key]))
        replace(self.path.with_name(TABLE), text.getvalue().encode())

    def keep_plan(self, keys: Iterable[str], success_m: float) -> None:
        """Store the trials of the plan in their order, for charts that are drawn without it. Raises ResultsError.

        `success_m`: the largest error of a success.
        """
        try:
            with self._database as database:  # commits, or rolls back
                database.execute("BEGIN")
                database.execute("CREATE TABLE IF NOT EXISTS plan (success_m REAL)")
                database.execute("CREATE TABLE IF NOT EXISTS planned (key TEXT)")
                database.execute("DELETE FROM plan")
                database.execute("DELETE FROM planned")
                database.execute("INSERT INTO plan VALUES (?)", (success_m,))
                database.executemany("INSERT INTO planned VALUES (?)", ((key,) for key in keys))
        except sqlite3.Error as error:
            raise ResultsError(f"{self.path}: cannot be written: {error}") from None

    def planned(self) -> tuple[list[TrialRow], float]:
        """Return the rows of the plan in its order, and the largest error of a success [m].

        Raises ResultsError for results without a plan.
        """
        try:
            ((success_m,),) = self._database.execute("SELECT success_m FROM plan")
            keys = self._database.execute("SELECT key FROM planned ORDER BY rowid")
            return [self.rows[key] for (key,) in keys], float(success_m)
        except (sqlite3.Error, KeyError, TypeError, ValueError):
            raise ResultsError(
                f"{self.path}: the campaign is not complete, or of an older arva-hil: "
                "run the same command of `campaign` again"
            ) from None

    def close(self) -> None:
        self._database.close()


@contextmanager
def opened(folder: Path) -> Iterator[Results]:
    """Open the results in a folder, created if needed, for one campaign at a time. Raises ResultsError."""
    with contextlib.ExitStack() as stack:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            results = stack.enter_context(contextlib.closing(Results(folder)))
        except FileExistsError:
            raise ResultsError(f"{folder}: is no folder: {_ELSEWHERE}") from None
        except OSError as error:
            raise ResultsError(f"{error.filename or folder}: {error.strerror or error}") from None
        except sqlite3.OperationalError as error:
            busy = getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_BUSY
            why = "another campaign or another program is at work there" if busy else f"cannot be opened: {error}"
            raise ResultsError(f"{folder / NAME}: {why}") from None
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
            why = " ".join(str(error).split())
            raise ResultsError(f"{folder / NAME}: damaged, or not from a campaign ({why}): {_ELSEWHERE}") from None
        yield results


def _cause(mine: TrialRow, its: TrialRow) -> str:
    """Return the likely reason for which the same trial has two results."""
    names = [name for name in _VERSIONS if getattr(mine, name) != getattr(its, name)]
    versions = [f"{name} {getattr(its, name)} instead of {getattr(mine, name)}" for name in names]
    return f"flown by {' and '.join(versions) or 'another kernel of BLAS (OPENBLAS_CORETYPE), or a changed arva-hil'}"


def replace(path: Path, data: bytes) -> None:
    """Write a file completely or not at all. Raises ResultsError."""
    try:
        files.replace(path, data)
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written: {error.strerror}") from None


_SAME: Final = "seed scenario noise wind_m_s gps_noise_m take_off_m drones".split()  # height, speed, limit: by strategy
_Z: Final = 1.959963984540054  # of the standard normal distribution, 97.5 %

Pair = tuple[float, float]


EARTH: Final = ("error_m", "sigma_m")  # columns: error and uncertainty of the place on Earth
VEHICLE: Final = ("relative_m", "relative_sigma_m")  # the same of the place relative to the vehicle


@dataclass(frozen=True)
class Errors:
    """Statistics of the places, on Earth or relative to the vehicle.

    `error_m` (of all places reported) and `sigma_m` (the uncertainty of places found): median and 90th percentile, None
    without values. `inside`: the shares of places found inside 1σ and 2σ. `false`: places found that are more than 2 m
    off, and more than 3σ.
    """

    error_m: Pair | None
    sigma_m: Pair | None
    inside: Pair | None
    false: tuple[int, int]


@dataclass(frozen=True)
class Summary:
    """Statistics of some runs.

    `interval`: the 95 % confidence interval of the success rate. `time_s`, `path_m` (of successes): median and 90th
    percentile, None without values.
    """

    runs: int
    successes: int
    interval: Pair
    time_s: Pair | None
    path_m: Pair | None
    earth: Errors
    vehicle: Errors

    @property
    def rate(self) -> float:
        return self.successes / self.runs if self.runs else math.nan


def wilson(successes: int, runs: int) -> Pair:
    """Return the 95 % confidence interval of a rate (E. B. Wilson, 1927)."""
    if not runs:
        return 0.0, 1.0
    p, n = successes / runs, runs
    centre = (p + _Z**2 / (2 * n)) / (1 + _Z**2 / n)
    half = _Z / (1 + _Z**2 / n) * math.sqrt(p * (1 - p) / n + _Z**2 / (4 * n**2))
    return max(centre - half, 0.0), min(centre + half, 1.0)


def summary(rows: Sequence[TrialRow], success_m: float) -> Summary:
    """Return the statistics of rows. A run that failed counts as a run without success."""
    good = [row for row in rows if row.success(success_m)]
    return Summary(
        len(rows),
        len(good),
        wilson(len(good), len(rows)),
        _spread([row.time_s for row in good]),
        _spread([row.path_m for row in good]),
        _errors(rows, *EARTH),
        _errors(rows, *VEHICLE),
    )


def _errors(rows: Sequence[TrialRow], error: str, sigma: str) -> Errors:
    """Return the statistics of two columns."""
    told = [(row.outcome == FOUND, getattr(row, error), getattr(row, sigma)) for row in rows]
    errors = [(found, off, spread) for found, off, spread in told if off is not None]
    pairs = [(off, spread) for found, off, spread in errors if found and spread is not None]
    inside = [sum(off <= sigmas * spread for off, spread in pairs) for sigmas in (1, 2, 3)]
    return Errors(
        _spread([off for _, off, _ in errors]),
        _spread([spread for _, spread in pairs]),
        (inside[0] / len(pairs), inside[1] / len(pairs)) if pairs else None,
        (sum(found and off > _FALSE_M for found, off, _ in errors), len(pairs) - inside[2]),
    )


@dataclass(frozen=True)
class Difference:
    """The difference of a strategy to another one on the same trials: mean, and the ends of its 95 % interval.

    `success`: of the success rate. `time_s`: of the trials in which both succeed; None for fewer than two.
    """

    strategy: str
    other: str
    trials: int
    success: tuple[float, float, float]
    time_s: tuple[float, float, float] | None


def differences(rows: Sequence[TrialRow], success_m: float) -> list[Difference]:
    """Return the differences of each strategy to the first one, on the trials that both flew."""
    first, *others = dict.fromkeys(row.strategy for row in rows)
    found = []
    for strategy in others:
        pairs = [
            (mine[strategy], mine[first])
            for some in groups(rows, *_SAME).values()
            if {strategy, first} <= (mine := {row.strategy: row for row in some}).keys()
        ]
        won = [(a.success(success_m), b.success(success_m)) for a, b in pairs]
        time_s = _mean([a.time_s - b.time_s for (a, b), both in zip(pairs, won, strict=True) if all(both)])
        if pairs:
            success = matched(sum(a and not b for a, b in won), sum(b and not a for a, b in won), len(won))
            found.append(Difference(strategy, first, len(pairs), success, time_s))
    return found


def matched(better: int, worse: int, pairs: int) -> tuple[float, float, float]:
    """Return the difference of two rates on the same trials, and its 95 % interval (A. Agresti and Y. Min, 2005).

    `better`, `worse`: the trials in which only the first succeeds, and only the second.
    """
    n = pairs + 2
    middle = (better - worse) / n
    half = _Z / n * math.sqrt(better + worse + 1 - (better - worse) ** 2 / n)
    return (better - worse) / pairs, max(middle - half, -1.0), min(middle + half, 1.0)


def _mean(values: list[float]) -> tuple[float, float, float] | None:
    """Return the mean, and the ends of its interval by Student's distribution; None for fewer than two values."""
    if len(values) < 2:
        return None
    half = student(len(values) - 1) * float(np.std(values, ddof=1)) / math.sqrt(len(values))
    mean = float(np.mean(values))
    return mean, mean - half, mean + half


def student(freedom: int) -> float:
    """Return the 97.5 % quantile of Student's distribution with so many degrees of freedom.

    By its density over the angle atan(t/√freedom), which is cos^(freedom − 1).
    """
    angle = np.linspace(0.0, min(math.pi / 2, 12 / math.sqrt(freedom)), 10_001)
    density = np.cos(angle) ** (freedom - 1)
    below = np.cumsum(density[:-1] + density[1:])
    return math.sqrt(freedom) * math.tan(np.interp(0.95 * below[-1], below, angle[1:]))


def groups(rows: Iterable[TrialRow], *columns: str) -> dict[tuple[Any, ...], list[TrialRow]]:
    """Return the rows by their values in some columns, in the order in which the values first appear."""
    found: dict[tuple[Any, ...], list[TrialRow]] = {}
    for row in rows:
        found.setdefault(tuple(getattr(row, column) for column in columns), []).append(row)
    return found


def _spread(values: list[float]) -> Pair | None:
    if not values:
        return None
    median, most = np.percentile(values, [50, 90])
    return float(median), float(most)
