"""The events of one vehicle, in their order."""

from __future__ import annotations

from arva_hil.events import Event


class EventQueue:
    """Remembers events until they are taken. `name`: the vehicle's name in its events."""

    def __init__(self, name: str = "vehicle") -> None:
        self.name = name
        self._events: list[Event] = []

    def emit(self, event: Event) -> None:
        self._events.append(event)

    def take(self) -> list[Event]:
        """The events since the last call."""
        events = self._events
        if events:
            self._events = []
        return events
