"""`arva-hil campaign`: flown to its end, stopped in every way and gone on with, refused."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import socket
import sqlite3
import sys
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from multiprocessing.process import BaseProcess
from pathlib import Path

import pytest

from arva_hil.campaign import charts, runner, trial
from arva_hil.campaign.results import opened, row
from arva_hil.campaign.runner import Fly
from arva_hil.cli import campaign
from tests.campaign import fakes
from tests.files import written
from tests.said import says

from . import far_ends
from .far_ends import Arva, Start, until
from .test_terminal import Terminal

TESTS = Path(__file__).parent.parent
PLAN = fakes.PLAN.replace("estimate", "estimate, extremum")
TRIALS = 6 * 2 * 3


@pytest.fixture
def plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return plan_file(tmp_path, monkeypatch, PLAN)


@pytest.fixture
def gate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The gate of `fakes.gated`: what programs started here fly by."""
    folder = tmp_path / "gate"
    folder.mkdir()
    monkeypatch.setenv(fakes.FOLDER, str(folder))
    monkeypatch.setattr(far_ends, "PROGRAM", [sys.executable, str(TESTS / "campaign" / "driver.py"), "gated"])
    return folder


def plan_file(folder: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> Path:
    """A plan's file. In this process the flights are fakes, one at a time in a thread, and a report has no charts."""
    monkeypatch.setattr(trial, "fly", fakes.fake)
    monkeypatch.setattr(campaign, "processes", fakes.here)
    monkeypatch.setattr(charts, "draw", lambda rows, success_m: {})
    monkeypatch.setenv("ARVA_HIL_JOBS", "1")
    return written(folder / "plan.yaml", text)


def flights(gate: Path) -> list[tuple[int, str]]:
    """(process, trial) of every flight begun."""
    file = gate / "flown"
    lines = file.read_text().splitlines() if file.exists() else []
    return [(int(line.split(" ", 1)[0]), line.split(" ", 1)[1]) for line in lines]


def rows(out: Path) -> int:
    """How many there are in the database, looked at past its lock: -1 when that is at a wrong moment."""
    journal = out / "results.sqlite-journal"
    try:
        with closing(sqlite3.connect(f"file:{out / 'results.sqlite'}?immutable=1", uri=True)) as database:
            count = int(database.execute("SELECT count(*) FROM results").fetchone()[0])
        written = not journal.exists() or not journal.read_bytes()[:8].strip(b"\0")  # else the last may be taken back
        return count if written else -1
    except (sqlite3.DatabaseError, FileNotFoundError):
        return -1


def alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(") ")[2][0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_it_flies_the_plan_and_reports(arva: Arva, plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(plan.parent)
    (plan.parent / "disk").mkdir()
    Path("plan-results").symlink_to("disk")
    _, out, err = arva("campaign", plan)
    first = [line.split()[0] for line in out.splitlines()]
    assert first == ["strategy", "flux", "estimate", "extremum", "success:", "estimate", "extremum", "2"]
    says(err, f"{TRIALS} trials, 0 of them done; processes: 1", "plan-results/results.csv, plan-results/report.html")
    assert rows(Path("plan-results")) == TRIALS
    page = Path("plan-results/report.html").read_text()
    assert all(name in page for name in ("flux", "estimate", "extremum"))


def test_the_names_of_a_plan_and_its_scenarios_are_text_on_the_page_and_on_the_terminal(arva: Arva, plan: Path) -> None:
    names = [os.fsdecode(b'<img src=x onerror="alert(1)">\x1b[2J\xff.yaml'), "=1+1<b>.yaml"]
    named, scenario = (plan.parent / name for name in names)
    scenario.write_text("transmitters: [{id: 1, ned: [5, 5, 0]}]\n")
    named.write_text(f"strategies: flux\nscenarios: '{scenario.name}'\nseeds: 2\n")
    _, out, err = arva("campaign", named, "--out", plan.parent / "r")
    page = (plan.parent / "r" / "report.html").read_text()
    assert "<img src=x" not in page
    assert "<b>" not in page
    assert "&lt;img src=x onerror=" in page
    assert "\x1b" not in page + out + err
    assert "'=1+1<b>" in (plan.parent / "r" / "results.csv").read_text()


def test_a_finished_campaign_is_not_flown_again_and_a_larger_one_goes_on(arva: Arva, plan: Path) -> None:
    _, out, _ = arva("campaign", plan, "--json", "--out", plan.parent / "r")
    objects = [json.loads(line) for line in out.splitlines()]
    assert len({one["key"] for one in objects}) == len(objects) == TRIALS
    assert objects[0].items() >= {"strategy": "flux", "seed": 1, "take_off_m": 1.0, "noise": "uniform"}.items()
    before = (plan.parent / "r" / "results.csv").read_bytes()
    assert arva("campaign", plan, "--json", "--out", plan.parent / "r").out == ""
    assert (plan.parent / "r" / "results.csv").read_bytes() == before
    plan.write_text(PLAN.replace("seeds: 6", "seeds: 8"))
    code, out, err = arva("campaign", plan, "--json", "--out", plan.parent / "r")
    assert (code, out.count("\n")) == (0, 2 * 2 * 3)
    assert f"{TRIALS + 12} trials, {TRIALS} of them done" in err
    assert (plan.parent / "r" / "results.csv").read_bytes().startswith(before)


def test_a_dry_run_lists_the_trials_as_they_would_be_flown_and_touches_nothing(arva: Arva, plan: Path) -> None:
    before = sorted(plan.parent.iterdir())
    _, out, err = arva("campaign", plan, "--dry-run", "--out", plan.parent / "r")
    assert err == ""
    lines = out.splitlines()
    assert len(lines) == TRIALS
    assert lines[0] == (
        "flux: random within 50 m at 0 to 2 m, seed 1, noise uniform, wind 0 m/s, GPS noise 0 m, "
        "take-off 1 m, height 3 m, 1 m/s, 900 s"
    )
    _, listed, _ = arva("campaign", plan, "--dry-run", "--json", "--out", plan.parent / "r")
    assert sorted(plan.parent.iterdir()) == before
    _, flown, _ = arva("campaign", plan, "--json", "--out", plan.parent / "r")
    for one, other in zip(listed.splitlines(), flown.splitlines(), strict=True):
        assert json.loads(one).items() <= json.loads(other).items()


@pytest.mark.parametrize(
    ("fly", "why"),
    [
        (fakes.raising, "failed: ZeroDivisionError: by nothing"),
        (fakes.failing, "the strategy has failed: velocity returned None"),
    ],
    ids=["the program", "a strategy"],
)
def test_trials_that_fail_are_counted_and_flown_again(
    arva: Arva, plan: Path, monkeypatch: pytest.MonkeyPatch, fly: Fly, why: str
) -> None:
    command = ("campaign", plan, "--json", "--out", plan.parent / "r")
    monkeypatch.setattr(trial, "fly", fly)
    _, out, err = arva(*command, code=1)
    assert len([json.loads(line) for line in out.splitlines() if line != "here I am"]) == TRIALS  # threads fly here
    assert f"18 of {TRIALS} trials failed; the first one: {why}" in err
    assert why in (plan.parent / "r" / "report.html").read_text()
    monkeypatch.setattr(trial, "fly", fakes.fake)
    assert arva(*command).out.count("\n") == 18
    assert rows(plan.parent / "r") == TRIALS
    assert b"failed" not in (plan.parent / "r" / "results.csv").read_bytes()


def test_a_worker_that_dies_is_said_and_what_is_done_stays(
    arva: Arva, plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trial, "fly", fakes.dying)
    monkeypatch.setattr(campaign, "processes", runner.processes)
    out = plan.parent / "r"
    err = arva("campaign", plan, "--out", out, code=1).err
    says(
        err,
        f"a worker process died, killed or out of memory; 18 of {TRIALS} results are in {out}/results.sqlite",
        "the same command continues it",
    )
    assert rows(out) == 18


def test_killed_it_loses_nothing_and_repeats_only_what_was_in_the_air(
    start: Start, arva: Arva, plan: Path, gate: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ("campaign", plan, "--jobs", 2, "--out", plan.parent / "r")
    program = start(*command)
    until(lambda: len(flights(gate)) == 20 and rows(plan.parent / "r") == 18)
    program.process.kill()
    program.ends(-signal.SIGKILL)
    until(lambda: not any(alive(process) for process, _ in flights(gate)))
    assert rows(plan.parent / "r") == 18
    (gate / "open").touch()
    with monkeypatch.context() as patch:
        patch.setattr(trial, "fly", fakes.gated)
        assert f"{TRIALS} trials, 18 of them done" in arva(*command).err
    flown = [what for _, what in flights(gate)]
    assert len(set(flown)) == TRIALS
    assert len(flown) == TRIALS + 2
    twice = {what for what in flown if flown.count(what) == 2}
    assert {int(what.split()[1]) for what in twice} == {fakes.FREE + 1}  # what waited at the gate
    arva("campaign", plan, "--out", plan.parent / "unbroken")
    assert (plan.parent / "unbroken" / "results.csv").read_bytes() == (plan.parent / "r" / "results.csv").read_bytes()


def test_interrupted_it_ends_with_its_workers_and_says_how_to_go_on(start: Start, plan: Path, gate: Path) -> None:
    out = plan.parent / "r"
    program = start("campaign", plan, "--jobs", 2, "--out", out, start_new_session=True)
    until(lambda: len(flights(gate)) == 20 and rows(out) == 18)
    os.killpg(program.process.pid, signal.SIGINT)  # as a terminal does
    program.ends(130)
    assert not any(alive(process) for process, _ in flights(gate))
    assert (
        f"interrupted: 18 of {TRIALS} results are in {out}/results.sqlite; the same command continues it" in program.err
    )
    assert "died" not in program.err
    assert rows(out) == 18


def test_interrupted_while_its_workers_start_it_is_quiet_too(start: Start, plan: Path, gate: Path) -> None:
    program = start("campaign", plan, "--jobs", 1, "--out", plan.parent / "r", start_new_session=True).after(
        "0 of them done"
    )
    os.killpg(program.process.pid, signal.SIGINT)
    assert "interrupted" in program.ends(130)


def test_a_terminal_has_a_bar_and_when_it_is_closed_results_are_whole(
    start: Start, plan: Path, gate: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TQDM_ASCII", " #")  # or a character of the bar may be read in halves
    out = plan.parent / "r"
    terminal = Terminal(120)
    program = start("campaign", plan, "--out", out, stderr=terminal.slave)
    terminal.shows(r"50 % \|.*\| 18 of 36 trials, .* left")
    terminal.close()
    program.stops(signal.SIGHUP)
    assert not any(alive(process) for process, _ in flights(gate))
    assert rows(out) == 18


def test_a_reader_that_goes_ends_it_and_its_results_are_whole(
    arva: Arva, plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = plan.parent / "r"
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "w") as gone:
        monkeypatch.setattr(sys, "stdout", gone)
        assert "stdout" not in arva("campaign", plan, "--out", out, "--json", code=141).err
    assert 1 <= rows(out) < TRIALS


def test_a_pipe_has_a_line_now_and_then(arva: Arva, plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, "_PLAIN_S", 0.0)
    _, _, err = arva("campaign", plan, "--out", plan.parent / "r")
    counts = [int(line.split()[0]) for line in err.splitlines() if f" of {TRIALS} trials" in line]
    assert len(counts) > 1
    assert counts == sorted(counts)


# A cluster


def test_a_scheduler_that_is_not_there_is_no_link(arva: Arva, plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "_CONNECT_S", 0.3)
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{s.getsockname()[1]}"
        err = arva("campaign", plan, "--scheduler", address, "--out", plan.parent / "r", code=3).err
    says(err, f"no Dask scheduler answers at {address}", "continues it once there is a scheduler")


# -- a large campaign: on a cluster whose workers and scheduler are killed, and in parts that are put together --


SEEDS = 65
LARGE = fakes.PLAN.replace("seeds: 6", f"seeds: {SEEDS}")


class Cluster:
    """A scheduler on one port of the loopback interface and its workers, each a process of its own."""

    def __init__(self) -> None:
        with socket.socket() as s:
            s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            s.bind(("127.0.0.1", 0))
            self.port = s.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self._processes: list[BaseProcess] = []
        self._forked = multiprocessing.get_context("forkserver")
        self._forked.set_forkserver_preload(
            ["distributed.cli.dask_scheduler", "distributed.cli.dask_worker", "tests.campaign.fakes"]
        )

    def scheduler(self) -> BaseProcess:
        return self._start("dask_scheduler", "--host", "127.0.0.1", "--port", str(self.port))

    def worker(self) -> BaseProcess:
        return self._start("dask_worker", self.address, "--no-nanny", "--nthreads", "1", "--host", "127.0.0.1")

    def _start(self, program: str, *arguments: str) -> BaseProcess:
        process = self._forked.Process(
            target=fakes.dask, args=(program, ["--no-dashboard", *arguments], {**os.environ})
        )
        process.start()
        self._processes.append(process)
        return process

    def close(self) -> None:
        for process in self._processes:
            process.kill()
            process.join()


@pytest.fixture
def machines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cluster]:
    monkeypatch.setenv(fakes.FOLDER, str(tmp_path))
    monkeypatch.setenv("DASK_TEMPORARY_DIRECTORY", str(tmp_path))
    monkeypatch.setattr(far_ends, "PROGRAM", [sys.executable, str(TESTS / "campaign" / "driver.py"), "gated"])
    cluster = Cluster()
    yield cluster
    cluster.close()


def test_workers_and_the_scheduler_are_killed_and_every_result_is_there_once(
    start: Start, plan: Path, tmp_path: Path, machines: Cluster
) -> None:
    def free(seed: int) -> None:
        """So many seeds fly; the others wait in their workers."""
        (tmp_path / "new").write_text(str(seed))
        (tmp_path / "new").rename(tmp_path / "open")

    plan.write_text(LARGE)
    out = tmp_path / "r"
    scheduler, first, second = machines.scheduler(), machines.worker(), machines.worker()
    program = start("campaign", plan, "--out", out, "--scheduler", machines.address)
    until(lambda: {process for process, _ in flights(tmp_path)} == {first.pid, second.pid})
    first.kill()
    free(30)
    until(lambda: rows(out) > 100)
    scheduler.kill()
    program.says(rf"the scheduler at {machines.address} is gone; \d+ of {4 * SEEDS} results are in .*waiting for it")
    second.kill()
    free(SEEDS)
    machines.scheduler()
    machines.worker()
    program.ends()
    with opened(out) as results:
        assert results.rows == {one.key: row(one, fakes.fake(one.trial)) for one in fakes.planned(LARGE)}
    flown = [what for _, what in flights(tmp_path)]
    assert len(set(flown)) == (4 * SEEDS)
    assert len(flown) < (4 * SEEDS) + 100  # only what was in the air, or not told yet


def test_parts_flown_apart_are_the_whole_when_they_are_merged(arva: Arva, plan: Path) -> None:
    plan.write_text(fakes.PLAN)
    merged, parts = plan.parent / "merged", [plan.parent / f"part{n}" for n in range(3)]
    for n, part in enumerate(parts):
        arva("campaign", plan, "--shard", f"{n + 1}/3", "--out", part)
        assert rows(part) == 8
    err = arva("campaign", plan, "--out", merged, "--merge", parts[2], parts[0], code=1).err
    assert f"16 of 24 results are in {merged}/results.sqlite; the same command without --merge flies the rest" in err
    arva("campaign", plan, "--out", merged, "--merge", parts[1], "--merge", parts[0])  # the second is there already
    assert rows(merged) == 24
    with opened(merged) as results:
        assert results.rows == {one.key: row(one, fakes.fake(one.trial)) for one in fakes.planned()}


def test_the_folder_of_a_part_has_its_name(arva: Arva, plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(plan.parent)
    plan.write_text(fakes.PLAN)
    arva("campaign", plan, "--shard", "2/6")
    with opened(Path("plan-results-2-of-6")) as results:
        assert {one.seed for one in results.rows.values()} == {2}


def test_what_cannot_be_merged_is_said_and_nothing_is_changed(arva: Arva, plan: Path, tmp_path: Path) -> None:
    plan.write_text(fakes.PLAN)
    every = [row(one, fakes.fake(one.trial)) for one in fakes.planned()]
    one = every[0]
    with opened(tmp_path / "a") as results, opened(tmp_path / "b") as others:
        results.add(*every)
        others.add(replace(one, frames=one.frames + 1, numpy="1.0"), *every[1:9])
    err = arva("campaign", plan, "--out", tmp_path / "a", "--merge", tmp_path / "b", code=1).err
    differs = f"e.g. {one.key} ({one.strategy}, seed {one.seed}), frames {one.frames + 1} instead of {one.frames}: "
    assert f"1 trials ended differently than in {tmp_path / 'a'}, {differs}flown by numpy 1.0 instead of " in err
    with opened(tmp_path / "a") as results:
        assert results.rows[one.key] == one
    err = arva.refused("campaign", plan, "--out", tmp_path / "a", "--merge", tmp_path / "none")
    assert f"{tmp_path / 'none'}: no results.sqlite there, expected the folder of a campaign" in err
    assert not (tmp_path / "none").exists()
    assert "these are the results themselves" in arva.refused(
        "campaign", plan, "--out", tmp_path / "a", "--merge", tmp_path / "a"
    )


def test_more_parts_than_seeds_and_more_trials_than_one_run_has_memory_for(arva: Arva, plan: Path) -> None:
    plan.write_text(fakes.PLAN)
    err = arva.refused("campaign", plan, "--shard", "1/7")
    assert "--shard 1/7: the plan has 6 seeds, each part needs one at least" in err
    plan.write_text(fakes.PLAN.replace("seeds: 6", "seeds: 2500000"))
    err = arva.refused("campaign", plan)
    assert "10000000 trials, at most 200000 in one run: fly it in parts, --shard 1/50" in err
