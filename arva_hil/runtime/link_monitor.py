"""Makes events about a link that may be lost and come back."""

from __future__ import annotations

from typing import Final, NamedTuple

from arva_hil.events import Event, LinkBack, LinkBlocked, LinkLost, LinkThere, StrangersIgnored
from arva_hil.links import Link

_WORTH_SAYING_S: Final = 0.05  # a shorter absence is not reported


class _Seen(NamedTuple):
    """The attributes of a `Link` at one time."""

    losses: int
    renewals: int
    returns: int
    strangers: int
    away: bool
    why: str


class LinkMonitor:
    """Remembers the last state of one link that may be lost and come back."""

    def __init__(self, name: str, link: Link) -> None:
        self.name = name
        self.link = link
        self._lost_at = 0.0
        self._seen = _seen(link)

    @property
    def lost_again(self) -> bool:
        """Whether it was lost since the last `look`."""
        return self.link.losses > self._seen.losses

    @property
    def renewed_again(self) -> bool:
        """Whether it has a new far end since the last `look`."""
        return self.link.renewals > self._seen.renewals

    def look(self, now: float) -> list[Event]:
        """The events since the last call."""
        before, link, events = self._seen, self.link, list[Event]()
        counts = link.losses, link.renewals, link.returns, link.strangers
        if counts == before[:4] and link.why == before.why and link.away == before.away:
            return events
        self._seen = seen = _seen(link)
        about = now, self.name, self.link.name
        if seen.losses > before.losses:
            self._lost_at = now
            events.append(LinkLost(*about, seen.why))
        elif seen.away and seen.why != before.why:
            events.append(LinkBlocked(*about, seen.why))
        if seen.returns > before.returns:
            away = now - self._lost_at
            events.append(LinkBack(*about, away if away > _WORTH_SAYING_S else 0.0))
        elif before.away and not seen.away:
            events.append(LinkThere(*about))
        if seen.strangers and not before.strangers:
            events.append(StrangersIgnored(*about, self.link.stranger))
        return events


def _seen(link: Link) -> _Seen:
    return _Seen(link.losses, link.renewals, link.returns, link.strangers, link.away, link.why)
