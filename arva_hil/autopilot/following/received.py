"""The result of one chunk of bytes for the session with a vehicle."""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from typing import Any, NamedTuple

from arva_hil.events import Event
from arva_hil.mavlink.codec import Packet, decode


class Received(NamedTuple):
    """The packets of one chunk, and their events.

    Each packet is in one of the first three lists. These are empty if the sender is not accepted.
    """

    own: Sequence[Packet] = ()
    """The vehicle's packets."""
    others: Sequence[Packet] = ()
    """Packets of other systems and components, and packets that only claim to be the vehicle's."""
    refused: Sequence[Packet] = ()
    """Packets without a valid signature, if the link has a key."""
    events: Sequence[Event] = ()
    """Events of the vehicle."""

    @property
    def accepted(self) -> Sequence[Packet]:
        """Packets of all systems, without the refused ones."""
        return [*self.own, *self.others]

    def messages(self, wanted: Container[int]) -> Iterator[tuple[int, Any]]:
        """Decode the vehicle's messages of these kinds: message id and message."""
        for packet in self.own:
            if packet.msgid in wanted and (message := decode(packet)) is not None:
                yield packet.msgid, message
