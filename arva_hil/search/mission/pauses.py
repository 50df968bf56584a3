"""The rules by which a search hovers, and by which it ends, because the receiver does not work."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Literal

from arva_hil.events import Event
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.events.searches import SearchPaused, SearchResumed
from arva_hil.search.mission.reading_checks import StuckReadings
from arva_hil.search.strategies.strategy import Position
from firmware_proto import Frame

_SILENT_S: Final = 2.0  # without a frame: the receiver does not work, hover


class Pauses:
    """Remembers the last frame, whether readings change, and why the vehicle hovers.

    `patience_s`: it hovers no longer than that. `emit` gets the events.
    """

    def __init__(self, start_s: float, patience_s: float, emit: Callable[[Event], None]) -> None:
        self._patience_s = patience_s
        self._last_frame_s = self._since_s = start_s
        self._why: Literal["no frame", "same readings"] | None = None
        self._standstill = StuckReadings()
        self._emit = emit

    def hear(self, frame: Frame, position: Position, time_s: float) -> bool:
        """A new frame; whether it may be used: not if it repeats a reading from another place."""
        self._last_frame_s = time_s
        self._standstill.hear(frame, position, time_s)
        return not self._standstill.whole.old

    def repeats(self, id_: int | None) -> bool:
        """Return True if the last frame's reading of this transmitter is from another place."""
        return self._standstill.repeats(id_)

    def silent(self, time_s: float) -> Reason | None:
        """Return the end of the search if no frame came for too long."""
        too_long = time_s - self._last_frame_s > self._patience_s
        return because(Why.NO_FRAME, seconds=self._patience_s) if too_long else None

    def waits(self, time_s: float) -> bool:
        """Return True if the search hovers because the receiver does not work."""
        before, stuck = self._why, self._standstill.whole.stuck
        silent = time_s - self._last_frame_s > _SILENT_S
        why: Literal["no frame", "same readings"] | None = "same readings" if stuck else None
        self._why = why = "no frame" if silent else why
        if why and why != before:
            self._since_s = time_s
            self._emit(SearchPaused(time_s, why, _SILENT_S, round(self._standstill.whole.moved_m, 1)))
        elif before and not why:
            self._emit(SearchResumed(time_s, before))
        return why is not None

    def stuck(self, time_s: float) -> Reason | None:
        """Return the end of the search if the same reading came for too long."""
        too_long = self._why == "same readings" and time_s - self._since_s > self._patience_s
        return because(Why.SAME_READING) if too_long else None
