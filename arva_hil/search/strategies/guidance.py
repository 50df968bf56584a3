"""The steering loop's side of an analysis. It sends orders and gets answers without waiting."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from arva_hil.events import Event
from arva_hil.events.searches import StrategySlow
from arva_hil.search.strategies.analysis import Analysis, AnalysisResult, Order, Worker, silent
from arva_hil.search.strategies.strategy import STILL, Observation, Position, Velocity

_HELD_S: Final = 1.0  # fly a velocity for this long without a new one
_MOST_ORDERS: Final = 256  # in a batch: a pipe accepts these without waiting


class Guidance:
    """Remembers the waiting orders, the newest answer, and the age of the velocity that is flown.

    `number`: of the present strategy. `patience_s`: the longest time for one answer. Times are of the mission's clock,
    which does not run while the computer pauses.
    """

    def __init__(self, worker: Worker, emit: Callable[[Event], None], patience_s: float) -> None:
        self.number = 0
        self._worker = worker
        self._emit = emit
        self._patience_s = patience_s
        self._orders: list[Order] = []
        self._question: Order | None = None  # the newest question, sent after the orders
        self._sent_s: float | None = None  # when the unanswered batch was sent
        self._starved_s = 0.0  # the worker's, before that batch
        self._warn_s = _HELD_S  # report an answer that takes longer
        self._velocity, self._velocity_s = STILL, -math.inf
        self._contradictions: tuple[bool, ...] | None = None

    def add(self, id_: int, o: Observation) -> None:
        """Add a reading of a transmitter."""
        self._orders.append((Analysis.add, id_, o))

    def forget(self, id_: int) -> None:
        """Forget the readings of a transmitter."""
        self._orders.append((Analysis.forget, id_))

    def begin(self, id_: int, *, has_id: bool) -> None:
        """Begin a new strategy, for a transmitter."""
        self.leave()
        self._orders.append((Analysis.begin, self.number, id_, has_id))

    def leave(self) -> None:
        """Use no more answers of the present strategy."""
        self.number += 1
        self._velocity, self._contradictions, self._question = STILL, None, None

    def observe(self, o: Observation, height_m: float) -> None:
        """Give the strategy a reading. `height_m`: the height wanted."""
        self._orders.append((Analysis.observe, o, height_m))

    def steer(self, time_s: float, position: Position) -> AnalysisResult | None:
        """Ask the strategy for a velocity. Returns the result of `exchange`."""
        self._question = Analysis.steer, time_s, position
        return self.exchange(time_s)

    def velocity(self, time_s: float) -> Velocity:
        """Return the last velocity of the strategy for 1 s, then hover."""
        return self._velocity if time_s - self._velocity_s <= _HELD_S else STILL

    def contradictions(self, time_s: float) -> tuple[bool, ...] | None:
        """Return which of the newest readings contradict the place found, None before it is known."""
        self._question = Analysis.check, time_s
        self.exchange(time_s)
        return self._contradictions

    def exchange(self, time_s: float) -> AnalysisResult | None:
        """Send the waiting orders if the last batch is answered. Returns a new answer of the strategy, or None."""
        answer = None if self._sent_s is None else self._collect(time_s, self._sent_s)
        if self._sent_s is None and (self._orders or self._question):
            batch = self._orders[:_MOST_ORDERS]
            del self._orders[:_MOST_ORDERS]
            if self._question and not self._orders:
                batch.append(self._question)
                self._question = None
            self._worker.send(batch)
            self._sent_s, self._starved_s = time_s, self._worker.starved_s
            answer = self._collect(time_s, time_s) or answer
        return answer

    def silent(self, time_s: float) -> str:
        """Return the end of the search if the strategy takes too long, otherwise "".

        Time in which it waited for a processor does not count.
        """
        if self._sent_s is None or time_s - self._sent_s <= self._patience_s:
            return ""
        took_s = time_s - self._sent_s - (self._worker.starved_s - self._starved_s)
        return silent(took_s) if took_s > self._patience_s else ""

    def _collect(self, time_s: float, sent_s: float) -> AnalysisResult | None:
        if (answer := self._worker.receive()) is None:
            if time_s - sent_s > self._warn_s:
                starved_s = self._worker.starved_s - self._starved_s
                self._emit(StrategySlow(time_s, time_s - sent_s, starved_s))
                self._warn_s = 2 * (time_s - sent_s)
            return None
        self._sent_s = None
        if answer.failed:
            return answer
        if answer.number != self.number:
            return None
        if answer.velocity is not None:
            self._velocity, self._velocity_s = answer.velocity, time_s
        if answer.contradictions is not None:
            self._contradictions = answer.contradictions
        return answer
