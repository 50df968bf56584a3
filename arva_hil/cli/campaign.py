"""`arva-hil campaign`: flies the remaining trials of a plan, and writes table and report."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Iterable, Sequence
from contextlib import closing, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Final

from arva_hil.campaign import report, trial
from arva_hil.campaign.plan import Planned, size, trials
from arva_hil.campaign.results import REPORT, TABLE, Results, ResultsError, flown, opened, row
from arva_hil.campaign.results import replace as write
from arva_hil.campaign.runner import MissingExtra, Unreachable, WorkerPoolError, cluster, processes
from arva_hil.cli.outcome import FAILED, INTERRUPTED, NO_LINK, OK, Failure, SignalGuard, UsageError, interrupting
from arva_hil.cli.recorded import is_campaign, needing
from arva_hil.cli.terminal import bar, show, show_json, show_one, tell, time_left
from arva_hil.clock import RealClock
from arva_hil.config.campaign import CampaignPlan, load_plan
from arva_hil.safe_text import one_line

_PLAIN_S: Final = 10.0  # between lines if stderr is no terminal
_LIVE_S: Final = 0.1  # between updates on a terminal
_RETURN_S: Final = 300.0  # wait this long for a lost scheduler
_MOST: Final = 200_000  # trials in one run, which keeps all results in memory


def main(options: argparse.Namespace) -> int:
    if len(both := options.typed & {"jobs", "scheduler", "merge"}) > 1:
        raise UsageError(f"{' and '.join(f'--{one}' for one in sorted(both))}: choose one")
    plan, name = _part(load_plan(options.plan), options.shard)
    if options.dry_run:
        return _list(trials(plan), as_json=options.json)
    if (count := size(plan)) > _MOST:
        raise UsageError(f"{count} trials, at most {_MOST} in one run: fly it in parts, --shard 1/{-(-count // _MOST)}")
    every = list(trials(plan))
    if options.scheduler:
        with needing("dask", "--scheduler"):
            importlib.import_module("distributed")
    folder = Path(options.out or f"{Path(options.plan).stem}-results{name}")
    for other in options.merge or ():
        if not is_campaign(other):
            raise UsageError(f"--merge {other}: no results.sqlite there, expected the folder of a campaign")
        if os.path.realpath(other) == os.path.realpath(folder):
            raise UsageError(f"--merge {other}: these are the results themselves: leave it out")
    with opened(folder) as kept:
        return _campaign(options, plan, every, kept)


def _part(plan: CampaignPlan, shard: tuple[int, int] | None) -> tuple[CampaignPlan, str]:
    """Return the part of a plan that a run flies, and its name, empty for the whole."""
    if not shard:
        return plan, ""
    k, n = shard
    if n > len(plan.seeds):
        raise UsageError(f"--shard {k}/{n}: the plan has {len(plan.seeds)} seeds, each part needs one at least")
    return replace(plan, seeds=plan.seeds[k - 1 :: n]), f"-{k}-of-{n}"


_LINE: Final = (
    "{strategy}: {scenario}, seed {seed}, noise {noise}, wind {wind_m_s:g} m/s, GPS noise {gps_noise_m:g} m, "
    "take-off {take_off_m:g} m, height {height_m:g} m, {speed_m_s:g} m/s, {limit_s:g} s"
)


def _list(every: Iterable[Planned], *, as_json: bool) -> int:
    """Print a line for each trial, in the order of the flights."""
    for what in map(flown, every):
        team = f", {what['drones']} drones" if what["drones"] > 1 else ""
        show_one(what, _LINE.format(**what) + team, as_json=as_json)
    return OK


def _campaign(options: argparse.Namespace, plan: CampaignPlan, every: Sequence[Planned], kept: Results) -> int:
    try:
        for folder in options.merge or ():
            kept.merge(Path(folder))
        left = [planned for planned in every if not kept.done(planned.key)]
        if left and options.merge:
            raise Failure(FAILED, f"{_progress(kept, every)}; the same command without --merge flies the rest")
        if left and _fly(options, every, left, kept):
            tell(f"interrupted: {_progress(kept, every)}; the same command continues it")
            return INTERRUPTED
        with interrupting():  # again, after the guard of the flights: the same command continues it
            kept.export(planned.key for planned in every)
            kept.keep_plan((planned.key for planned in every), plan.success_m)
            rows = [kept.rows[planned.key] for planned in every]
            table, page = kept.path.with_name(TABLE), kept.path.with_name(REPORT)
            write(page, report.page(one_line(Path(options.plan).stem), rows, plan.success_m).encode())
    except ResultsError as error:
        raise Failure(FAILED, error) from None
    if not options.json:
        show(*report.text(rows, plan.success_m).splitlines())
    tell(f"{table}, {page}")
    if failed := [row for row in rows if row.failed]:
        raise Failure(FAILED, f"{len(failed)} of {len(rows)} trials failed; the first one: {failed[0].outcome}")
    return OK


def _fly(
    options: argparse.Namespace,
    every: Sequence[Planned],
    left: Sequence[Planned],
    kept: Results,
    *,
    within_s: float | None = None,
) -> bool:
    """Fly the remaining trials and save the results. Return True if a signal ended them early.

    `within_s`: longest wait for a scheduler.
    """

    def stopped() -> bool:
        if guard.caught is None:
            progress.show()
        return guard.caught is not None

    done, trials = len(every) - len(left), len(left)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    connected = False
    try:
        where = cluster(options.scheduler, trials, within_s=within_s) if options.scheduler else None
        with where or processes(min(options.jobs or cores, trials)) as pool, SignalGuard() as guard:
            connected = True
            tell(f"{len(every)} trials, {done} of them done; {pool.name}")
            with closing(_Progress(len(every), done)) as progress:
                for some in pool.fly(left, trial.fly, stopped=stopped):
                    kept.add(*(rows := [row(planned, result) for planned, result in some]))
                    progress.done += len(rows)
                    show_json(*(asdict(new) for new in rows if options.json))
    except MissingExtra as error:
        raise UsageError(error) from None
    except WorkerPoolError as error:
        if connected and isinstance(error, Unreachable):
            tell(f"{error}; {_progress(kept, every)}; waiting for it, at most {_RETURN_S:g} s")
            left = [planned for planned in left if not kept.done(planned.key)]
            with interrupting():
                return _fly(options, every, left, kept, within_s=_RETURN_S)
        code, when = (NO_LINK, " once there is a scheduler") if isinstance(error, Unreachable) else (FAILED, "")
        raise Failure(code, f"{error}; {_progress(kept, every)}; the same command continues it{when}") from None
    return guard.caught is not None


def _progress(kept: Results, every: Sequence[Planned]) -> str:
    return f"{sum(kept.done(planned.key) for planned in every)} of {len(every)} results are in {kept.path}"


class _Progress:
    """A display of the trials `done` on stderr: a bar on a terminal, a line every few seconds elsewhere."""

    def __init__(self, total: int, done: int) -> None:
        self.done = self._before = done
        self._total = total
        self._clock = RealClock()
        self._live = sys.stderr.isatty()
        self._next = 0.0 if self._live else _PLAIN_S
        self._bar = bar(total, " trials", done=done, shown=self._live)

    def show(self) -> None:
        """Print the progress if it is due. Called often."""
        if self._clock.now() < self._next:
            return
        self._next = self._clock.now() + (_LIVE_S if self._live else _PLAIN_S)
        if self._live:
            self._bar.n = self.done
            with suppress(OSError):
                self._bar.refresh()
        else:
            left = time_left(self.done - self._before, self._total - self.done, self._clock.now())
            tell(f"{self.done} of {self._total} trials" + (f", {left}" if left else ""))

    def close(self) -> None:
        with suppress(OSError):
            self._bar.close()
