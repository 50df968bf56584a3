"""The events of one vehicle, in the order in which they happened."""

from __future__ import annotations

from arva_hil.events import Event


class EventQueue:
    """Remembers events until somebody takes them. `name`: of the vehicle, as its events have it."""

    def __init__(self, name: str = "vehicle") -> None:
        self.name = name
        self._events: list[Event] = []

    def emit(self, event: Event) -> None:
        self._events.append(event)

    def take(self) -> list[Event]:
        """What has happened since the last call."""
        events = self._events
        if events:
            self._events = []
        return events
