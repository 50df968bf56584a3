"""`arva-hil campaign`: flies the remaining trials of a plan, and writes table and report."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager, closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Final

from arva_hil.cli.outcome import FAILED, INTERRUPTED, NO_LINK, OK, Failure, SignalGuard, UsageError
from arva_hil.cli.terminal import bar, show, show_json, tell, time_left
from arva_hil.runtime.clock import RealClock
from arva_hil.safe_text import one_line

if TYPE_CHECKING:
    from arva_hil.campaign.plan import Planned
    from arva_hil.campaign.results import Results
    from arva_hil.campaign.runner import WorkerPool
    from arva_hil.config.campaign import CampaignPlan

_PLAIN_S: Final = 10.0  # between lines if stderr is no terminal
_LIVE_S: Final = 0.1  # between updates on a terminal


def main(options: argparse.Namespace) -> int:
    from arva_hil.campaign import results
    from arva_hil.campaign.plan import trials
    from arva_hil.config.campaign import load_plan

    plan = load_plan(options.plan)
    if options.dry_run:
        return _list(trials(plan), as_json=options.json)
    every = list(trials(plan))
    folder = Path(options.out or f"{Path(options.plan).stem}-results")
    with results.opened(folder) as kept:
        return _campaign(options, plan, every, kept)


def _list(every: Iterable[Planned], *, as_json: bool) -> int:
    """Print a line for each trial, in the order of the flights."""
    from arva_hil.campaign.results import flown

    for planned in every:
        what = flown(planned)
        if as_json:
            show_json(what)
        else:
            air = "wind {wind_m_s:g} m/s, GPS noise {gps_noise_m:g} m".format(**what)
            flight = "take-off {take_off_m:g} m, height {height_m:g} m, {speed_m_s:g} m/s, {limit_s:g} s".format(**what)
            show("{strategy}: {scenario}, seed {seed}, noise {noise}, ".format(**what) + f"{air}, {flight}")
    return OK


def _campaign(options: argparse.Namespace, plan: CampaignPlan, every: Sequence[Planned], kept: Results) -> int:
    from arva_hil.campaign import report
    from arva_hil.campaign.results import REPORT, TABLE, ResultsError, replace

    left = [planned for planned in every if not kept.done(planned.key)]
    try:
        stopped = bool(left) and _fly(options, every, left, kept)
        if stopped:
            _say(f"interrupted: {_progress(kept, every)}; the same command continues it")
            return INTERRUPTED
        kept.export(planned.key for planned in every)
        rows = [kept.rows[planned.key] for planned in every]
        table, page = kept.path.with_name(TABLE), kept.path.with_name(REPORT)
        replace(page, report.page(one_line(Path(options.plan).stem), rows, plan.success_m).encode())
    except ResultsError as error:
        raise Failure(FAILED, error) from None
    if not options.json:
        for line in report.text(rows, plan.success_m).splitlines():
            show(line)
    _say(f"{table}, {page}")
    if failed := [row for row in rows if row.failed]:
        raise Failure(FAILED, f"{len(failed)} of {len(rows)} trials failed; the first one: {failed[0].outcome}")
    return OK


def _fly(options: argparse.Namespace, every: Sequence[Planned], left: Sequence[Planned], kept: Results) -> bool:
    """Fly the remaining trials and save the results. Returns whether a signal ended it early."""
    from arva_hil.campaign import trial
    from arva_hil.campaign.results import row
    from arva_hil.campaign.runner import MissingExtra, Unreachable, WorkerPoolError

    def stopped() -> bool:
        if guard.caught is None:
            progress.show()
        return guard.caught is not None

    done = len(every) - len(left)
    try:
        with _worker_pool(options, len(left)) as pool, SignalGuard() as guard:
            _say(f"{len(every)} trials, {done} of them done; {pool.name}")
            with closing(_Progress(len(every), done)) as progress:
                for planned, result in pool.fly(left, trial.fly, stopped=stopped):
                    kept.add(new := row(planned, result))
                    progress.done += 1
                    if options.json:
                        show_json(asdict(new))
    except MissingExtra as error:
        raise UsageError(error) from None
    except WorkerPoolError as error:
        code, when = (NO_LINK, " once there is a scheduler") if isinstance(error, Unreachable) else (FAILED, "")
        raise Failure(code, f"{error}; {_progress(kept, every)}; the same command continues it{when}") from None
    return guard.caught is not None


def _worker_pool(options: argparse.Namespace, trials: int) -> AbstractContextManager[WorkerPool]:
    from arva_hil.campaign.runner import cluster, processes

    if options.scheduler:
        return cluster(options.scheduler)
    return processes(min(options.jobs or _cores(), trials))


def _cores() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _progress(kept: Results, every: Sequence[Planned]) -> str:
    done = sum(kept.done(planned.key) for planned in every)
    return f"{done} of {len(every)} results are in {kept.path}"


def _say(line: str) -> None:
    """Print a line on stderr; an error of stderr is ignored."""
    with contextlib.suppress(OSError):
        tell(line)


class _Progress:
    """Shows on stderr how many trials are `done`: a bar on a terminal, a line every few seconds elsewhere."""

    def __init__(self, total: int, done: int) -> None:
        self.done = self._before = done
        self._total = total
        self._clock = RealClock()
        self._live = sys.stderr.isatty()
        self._next = 0.0 if self._live else _PLAIN_S
        self._bar = bar(total, " trials", done=done, shown=self._live)

    def show(self) -> None:
        """Show the progress if it is time for it. Called often."""
        if self._clock.now() < self._next:
            return
        self._next = self._clock.now() + (_LIVE_S if self._live else _PLAIN_S)
        if self._live:
            self._bar.n = self.done
            with contextlib.suppress(OSError):
                self._bar.refresh()
        else:
            left = time_left(self.done - self._before, self._total - self.done, self._clock.now())
            _say(f"{self.done} of {self._total} trials" + (f", {left}" if left else ""))

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._bar.close()
