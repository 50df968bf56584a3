"""The results of a campaign in a folder: one row a trial, there as soon as it has finished, whatever ends the campaign.

`results.csv` only ever grows by whole lines, or is replaced by one in the plan's order. A last line that is torn is
no row: its trial is run again.
"""

from __future__ import annotations

import contextlib
import csv
import fcntl
import io
import math
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any, Final

from arva_hil import files
from arva_hil.campaign.plan import Planned
from arva_hil.campaign.trial import FOUND, Result
from arva_hil.runtime.clock import RealClock
from arva_hil.safe_text import cell

__all__ = ["FAILED", "NAME", "Results", "ResultsError", "Row", "row"]

NAME: Final = "results.csv"
FAILED: Final = "failed: "  # how the outcome of a trial starts that was no search but an error of the program

_LOCK: Final = ".lock"
_SYNC_S: Final = 1.0  # what may be lost when the power fails; when the program is killed, nothing is


class ResultsError(Exception):
    """The results cannot be read or written; `str()` says where and why."""


@dataclass(frozen=True, slots=True)
class Row:
    """One line of results.csv. `distance_m`: from take-off to the nearest transmitter, horizontally."""

    key: str
    seed: int
    scenario: str
    noise: str
    wind_m_s: float
    gps_noise_m: float
    take_off_m: float
    strategy: str
    height_m: float
    speed_m_s: float
    limit_s: float
    distance_m: float | None
    outcome: str
    error_m: float | None
    hover_m: float | None
    time_s: float
    path_m: float
    frames: int

    @property
    def failed(self) -> bool:
        return self.outcome.startswith(FAILED)

    def success(self, within_m: float) -> bool:
        return self.outcome == FOUND and self.error_m is not None and self.error_m <= within_m


_READ: Final[dict[str, Any]] = {
    "str": str,
    "int": int,
    "float": float,
    "float | None": lambda text: float(text) if text else None,
}
_COLUMNS: Final = {field.name: _READ[str(field.type)] for field in fields(Row)}


def row(planned: Planned, result: Result) -> Row:
    """What a trial was, and what came of it."""
    trial = planned.trial
    places = [t.ned for t in trial.scenario.transmitters if t.ned]
    return Row(
        planned.key,
        trial.scenario.seed,
        cell(planned.scenario),
        trial.scenario.receiver.noise.kind,
        planned.wind_m_s,
        trial.gps_noise_m,
        trial.take_off_m,
        trial.strategy,
        trial.height_m,
        trial.speed_m_s,
        trial.limit_s,
        min((round(math.hypot(*place[:2]), 3) for place in places), default=None),
        cell(_short(result.outcome)),
        result.error_m,
        result.hover_m,
        result.time_s,
        result.path_m,
        result.frames,
    )


class Results:
    """The rows in a folder, by key, in the order of the file; a later row of the same key replaces the first."""

    def __init__(self, folder: Path) -> None:
        """Reads the file and drops its torn end; `opened` has the lock that this takes."""
        self.path = folder / NAME
        self.rows: dict[str, Row] = {}
        self._clock = RealClock()
        self._synced = self._clock.now()
        self._file = files.grow(self.path)
        try:
            self._load()
        except BaseException:
            self._file.close()
            raise

    def _load(self) -> None:
        """Read the rows and drop a torn end."""
        self._file.seek(0)
        data = self._file.readall() or b""
        whole = data.rfind(b"\n") + 1
        if not whole and not _line(_COLUMNS).startswith(data):
            raise ResultsError(f"{self.path}: not the results of a campaign: name another folder with --out")
        for number, line in enumerate(data[:whole].split(b"\n")[:-1], 1):
            if number == 1 and line + b"\n" != _line(_COLUMNS):
                raise ResultsError(
                    f"{self.path}: not the results of a campaign, or of another version of arva-hil: "
                    "name another folder with --out"
                )
            if number > 1:
                one = _parse(line, f"{self.path}:{number}")
                self.rows[one.key] = one
        self._file.truncate(whole)
        if not whole:
            self._write(_line(_COLUMNS))

    def done(self, key: str) -> bool:
        """Whether a trial has a result; one that failed has none."""
        return key in self.rows and not self.rows[key].failed

    def add(self, new: Row) -> None:
        """Append a row. It is in the file when this returns. Raises ResultsError when the disk is full."""
        self._write(_line(astuple(new)))
        self.rows[new.key] = new

    def sort(self, keys: Iterable[str]) -> None:
        """Replace the file, in one step, by one in the order of `keys`; rows of other trials come last."""
        order = [self.rows[key] for key in keys if key in self.rows]
        rest = self.rows.keys() - {one.key for one in order}
        order += [one for key, one in self.rows.items() if key in rest]
        lines = [_line(_COLUMNS), *(_line(astuple(one)) for one in order)]
        self.close()
        replace(self.path, b"".join(lines))
        self.rows = {one.key: one for one in order}

    def close(self) -> None:
        if not self._file.closed:
            with contextlib.suppress(OSError):  # what could not be written was complained about
                self._sync()
                self._file.close()

    def _write(self, line: bytes) -> None:
        try:
            left = memoryview(line)
            while left:
                left = left[self._file.write(left) :]
            if self._clock.now() - self._synced > _SYNC_S:
                self._sync()
        except OSError as error:
            raise ResultsError(f"{self.path}: cannot be written: {error.strerror}") from None

    def _sync(self) -> None:
        os.fsync(self._file.fileno())
        self._synced = self._clock.now()


@contextmanager
def opened(folder: Path) -> Iterator[Results]:
    """The results in a folder, made if there is none, for one campaign at a time. Raises ResultsError."""
    with contextlib.ExitStack() as stack:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            stack.enter_context(_locked(folder))
            results = stack.enter_context(contextlib.closing(Results(folder)))
        except OSError as error:
            raise ResultsError(f"{error.filename or folder}: {error.strerror or error}") from None
        yield results


def replace(path: Path, data: bytes) -> None:
    """Write a file as a whole or not at all. Raises ResultsError."""
    try:
        files.replace(path, data)
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written: {error.strerror}") from None


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """A lock that goes with the process that has it, however that ends."""
    with files.grow(folder / _LOCK) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            who = f"process {(file.read(20) or b'').decode(errors='replace').strip()}"
            raise ResultsError(f"{folder}: another campaign ({who}) is at work there") from None
        file.truncate(0)
        file.write(f"{os.getpid()}\n".encode())
        yield


def _line(values: Iterable[object]) -> bytes:
    """One line; floats at full precision, None empty."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(values)
    return text.getvalue().encode()


def _parse(line: bytes, where: str) -> Row:
    try:
        (values,) = csv.reader([line.decode()], strict=True)
        pairs = zip(_COLUMNS.values(), values, strict=True)
        return Row(*(read(value) for read, value in pairs))
    except (ValueError, csv.Error) as error:
        raise ResultsError(f"{where}: not a row of results ({error}); the file is left as it is") from None


def _short(text: str) -> str:
    return " ".join(text.encode(errors="backslashreplace").decode().split())[:300]
