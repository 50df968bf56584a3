"""The loop serves whoever is due or has bytes to read, and leaves the others alone."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import pytest

from arva_hil.clock import Clock, StepClock, Waitable
from arva_hil.links import Link, memory
from arva_hil.runtime.loop import run


class Every:
    """A task that wants to be called every `period` seconds, from `first` on; `told`: when it was called."""

    def __init__(self, period: float, first: float = 0.0, links: Sequence[Link] = ()) -> None:
        self.links = links
        self.told: list[float] = []
        self._due = first
        self._period = period

    def service(self, clock: Clock) -> float:
        self.told.append(clock.now())
        for link in self.links:
            link.read()
        if clock.now() >= self._due:
            self._due += self._period
        return self._due


def test_deadlines_that_differ_only_in_how_they_were_reckoned_are_one() -> None:
    sums, products = Every(0.05), Every(0.05, first=0.05 + 1e-12)
    run([sums, products], StepClock(), until=0.475)
    assert sums.told == products.told
    assert len(sums.told) == 11  # ten, and the last look


def test_a_task_that_is_called_a_hair_too_early_is_called_with_those_that_are_due_then() -> None:
    """0.9 s and the longest wait are a hair less than 1 s: the quick task would act without what the slow one says."""
    quick, slow = Every(0.1, first=0.1 - 1e-12), Every(1.0, first=1.0)
    run([slow, quick], StepClock(), until=1.05)
    assert slow.told[-2] == quick.told[-2] == 1.0


def test_who_is_not_due_and_has_nothing_to_read_is_left_alone() -> None:
    quick, slow = Every(0.02), Every(0.08, first=0.08)
    run([quick, slow], StepClock(), until=0.81)
    assert len(quick.told) == 42
    assert slow.told == pytest.approx([0.0, *(0.08 * n for n in range(1, 11)), 0.81])


def test_whose_link_has_bytes_is_served_at_once() -> None:
    near, far = memory.pair()

    class Speaker(Every):
        def service(self, clock: Clock) -> float:
            if len(self.told) == 2:
                near.write(b"news")
            return super().service(clock)

    listener, speaker = Every(math.inf, first=math.inf, links=[far]), Speaker(0.03)
    run([listener, speaker], StepClock(), until=0.08)
    assert listener.told == pytest.approx([0.0, 0.06, 0.08])


def test_a_link_that_wakes_the_clock_and_has_nothing_to_read_is_looked_into() -> None:
    """As one that is hung up: else the clock would be woken again and again, and nobody ask why."""

    class HungUp(memory.MemoryLink):
        def ready(self) -> bool:
            return False

    class Woken(StepClock):
        def wait(self, deadline: float, links: Iterable[Waitable] = ()) -> None:
            self._now = min(deadline, self._now + 0.01)

    looks, other = Every(1.0, first=1.0, links=[HungUp("hung up", None)]), Every(0.05)
    run([looks, other], Woken(), until=0.045)
    assert looks.told == pytest.approx([0.0, 0.01, 0.02, 0.03, 0.04, 0.045])


def test_nobody_is_left_alone_for_longer_than_a_tenth_of_a_second() -> None:
    quick, waiting = Every(0.01), Every(math.inf, first=math.inf)
    run([quick, waiting], StepClock(), until=1.05)
    assert waiting.told == pytest.approx([*(0.1 * n for n in range(11)), 1.05])
