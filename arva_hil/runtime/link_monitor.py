"""Events about a link that may be lost and come back."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Final

from arva_hil.events import Event, LinkBack, LinkBlocked, LinkLost, LinkThere, StrangersIgnored
from arva_hil.links import Link

_WORTH_SAYING_S: Final = 0.05  # a shorter absence is not reported

_STATE: Final = operator.attrgetter("losses", "renewals", "returns", "strangers", "why")


class LinkMonitor:
    """Remembers the last state of one link that may be lost and come back. `away`: the link was lost then.

    `lost` is called after a loss with the reason and the time, `renewed` with the time when there is a new far end.
    """

    def __init__(
        self,
        name: str,
        link: Link,
        lost: Callable[[str, float], None] = lambda why, now: None,
        renewed: Callable[[float], None] = lambda now: None,
    ) -> None:
        self._name = name
        self.link = link
        self._lost = lost
        self._renewed = renewed
        self._lost_at = 0.0
        self._state, self.away = _STATE(link), link.away

    def poll(self, now: float) -> list[Event]:
        """Return the events since the last call."""
        if (state := _STATE(self.link)) == self._state:  # still away
            return []
        before, self._state, was_away, away = self._state, state, self.away, self.link.away
        self.away, events, about = away, list[Event](), (now, self._name, self.link.name)
        lost, renewed, returned, strange = map(operator.gt, state[:4], before[:4])
        why, why_before = state[4], before[4]
        if lost:
            self._lost_at = now
            self._lost(why, now)
            events.append(LinkLost(*about, why))
        elif away and why != why_before:
            events.append(LinkBlocked(*about, why))
        if renewed:
            self._renewed(now)
        if returned:
            away_s = now - self._lost_at
            events.append(LinkBack(*about, away_s if away_s > _WORTH_SAYING_S else 0.0))
        elif was_away and not away:
            events.append(LinkThere(*about))
        if strange and not before[3]:
            events.append(StrangersIgnored(*about, self.link.stranger))
        return events
