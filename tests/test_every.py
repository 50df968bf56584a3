"""Cases that are one test: all are tried, and each that fails is named."""

from __future__ import annotations

import inspect

import pytest

from tests.every import every


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
