"""The order in which several workers take the tests (order.py)."""

from __future__ import annotations

from collections import Counter

import pytest

from tests.order import dealt

TESTS = [(file, number, file in "bd") for file in "abcdefg" for number in range({"b": 41, "d": 3}.get(file, 50))]


def waits(test: tuple[str, int, bool]) -> bool:
    return test[2]


def of(workers: int) -> list[tuple[str, int, bool]]:
    return dealt(TESTS, workers, waits, lambda test: test[0])


def pieces(workers: int) -> list[list[tuple[str, int, bool]]]:
    """As pytest-xdist cuts the list."""
    left, found = of(workers), []
    for remaining in range(workers, 0, -1):
        size = len(left) // remaining
        found.append(left[:size])
        left = left[size:]
    return found


@pytest.mark.parametrize("workers", [1, 2, 3, 4, 6, 16, 400])
def test_every_test_is_run_once(workers: int) -> None:
    assert Counter(of(workers)) == Counter(TESTS)


@pytest.mark.parametrize("workers", [2, 3, 4, 6])
def test_each_worker_has_as_many_that_wait_and_ends_with_some_that_do_not(workers: int) -> None:
    waiting = [sum(map(waits, piece)) for piece in pieces(workers)]
    assert max(waiting) - min(waiting) <= 4
    assert not any(waits(test) for piece in pieces(workers) for test in piece[-3:])


def test_those_of_a_file_stay_in_order_and_together_by_four() -> None:
    order = of(3)
    numbers = [number for file, number, _ in order if file == "d"]
    assert numbers == [0, 1, 2]
    first = order.index(("d", 0, True))
    assert [test[1] for test in order[first : first + 3]] == [0, 1, 2]
    quick = [test for piece in pieces(3) for test in piece if not waits(test)]
    assert quick == [test for test in TESTS if not waits(test)]
