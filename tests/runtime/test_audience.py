"""An observer that raises, whatever it raises and at whichever event, is switched off and stops nothing."""

from __future__ import annotations

import pytest

from arva_hil.cli.watchers import close_all
from arva_hil.events import Event, ObserverFailed
from arva_hil.events.words.text import Notice
from arva_hil.runtime.audience import Audience


class Unspeakable(Exception):
    def __repr__(self) -> str:
        raise ValueError("no repr")

    __str__ = __repr__


ERRORS = [ValueError("a mistake"), SystemExit(7), GeneratorExit(), Unspeakable()]


class Raises:
    """Raises an error from the `at`-th event on, and when it is closed."""

    def __init__(self, error: BaseException, at: int = 1) -> None:
        self._error = error
        self._left = at
        self.called = 0

    def observe(self, event: Event) -> None:
        self.called += 1
        if self.called >= self._left:
            raise self._error

    def close(self) -> None:
        raise self._error


class Remembers:
    def __init__(self) -> None:
        self.events: list[Event] = []

    def observe(self, event: Event) -> None:
        self.events.append(event)


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("at", [1, 2, 3])
def test_it_is_switched_off_and_the_others_are_told_once(error: BaseException, at: int) -> None:
    bad, good = Raises(error, at), Remembers()
    audience = Audience([bad, good])
    every = [Event(float(n)) for n in range(3)]
    for event in every:
        audience.emit([event])
    assert [event for event in good.events if not isinstance(event, ObserverFailed)] == every
    (failure,) = [event for event in good.events if isinstance(event, ObserverFailed)]
    assert (failure.time_s, failure.observer, bad.called) == (at - 1.0, "Raises", at)


def test_two_that_fail_are_told_of_once_each() -> None:
    good = Remembers()
    audience = Audience([Raises(ValueError()), Raises(ValueError()), good])
    audience.emit([Event(1.0)])
    assert [type(event) for event in good.events] == [ObserverFailed, ObserverFailed, Event]


def test_ctrl_c_is_no_error_of_an_observer() -> None:
    with pytest.raises(KeyboardInterrupt):
        Audience([Raises(KeyboardInterrupt())]).emit([Event(1.0)])


def test_one_that_cannot_be_closed_keeps_no_other_from_it() -> None:
    said: list[Notice] = []
    close_all([Raises(error) for error in ERRORS], said.append)
    assert [notice.text.partition(": ")[2].partition(": ")[0] for notice in said] == ["close() failed"] * len(ERRORS)
