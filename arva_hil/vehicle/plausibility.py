"""Ignores values that do not fit the values before, until they last."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Generic, Literal, TypeVar

T = TypeVar("T")
Judgement = Literal["follows", "stray", "anew"]

_SETTLE_S: Final = 0.5


class Plausibility(Generic[T]):
    """Remembers the last value that was accepted, and the last one that was not.

    `follows(old, new, gap_s)`: whether `new` can come `gap_s` after `old`. A value that cannot is stray. If two stray
    values in a row fit each other, and the last accepted value is at least 0.5 s old, they replace it: a new start. So
    a single stray value changes nothing, and of two sources at the same time the first one is used. `best(old, new)`:
    the one of two accepted values to remember; by default the new one.
    """

    def __init__(self, follows: Callable[[T, T, float], bool], best: Callable[[T, T], T] | None = None) -> None:
        self.strays = 0
        self.replaced: T | None = None  # the value before the last new start
        self._follows = follows
        self._best = best
        self._believed: tuple[T, float] | None = None
        self._doubted: tuple[T, float] | None = None

    def judge(self, value: T, now: float) -> Judgement:
        """Whether to accept a value received at `now` [s]."""
        believed, doubted = self._believed, self._doubted
        if believed is None or self._follows(believed[0], value, now - believed[1]):
            best = self._best
            self._believed, self._doubted = (best(believed[0], value) if best and believed else value, now), None
            return "follows"
        if doubted and now - believed[1] >= _SETTLE_S and self._follows(doubted[0], value, now - doubted[1]):
            self.replaced = believed[0]
            self._believed, self._doubted = (value, now), None
            return "anew"
        self._doubted = value, now
        self.strays += 1
        return "stray"

    def forget(self) -> None:
        """Accept the next value, whatever it is."""
        self._believed = self._doubted = None
