"""What flies in these tests: functions of a module, as processes and clusters want them, quick and repeatable."""

from __future__ import annotations

import importlib
import os
import random
import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from arva_hil.campaign.plan import Planned, trials
from arva_hil.campaign.runner import WorkerPool
from arva_hil.campaign.trial import FOUND, Result, Trial
from arva_hil.clock import RealClock
from arva_hil.config.campaign import parse_plan

FOLDER = "FAKE_FLIGHTS"  # in the environment: where `gated` writes down what it flies, and looks for the gate
FREE = 3  # seeds up to this one fly through a closed gate
DEADLINE_S = 90.0
PLAN = "strategies: [flux, estimate]\nscenarios: {random: {within_m: 50}}\nseeds: 6\ntake_off_m: [1, 2]\n"


@contextmanager
def here(count: int) -> Iterator[WorkerPool]:
    """In place of `runner.processes`: threads of this process, for a test whose promise is not processes."""
    with ThreadPoolExecutor(count) as threads:
        yield WorkerPool(f"processes: {count}", threads, 2 * count)


def planned(text: str = PLAN) -> list[Planned]:
    return list(trials(parse_plan(text, "plan.yaml")))


def fake(trial: Trial) -> Result:
    """Finds it mostly; a function of the trial."""
    r = random.Random(f"{trial.strategy} {trial.scenario.seed} {trial.take_off_m} {trial.wind}")
    time_s, frames = 30 + 100 * r.random(), r.randrange(100)
    if r.random() < 0.2:
        return Result("not found, the time is up", None, None, trial.limit_s, 3 * time_s, frames)
    error_m = r.expovariate(1.5)
    return Result(FOUND, error_m, error_m / 2, time_s, 0.9 * time_s, frames)


def gated(trial: Trial) -> Result:
    """As `fake`, once the gate is open for its seed; before, only the first seeds. Writes down who flies what."""
    folder = Path(os.environ[FOLDER])
    with (folder / "flown").open("a") as file:
        file.write(f"{os.getpid()} {trial.strategy} {trial.scenario.seed} {trial.take_off_m}\n")
    clock = RealClock()
    while trial.scenario.seed > last_free(folder) and clock.now() < DEADLINE_S:
        clock.wait(clock.now() + 0.01)
    return fake(trial)


def last_free(folder: Path) -> float:
    """The last seed that flies: what is in the file `open`, all if it is empty."""
    file = folder / "open"
    return float(file.read_text() or "inf") if file.exists() else FREE


def failing(trial: Trial) -> Result:
    """A strategy that prints, and fails at every second seed."""
    print("here I am")
    if trial.scenario.seed % 2:
        return replace(fake(trial), outcome="the strategy has failed: velocity returned None")
    return fake(trial)


def raising(trial: Trial) -> Result:
    """An error of the program at every second seed."""
    if trial.scenario.seed % 2:
        raise ZeroDivisionError("by\nnothing")
    return fake(trial)


def dying(trial: Trial) -> Result:
    """As a process that the kernel ends for its memory."""
    if trial.scenario.seed > FREE:
        os.kill(os.getpid(), signal.SIGKILL)
    return fake(trial)


def dask(program: str, arguments: list[str], environment: dict[str, str]) -> None:
    """A scheduler or a worker, in a process of its own."""
    os.environ.update(environment)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    importlib.import_module(f"distributed.cli.{program}").main(arguments)


def exiting(trial: Trial) -> Result:
    raise SystemExit("enough")
