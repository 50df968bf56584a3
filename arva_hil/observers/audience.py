"""Those who watch an engine. They get frozen events, and cannot change, slow or stop anything."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from arva_hil.events import Event, ObserverFailed


class Observer(Protocol):
    """Whoever hears of every event, in order. A method `close` of one from another package is called at the end."""

    def observe(self, event: Event) -> None:
        """Take one event; it must not wait for anything."""


class Audience:
    """Remembers who observes. One that raises is switched off, which the others hear of, and stops nothing."""

    def __init__(self, observers: Sequence[Observer]) -> None:
        self.failed = 0
        self._observers = list(observers)

    def tell(self, events: Sequence[Event]) -> None:
        """Give every event to everybody."""
        for event in events:
            for observer in tuple(self._observers):
                try:
                    observer.observe(event)
                except Exception as error:
                    self.failed += 1
                    self._observers.remove(observer)
                    self.tell([ObserverFailed(event.time_s, type(observer).__name__, repr(error))])
