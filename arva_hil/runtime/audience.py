"""Gives events to observers. They get frozen events, and cannot change or stop the engine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from arva_hil.events import Event, HeartbeatMissing, ObserverFailed
from arva_hil.events.words.reasons import no_vehicle
from arva_hil.safe_text import shown


class Observer(Protocol):
    """Gets every event, in order. `close` of an observer from another package is called at the end, if it has one."""

    def observe(self, event: Event) -> None:
        """Handle one event. Must not block."""


class Audience:
    """The observers. One that raises is switched off, and the others get an `ObserverFailed`."""

    def __init__(self, observers: Sequence[Observer]) -> None:
        self._observers = list(observers)

    def emit(self, events: Sequence[Event]) -> None:
        """Give each event to all observers."""
        for event in events:
            for observer in self._observers:
                try:
                    observer.observe(event)
                except KeyboardInterrupt:
                    raise
                except BaseException as error:  # also SystemExit, from another package
                    self._switch_off(observer, event, error)

    def _switch_off(self, observer: Observer, event: Event, error: BaseException) -> None:
        left = [one for one in self._observers if one is not observer]
        if len(left) < len(self._observers):  # not yet, while another one got it
            self._observers = left
            self.emit([ObserverFailed(event.time_s, type(observer).__name__, shown(error))])


class MissingVehicles:
    """Remembers the vehicles without a heartbeat in time. `str()` is the traffic on their links instead, in words.

    `count`: the number of vehicles in the run.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._traffic: dict[str, str] = {}  # by the vehicle's name

    def observe(self, event: Event) -> None:
        if isinstance(event, HeartbeatMissing):
            self._traffic[event.vehicle] = no_vehicle(event.heard)

    @property
    def all(self) -> bool:
        """True if no vehicle has appeared."""
        return len(self._traffic) == self._count

    def __str__(self) -> str:
        return "; ".join(dict.fromkeys(self._traffic.values()))
