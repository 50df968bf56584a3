"""What there is to tell of a link that may be lost and come back."""

from __future__ import annotations

from typing import Final

from arva_hil.events import Event, LinkBack, LinkBlocked, LinkLost, LinkThere, StrangersIgnored
from arva_hil.links import Link

_WORTH_SAYING_S: Final = 0.05  # a link that was away for less was not away


class LinkMonitor:
    """Remembers what was last seen of one link that may be lost and come back."""

    def __init__(self, name: str, link: Link) -> None:
        self.name = name
        self.link = link
        self._lost_at = 0.0
        self._note()

    @property
    def lost_again(self) -> bool:
        return self.link.losses > self._losses

    @property
    def renewed_again(self) -> bool:
        return self.link.renewals > self._renewals

    def look(self, now: float) -> list[Event]:
        """What has happened to it since the last look."""
        link, events = self.link, list[Event]()
        about = now, self.name, link.name
        if self.lost_again:
            self._lost_at = now
            events.append(LinkLost(*about, link.why))
        elif link.away and link.why != self._why:
            events.append(LinkBlocked(*about, link.why))
        if link.returns > self._returns:
            away = now - self._lost_at
            events.append(LinkBack(*about, away if away > _WORTH_SAYING_S else 0.0))
        elif self._away and not link.away:
            events.append(LinkThere(*about))
        if link.strangers and not self._strangers:
            events.append(StrangersIgnored(*about, link.stranger))
        self._note()
        return events

    def _note(self) -> None:
        link = self.link
        self._losses, self._renewals, self._returns, self._why = link.losses, link.renewals, link.returns, link.why
        self._strangers, self._away = link.strangers, link.away
