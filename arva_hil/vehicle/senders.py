"""Finds the vehicle among several senders on one link, and the senders to answer until it is known."""

from __future__ import annotations

import math
from collections.abc import Hashable
from typing import Final

_SILENT_S: Final = 3.0  # of the vehicle's sender, until another may take its place: three heartbeats
_ASLEEP_S: Final = 1.0  # after a pause in reading of this length, silence means nothing
_MOST: Final = 8  # senders that are answered while the vehicle is unknown


class Senders:
    """Remembers the sender of the vehicle's packets, and when it last sent one. Times are host seconds.

    The sender of a link with only one is None, and is always the vehicle.
    """

    def __init__(self) -> None:
        self.vehicle: Hashable = None
        self._met: dict[Hashable, bool] = {}  # sender → whether it may be the vehicle
        self._heard_at = -math.inf
        self._looked_at = -math.inf
        self._pinned = False

    @property
    def candidates(self) -> list[Hashable]:
        """The senders to answer while no vehicle is known: those that sent MAVLink and may be the vehicle."""
        return [sender for sender, candidate in self._met.items() if candidate]

    def look(self, now: float) -> None:
        """The link is read at `now`. After a pause in reading, the vehicle has its whole time to be heard again."""
        if now - self._looked_at > _ASLEEP_S:
            self._heard_at = max(self._heard_at, now)
        self._looked_at = now

    def meet(self, sender: Hashable, *, candidate: bool) -> None:
        """A sender sent a packet. `candidate`: the vehicle could have sent it."""
        if sender in self._met or len(self._met) < _MOST:
            self._met[sender] = candidate and self._met.get(sender, True)

    def hear(self, sender: Hashable, now: float) -> None:
        """A sender sent a packet of the vehicle."""
        self.vehicle, self._heard_at = sender, now
        if self._met:
            self._met.clear()

    def believes(self, sender: Hashable, now: float) -> bool:
        """Whether to accept a packet of the vehicle from this sender: only from one sender, until it is silent."""
        return sender == self.vehicle or (now - self._heard_at > _SILENT_S and not self._pinned)

    def pin(self) -> None:
        """From now on the vehicle's sender never changes."""
        self._pinned = True

    def release(self) -> None:
        """The link to the vehicle is lost: it may come back from any sender, at once."""
        self._heard_at = -math.inf

    def resume(self, now: float) -> None:
        """The link is back: the last sender has its whole time again."""
        self._heard_at = now
