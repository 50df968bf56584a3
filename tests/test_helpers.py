"""The helpers of the tests: cases in one test, the order for several workers, the list of slow tests."""

from __future__ import annotations

import inspect
from collections import Counter
from pathlib import Path

import pytest

from tests import conftest, slow
from tests.every import every
from tests.order import dealt


def test_every_case_is_tried_and_each_that_fails_is_named() -> None:
    tried: list[tuple[int, str, str]] = []

    @every("number, word", [(1, "a"), pytest.param(2, "b", id="the second"), (3, "c"), (4, "d")])
    def check(fixture: str, number: int, word: str) -> None:
        tried.append((number, word, fixture))
        if number == 3:
            pytest.fail("not this one")
        assert number != 2

    assert list(inspect.signature(check).parameters) == ["fixture"]
    with pytest.raises(BaseExceptionGroup, match="2 of 4 cases of check") as raised:
        check(fixture="f")
    assert tried == [(1, "a", "f"), (2, "b", "f"), (3, "c", "f"), (4, "d", "f")]
    assert [error.__notes__ for error in raised.value.exceptions] == [["case: the second"], ["case: (3, 'c')"]]


def test_one_name_is_one_value_and_they_can_be_stacked() -> None:
    tried: list[tuple[object, bool]] = []

    @every("one", [(1, 2), "ab"])
    @every("flag", [True, False])
    def check(one: object, flag: bool) -> None:
        tried.append((one, flag))

    check()
    assert tried == [((1, 2), True), ((1, 2), False), ("ab", True), ("ab", False)]


def test_no_case_is_a_mistake() -> None:
    with pytest.raises(AssertionError):
        every("one", [])


# -- The order in which several workers take the tests (order.py) -----------------------------------------


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


@every("workers", [1, 2, 3, 4, 6, 16, 400])
def test_every_test_is_run_once(workers: int) -> None:
    assert Counter(of(workers)) == Counter(TESTS)


@every("workers", [2, 3, 4, 6])
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


# -- What `make test-fast` leaves out is there ------------------------------------------------------------


@pytest.mark.parametrize(("wanted", "left_out"), [("not slow", True), ("not slow or counted", None), ("", None)])
def test_a_file_of_slow_tests_is_not_imported_where_none_is_wanted(
    wanted: str, left_out: bool | None, pytestconfig: pytest.Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pytestconfig.option, "markexpr", wanted)
    here = Path(__file__).parent
    ignored = [
        conftest.pytest_ignore_collect(here / path, pytestconfig)
        for path in ("search/test_pilot.py", "cli/test_run.py", "config/test_scenario.py", "search")
    ]
    assert ignored == [left_out, None, None, None]


def test_what_is_called_slow_is_a_test() -> None:
    assert slow.strangers(Path(__file__).parent) == []
