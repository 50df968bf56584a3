"""Who flies the trials: processes of this machine and a real cluster on it give the same, and fail in words."""

from __future__ import annotations

import gc
import os
import pickle
import socket
import sys
from collections.abc import Iterator
from contextlib import closing
from itertools import chain
from typing import TYPE_CHECKING

import pytest

from arva_hil.campaign import runner
from arva_hil.campaign.plan import Planned
from arva_hil.campaign.runner import Fly, MissingExtra, Unreachable, WorkerPool, WorkerPoolError, cluster, processes
from arva_hil.campaign.trial import Result

from . import fakes
from .fakes import FREE, fake, planned

if TYPE_CHECKING:
    from distributed import LocalCluster, Scheduler

EVERY = planned()
EXPECTED = {one.key: fake(one.trial) for one in EVERY}


def flown(crew: WorkerPool, fly: Fly = fake, every: list[Planned] = EVERY) -> dict[str, Result]:
    pairs = [(one.key, result) for some in crew.fly(every, fly, stopped=lambda: False) for one, result in some]
    results = dict(pairs)
    assert len(results) == len(pairs)
    return results


def frozen(_: object) -> Result:
    return Result(str(gc.get_freeze_count() > 1000), None, None, 0.0, 0.0, 0)


def test_processes_fly_every_trial_once() -> None:
    with processes(2) as crew:
        assert crew.name == "processes: 2"
        assert flown(crew) == EXPECTED
        assert [result.outcome for result in flown(crew, frozen, EVERY[:1]).values()] == ["True"]  # what is imported


def test_a_trial_that_raises_has_that_for_an_outcome_and_the_others_go_on() -> None:
    with processes(1) as crew:
        results = flown(crew, fakes.raising)
        exits = flown(crew, fakes.exiting, EVERY[:1])
    for one in EVERY:
        if one.trial.scenario.seed % 2:
            assert results[one.key] == Result("failed: ZeroDivisionError: by\nnothing", None, None, 0.0, 0.0, 0)
        else:
            assert results[one.key] == EXPECTED[one.key]
    assert [result.outcome for result in exits.values()] == ["failed: SystemExit: enough"]


def test_a_process_that_dies_is_said_after_the_results_before() -> None:
    got: list[tuple[Planned, Result]] = []
    with processes(1) as crew, pytest.raises(WorkerPoolError, match="a worker process died, killed or out of memory"):
        got.extend(chain.from_iterable(crew.fly(EVERY, fakes.dying, stopped=lambda: False)))
    free = [one for one in EVERY if one.trial.scenario.seed <= FREE]
    assert got == [(one, EXPECTED[one.key]) for one in free]


def test_it_stops_between_two_results_when_told_to() -> None:
    got: list[str] = []
    with fakes.here(1) as crew:
        for some in crew.fly(EVERY, fake, stopped=lambda: len(got) > 0):
            got.extend(one.key for one, _ in some)
    assert 0 < len(got) < len(EVERY)


def threads(_: object) -> Result:
    return Result(",".join(os.environ.get(name, "") for name in runner._ONE_THREAD), None, None, 0.0, 0.0, 0)


def test_numpy_has_one_thread_in_each_process_and_what_it_has_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    with processes(1) as crew:
        assert [result.outcome for result in flown(crew, threads, EVERY[:1]).values()] == ["1,1,1"]
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "MKL_NUM_THREADS" not in os.environ


# A cluster


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """A scheduler and two workers, all in this process, on the loopback interface."""
    with closing(local_cluster()) as local:
        yield local.scheduler_address


def local_cluster() -> LocalCluster:
    from distributed import LocalCluster  # here: it takes 0.3 s, in every worker that only collects this test

    return LocalCluster(
        n_workers=2, processes=False, threads_per_worker=1, host="tcp://127.0.0.1", dashboard_address="127.0.0.1:0"
    )


def test_a_cluster_flies_every_trial_once(scheduler: str) -> None:
    with cluster(scheduler, len(EVERY)) as crew:
        assert crew.name == "Dask workers: 2, threads: 2"
        assert flown(crew) == EXPECTED


def test_a_large_plan_goes_to_a_cluster_in_shards(scheduler: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "_AHEAD", 3)  # and no more at a time
    with cluster(scheduler, len(EVERY)) as crew:
        shards = list(crew.fly(EVERY, fakes.raising, stopped=lambda: False))
    assert crew.shard == len(EVERY) // 3 + 1
    assert max(map(len, shards)) == crew.shard
    assert sorted(one.key for some in shards for one, _ in some) == sorted(EXPECTED)
    kept = {one.key: result for some in shards for one, result in some if not result.outcome.startswith("failed")}
    assert kept == {key: EXPECTED[key] for key in kept}
    assert len(kept) == len(EVERY) // 2


def test_of_what_was_flown_the_scheduler_keeps_little(scheduler: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It logs its last 1000 messages to each worker with all that is in them."""
    from distributed import Client

    every = planned(fakes.PLAN.replace("seeds: 6", "seeds: 100"))
    monkeypatch.setattr(runner, "_AHEAD", 2)
    with Client(scheduler, set_as_default=False) as client:
        before = client.run_on_scheduler(kept)
        with cluster(scheduler, len(every)) as crew:
            assert crew.shard == 50
            assert len(flown(crew, every=every)) == 400
        assert client.run_on_scheduler(kept) - before < 8 * 5000  # 12 kB a shard as they are


def kept(dask_scheduler: Scheduler) -> int:
    """Bytes of the messages in the scheduler's logs of its workers."""
    return sum(len(pickle.dumps(list(comm.recent_message_log))) for comm in dask_scheduler.stream_comms.values())


def test_a_trial_that_raises_on_a_cluster_has_that_for_an_outcome(scheduler: str) -> None:
    with cluster(scheduler, len(EVERY)) as crew:
        results = flown(crew, fakes.raising)
    assert sum(result.outcome.startswith("failed: ZeroDivisionError") for result in results.values()) == 12


def test_a_scheduler_that_goes_is_said() -> None:
    with closing(local_cluster()) as local, cluster(local.scheduler_address, 1) as crew:
        results = crew.fly(EVERY, fake, stopped=lambda: False)
        next(results)
        local.close()
        with pytest.raises(Unreachable, match=r"the scheduler at tcp://127\.0\.0\.1:\d+ is gone"):
            list(results)


def test_a_scheduler_that_is_not_there_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "_CONNECT_S", 0.3)
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))  # and nobody listens
        address = f"tcp://127.0.0.1:{s.getsockname()[1]}"
        with pytest.raises(Unreachable, match=f"no Dask scheduler answers at {address}"), cluster(address, 1):
            pass


def test_without_dask_it_is_said_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtra, match=r"pip install 'arva-hil\[dask\]'"), cluster("tcp://127.0.0.1:1", 1):
        pass
