"""The last check of a place: the newest readings agree with it, or its transmitter has moved."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from arva_hil.events import Event
from arva_hil.events.searches import PlaceDoubted
from arva_hil.search.mission.choice import Choice, id_of
from arva_hil.search.strategies.guidance import Guidance
from arva_hil.search.strategies.strategy import Found

AGREES: Final = "the newest readings agree with the place"
LISTEN: Final = "the last one does not: more are needed"
LOOK_AGAIN: Final = "they do not: the search visits the transmitter again"
NOT_THERE: Final = "they do not, and the transmitter was visited again before"

_MANY: Final = 0.7  # of the newest readings: they contradict the place
_AGAIN: Final = 2  # visits of a doubted transmitter
_SAME_M: Final = 1.0  # a place found twice within this distance is right


class LastLook:
    """Remembers the places that were doubted. `choice`: the transmitter that is flown to."""

    def __init__(self, choice: Choice, guidance: Guidance, emit: Callable[[Event], None]) -> None:
        self._choice = choice
        self._guidance = guidance
        self._emit = emit
        self._doubted: list[tuple[float, float]] = []

    def check(self, found: Found, time_s: float, *, last: bool) -> str:
        """Check that the newest readings agree with the place found. To search for it again, forget them.

        `last`: there is no time for more.
        """
        id_ = self._choice.target
        contradicting = self._guidance.contradictions(time_s)
        if contradicting is None:
            return AGREES if last else LISTEN
        if id_ is None or sum(contradicting) <= _MANY * len(contradicting):
            return LISTEN if any(contradicting[-1:]) and not last else AGREES
        if any(math.dist(found[:2], place) < _SAME_M for place in self._doubted):
            return AGREES
        if last or len(self._doubted) == _AGAIN:
            return NOT_THERE
        self._doubted.append(found[:2])
        self._emit(PlaceDoubted(time_s, id_of(id_), found.north, found.east))
        self._choice.forget(id_)
        return LOOK_AGAIN
