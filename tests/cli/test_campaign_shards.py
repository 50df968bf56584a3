"""A large campaign: on a cluster whose workers and scheduler are killed, and in parts that are put together."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from arva_hil.campaign.results import opened, row
from tests.campaign import fakes

from . import far_ends
from .far_ends import Arva, Start
from .test_campaign import flights, plan_file, rows, until

TESTS = Path(__file__).parent.parent
SEEDS = 65
TRIALS = 4 * SEEDS
PLAN = fakes.PLAN.replace("seeds: 6", f"seeds: {SEEDS}")


@pytest.fixture
def plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return plan_file(tmp_path, monkeypatch, PLAN)


class Cluster:
    """A scheduler on one port of the loopback interface and its workers, each a process of its own."""

    def __init__(self) -> None:
        with socket.socket() as s:
            s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            s.bind(("127.0.0.1", 0))
            self.port = s.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self._processes: list[subprocess.Popen[bytes]] = []

    def scheduler(self) -> subprocess.Popen[bytes]:
        return self._start("dask_scheduler", "--host", "127.0.0.1", "--port", str(self.port))

    def worker(self) -> subprocess.Popen[bytes]:
        return self._start("dask_worker", self.address, "--no-nanny", "--nthreads", "1", "--host", "127.0.0.1")

    def _start(self, program: str, *arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{program}", "--no-dashboard", *arguments]
        environment = os.environ | {"PYTHONPATH": str(TESTS.parent)}
        process = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL)
        self._processes.append(process)
        return process

    def close(self) -> None:
        for process in self._processes:
            process.kill()
            process.wait()


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

    out = tmp_path / "r"
    scheduler, first, second = machines.scheduler(), machines.worker(), machines.worker()
    program = start("campaign", plan, "--out", out, "--scheduler", machines.address)
    until(lambda: {process for process, _ in flights(tmp_path)} == {first.pid, second.pid})
    first.kill()
    free(30)
    until(lambda: rows(out) > 100)
    scheduler.kill()
    program.says(rf"the scheduler at {machines.address} is gone; \d+ of {TRIALS} results are in .*waiting for it")
    second.kill()
    free(SEEDS)
    machines.scheduler()
    machines.worker()
    assert program.ends() == 0
    with opened(out) as results:
        assert results.rows == {one.key: row(one, fakes.fake(one.trial)) for one in fakes.planned(PLAN)}
    flown = [what for _, what in flights(tmp_path)]
    assert len(set(flown)) == TRIALS
    assert len(flown) < TRIALS + 100  # only what was in the air, or not told yet


def test_parts_flown_apart_are_the_whole_when_they_are_merged(arva: Arva, plan: Path) -> None:
    plan.write_text(fakes.PLAN)
    merged, parts = plan.parent / "merged", [plan.parent / f"part{n}" for n in range(3)]
    for n, part in enumerate(parts):
        assert arva("campaign", plan, "--shard", f"{n + 1}/3", "--out", part).code == 0
        assert rows(part) == 8
    code, _, err = arva("campaign", plan, "--out", merged, "--merge", parts[2], parts[0])
    assert code == 1
    assert f"16 of 24 results are in {merged}/results.sqlite; the same command without --merge flies the rest" in err
    assert arva("campaign", plan, "--out", merged, "--merge", *parts).code == 0  # two of them are there already
    assert rows(merged) == 24
    with opened(merged) as results:
        assert results.rows == {one.key: row(one, fakes.fake(one.trial)) for one in fakes.planned()}


def test_the_folder_of_a_part_has_its_name(arva: Arva, plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(plan.parent)
    plan.write_text(fakes.PLAN)
    assert arva("campaign", plan, "--shard", "2/6").code == 0
    with opened(Path("plan-results-2-of-6")) as results:
        assert {one.seed for one in results.rows.values()} == {2}


def test_what_cannot_be_merged_is_said_and_nothing_is_changed(arva: Arva, plan: Path, tmp_path: Path) -> None:
    plan.write_text(fakes.PLAN)
    every = [row(one, fakes.fake(one.trial)) for one in fakes.planned()]
    one = every[0]
    with opened(tmp_path / "a") as results, opened(tmp_path / "b") as others:
        results.add(*every)
        others.add(replace(one, frames=one.frames + 1, numpy="1.0"), *every[1:9])
    code, _, err = arva("campaign", plan, "--out", tmp_path / "a", "--merge", tmp_path / "b")
    assert code == 1
    differs = f"e.g. {one.key} ({one.strategy}, seed {one.seed}), frames {one.frames + 1} instead of {one.frames}: "
    assert f"1 trials ended differently than in {tmp_path / 'a'}, {differs}flown by numpy 1.0 instead of " in err
    with opened(tmp_path / "a") as results:
        assert results.rows[one.key] == one
    code, _, err = arva("campaign", plan, "--out", tmp_path / "a", "--merge", tmp_path / "none")
    assert code == 1
    assert f"{tmp_path / 'none'}: no results.sqlite there, expected the folder of a campaign" in err
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize("text", ["0/3", "4/3", "1", "1/0", "-1/3", "a/b"])
def test_a_part_that_is_none_is_refused(arva: Arva, plan: Path, text: str) -> None:
    code, _, err = arva("campaign", plan, f"--shard={text}")
    assert code == 2
    assert f"--shard: '{text}': expected K/N with K from 1 to N, e.g. 3/100" in err


def test_more_parts_than_seeds_and_more_trials_than_one_run_has_memory_for(arva: Arva, plan: Path) -> None:
    plan.write_text(fakes.PLAN)
    code, _, err = arva("campaign", plan, "--shard", "1/7")
    assert code == 2
    assert "--shard 1/7: the plan has 6 seeds, each part needs one at least" in err
    plan.write_text(fakes.PLAN.replace("seeds: 6", "seeds: 2500000"))
    code, _, err = arva("campaign", plan)
    assert code == 2
    assert "10000000 trials, at most 200000 in one run: fly it in parts, --shard 1/50" in err
