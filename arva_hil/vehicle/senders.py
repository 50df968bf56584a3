"""Of several senders on one link, which one is the vehicle; and whom to answer until that is known."""

from __future__ import annotations

import math
from collections.abc import Hashable
from typing import Final

_SILENT_S: Final = 3.0  # of the vehicle's sender, before another may take its place: three heartbeats
_ASLEEP_S: Final = 1.0  # who did not look for this long cannot tell silence from not having looked
_MOST: Final = 8  # answered while none is the vehicle


class Senders:
    """Remembers whose packets were the vehicle's, and when it last sent one. Times are host seconds.

    A link with one sender only calls it None, and that one is always the vehicle's.
    """

    def __init__(self) -> None:
        self.vehicle: Hashable = None
        self._met: dict[Hashable, bool] = {}  # sender → it may be the vehicle
        self._heard_at = -math.inf
        self._looked_at = -math.inf
        self._pinned = False

    @property
    def candidates(self) -> list[Hashable]:
        """Whom to answer while no vehicle is known: who sent MAVLink, and nothing that shows it to be somebody else."""
        return [sender for sender, candidate in self._met.items() if candidate]

    def look(self, now: float) -> None:
        """Somebody listens, at `now`. After a pause in that, the vehicle has its whole time to be heard again."""
        if now - self._looked_at > _ASLEEP_S:
            self._heard_at = max(self._heard_at, now)
        self._looked_at = now

    def meet(self, sender: Hashable, *, candidate: bool) -> None:
        """It sent a packet; is it one that the vehicle could have sent?"""
        if sender in self._met or len(self._met) < _MOST:
            self._met[sender] = candidate and self._met.get(sender, True)

    def hear(self, sender: Hashable, now: float) -> None:
        """It sent a packet of the vehicle's own."""
        self.vehicle, self._heard_at = sender, now
        if self._met:
            self._met.clear()

    def believes(self, sender: Hashable, now: float) -> bool:
        """Whether a vehicle's packet may be believed from this sender: only from the one, until it falls silent."""
        return sender == self.vehicle or (now - self._heard_at > _SILENT_S and not self._pinned)

    def pin(self) -> None:
        """From now on the vehicle's never changes."""
        self._pinned = True

    def release(self) -> None:
        """The link to the vehicle is lost: it may come back from anywhere, at once."""
        self._heard_at = -math.inf

    def resume(self, now: float) -> None:
        """The link is back: whoever was heard last has its whole time again."""
        self._heard_at = now
