"""Links that are lost and come back, while a run goes on: who has to know, and what is said of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from arva_hil.autopilot.session import Session
from arva_hil.clock import Clock, Waitable
from arva_hil.links import Link
from arva_hil.observer import Observer
from arva_hil.watched import Watched

_LOOK_S: Final = 0.1


class LinkWatch:
    """Tells of both links of a run, one line when one is lost and one when it is back, and starts the session anew.

    One more line between the two says what a person has to see to before it can be back. `port` is None where frames
    go over the autopilot's link. It is a task, to be served before the emulator: what comes in at the port, which the
    emulator never reads, is read and forgotten, and so a loss shows there at once.
    """

    links: Sequence[Waitable] = ()

    def __init__(self, autopilot: Link, port: Link | None, session: Session, observers: Sequence[Observer]) -> None:
        self._autopilot = Watched(autopilot)
        self._port = Watched(port) if port else None
        self._session = session
        self._observers = observers
        if autopilot.away:  # not there yet
            session.interrupt(autopilot.why)

    def service(self, clock: Clock) -> float:
        now = clock.now()
        if self._port:
            self._port.link.read()
            self._tell(self._port, now)
        link = self._autopilot
        if link.lost_again:
            self._session.interrupt(link.link.why)
        if link.renewed_again:
            self._session.resume(now)
        self._tell(link, now)
        return now + _LOOK_S

    def counts(self) -> dict[str, int]:
        """How often each link was lost and came back, and what strangers sent to it."""
        return {
            f"{name}_link_{what}": getattr(side.link, what) if side else 0
            for name, side in (("autopilot", self._autopilot), ("port", self._port))
            for what in ("losses", "returns", "strangers")
        }

    def sums(self) -> list[str]:
        """A line for each link that was lost, for a person."""
        sides = [("the autopilot's link", self._autopilot), ("the port", self._port)]
        return [
            f"{what} was lost {side.link.losses} ×, and came back {side.link.returns} ×"
            for what, side in sides
            if side and side.link.losses
        ]

    def _tell(self, side: Watched, now: float) -> None:
        for notice in side.news(now):
            for observer in self._observers:
                observer.notice(notice)
