"""What the tests share: the recorded flights, a user who is not root, links whose far ends are in this process."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Callable, Generator, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest
from hypothesis import settings

from tests import order, slow
from tests.browser import browser

__all__ = ["browser"]  # one fixture: Playwright refuses a second browser in a worker

TESTS = Path(__file__).parent
DATA = TESTS / "data"

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in the program; else the workers' threads wait for each other
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # or each worker and each program compiles everything again
sys.dont_write_bytecode = False
settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=25)
settings.register_profile("thorough", deadline=None, max_examples=500)  # --hypothesis-profile=thorough
settings.load_profile("repeatable")
gc.disable()  # until all tests are collected: nearly half of the time that takes

# What is ignored here, the programs under test ignore too: SIGINT in a job in the background, SIGHUP under `nohup`
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Where no slow test is wanted, files of slow tests and what they need are not imported."""
    path = collection_path.relative_to(TESTS).as_posix() if collection_path.is_relative_to(TESTS) else ""
    return True if config.getoption("markexpr") == "not slow" and path in slow.SLOW else None


@pytest.hookimpl(wrapper=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> Generator[None]:
    """Mark the slow ones (slow.py); those that are left have an order for several workers (order.py)."""
    for item in items:
        name = getattr(item, "originalname", item.name)
        path, fixtures = item.path.relative_to(TESTS).as_posix(), getattr(item, "fixturenames", [])
        if why := slow.reason(path, name, fixtures):
            item.add_marker(pytest.mark.slow(why))
            if slow.counted(path, fixtures):
                item.add_marker(pytest.mark.counted)
    yield
    workers = getattr(config, "workerinput", {}).get("workercount", 1)
    if workers > 1:
        items[:] = order.dealt(items, workers, waits, lambda item: item.path)


def pytest_collection_finish() -> None:
    """What was collected stays: it is not looked through for garbage again and again, and what is new seldom is."""
    gc.freeze()
    gc.set_threshold(200_000)  # a twentieth of the time of the tests, with Python's own
    gc.enable()


def waits(item: pytest.Item) -> bool:
    marker = item.get_closest_marker("slow")
    return marker is not None and marker.args[0] in slow.WAITS


@pytest.fixture(params=["arducopter", "px4"])
def flight(request: pytest.FixtureRequest) -> Path:
    """A piece of a recorded flight, of either autopilot: take-off and the first corner of the square."""
    return DATA / f"{request.param}.tlog"


@pytest.fixture
def ordinary() -> Callable[[], AbstractContextManager[None]]:
    """`with ordinary():` not as root, who may read everything."""

    @contextmanager
    def change() -> Iterator[None]:
        root = os.geteuid() == 0
        if root:
            os.seteuid(65534)
        try:
            yield
        finally:
            if root:
                os.seteuid(0)

    return change
