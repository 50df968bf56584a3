"""The vehicles on one link: their bytes are split once, and each vehicle's session gets its packets."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from operator import attrgetter
from typing import Final, NamedTuple

from arva_hil.autopilot.following.received import Received
from arva_hil.autopilot.following.session import Session
from arva_hil.mavlink.codec import Packet
from arva_hil.mavlink.packet_reader import Packets

_SYSTEM: Final = attrgetter("system")


class Addressees(NamedTuple):
    """The senders to which a link writes."""

    peer: Hashable
    """The sender of the link's only vehicle; None if it is not known, or if there are several vehicles."""
    others: Sequence[Hashable]
    """The senders to which the link writes without a peer: all that may be one of the vehicles."""


class VehicleLink:
    """Remembers the sessions on one link. Raises ValueError if their readers differ."""

    def __init__(self, sessions: Sequence[Session]) -> None:
        if len({id(session.reader) for session in sessions}) > 1:
            raise ValueError("the sessions of vehicles on one link need the same reader")
        self._sessions = sessions
        self._reader = sessions[0].reader
        self._targets = {session.target_system for session in sessions}
        self._siblings = [self._targets - {session.target_system} for session in sessions]

    def receive(
        self, data: bytes, now: float, sender: Hashable, *, whole: bool, open_to_all: bool
    ) -> tuple[Packets, list[tuple[int, Received]]]:
        """Give each vehicle its own packets, and all vehicles the packets of other systems.

        `open_to_all`: packets count also if their sender cannot be one of the vehicles. Returns the packets in the
        bytes; and the number of each vehicle that got some of them, with what its session received.
        """
        for session in self._sessions:
            open_to_all = session.accepts(sender, now) or open_to_all
        packets = self._reader.feed(data, now, sender, stranger=not open_to_all, whole=whole)
        systems = set(map(_SYSTEM, packets.every))
        alone = systems <= self._targets
        results = []
        for number, session in enumerate(self._sessions):
            if not alone or session.target_system in systems:
                siblings = self._siblings[number]
                share = packets if siblings.isdisjoint(systems) else packets.without(siblings)
                results.append((number, session.receive(share, now, sender)))
        return packets, results

    def recorded(self, packets: Packets, sender: Hashable) -> Sequence[Packet]:
        """Return all packets of a chunk if its sender may be one of the vehicles, otherwise none."""
        return packets.every if any(session.follows(sender) for session in self._sessions) else ()

    @property
    def addressees(self) -> Addressees:
        """The senders to which outputs go."""
        first, *others = self._sessions
        if not others:
            return Addressees(first.senders.vehicle, first.senders.candidates)
        every = (sender for one in self._sessions for sender in (one.senders.vehicle, *one.senders.candidates))
        return Addressees(None, [sender for sender in dict.fromkeys(every) if sender is not None])
