"""A session that keeps its events until a test takes them."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any

from arva_hil.autopilot.following.session import Received, Session
from arva_hil.events import Event
from arva_hil.mavlink.codec import Packet


class KeepingSession(Session):
    """A session whose events are kept."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.kept: list[Event] = []

    def receive(self, packets: Sequence[Packet], now: float, sender: Hashable = None) -> Received:
        received = super().receive(packets, now, sender)
        self.kept += received.events
        return received

    def poll(self, now: float) -> tuple[bytes, Sequence[Event]]:
        data, events = super().poll(now)
        self.kept += events
        return data, events

    def take_events(self) -> list[Event]:
        """Return the events since the last call."""
        events, self.kept = self.kept, []
        return events
