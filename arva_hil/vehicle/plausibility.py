"""What does not follow from what was heard before: not believed until it lasts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Generic, Literal, TypeVar

T = TypeVar("T")
Judgement = Literal["follows", "stray", "anew"]

_SETTLE_S: Final = 0.5


class Plausibility(Generic[T]):
    """Remembers the last value believed and the last one doubted.

    `follows(old, new, gap_s)` tells whether one value can come so long after another. Values that cannot are stray
    until two in a row agree with each other and the last one believed was heard 0.5 s ago: then all begins anew. So
    a single stray value changes nothing, and of two sources that speak at once the first is believed. `best(old, new)`
    is what is remembered of two values that follow: the new one, unless it says else.
    """

    def __init__(self, follows: Callable[[T, T, float], bool], best: Callable[[T, T], T] | None = None) -> None:
        self.strays = 0
        self.replaced: T | None = None  # what was believed before all began anew the last time
        self._follows = follows
        self._best = best
        self._believed: tuple[T, float] | None = None
        self._doubted: tuple[T, float] | None = None

    def judge(self, value: T, now: float) -> Judgement:
        """What to make of a value heard at `now` [s]."""
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
        """Whatever comes next is believed."""
        self._believed = self._doubted = None
