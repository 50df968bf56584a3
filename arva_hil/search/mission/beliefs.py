"""Reports the estimate of a strategy to observers of a search."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from arva_hil.events import Event
from arva_hil.events.searches import BeliefChanged, PlaceFound
from arva_hil.search.strategies.strategy import Belief, Found

_EVERY_S: Final = 0.5


class Beliefs:
    """Emits a `BeliefChanged` at most twice a second, if the strategy tells what it believes.

    Remembers when it is due next.
    """

    def __init__(self, emit: Callable[[Event], None]) -> None:
        self._emit = emit
        self._due_s = -math.inf

    def look(self, time_s: float, transmitter: int | None, belief: Belief | None) -> None:
        """Emit a belief, if it is time to."""
        if belief is not None and time_s >= self._due_s:
            self._due_s = time_s + _EVERY_S
            self._emit(BeliefChanged(time_s, transmitter, *belief))

    def found(self, time_s: float, transmitter: int | None, found: Found, sure: bool) -> None:
        """The strategy has found a place. `sure`: the readings agree with it."""
        north, east, _, covariance, _ = found
        self._emit(PlaceFound(time_s, transmitter, north, east, covariance, sure))
