"""Splits the bytes of one link into packets and checks them once, for all sessions on that link."""

from __future__ import annotations

from collections.abc import Container, Hashable, Sequence
from typing import NamedTuple

from arva_hil.mavlink.codec import Packet, Parser
from arva_hil.mavlink.signing import Signing, Verdict


class Packets(NamedTuple):
    """The packets of one chunk."""

    every: Sequence[Packet]
    """All packets, in their order."""
    accepted: Sequence[Packet]
    """The packets with a valid signature; without a key, all of them."""
    refused: Sequence[tuple[Packet, Verdict]] = ()
    """The packets without a valid signature, each with the reason."""

    def without(self, systems: Container[int | None]) -> Packets:
        """Return the packets of all other systems."""
        return Packets(
            [packet for packet in self.every if packet.system not in systems],
            [packet for packet in self.accepted if packet.system not in systems],
            [(packet, why) for packet, why in self.refused if packet.system not in systems],
        )


class PacketReader:
    """Remembers the parsers of one link and the number of bytes. `signing`: packets are checked with it."""

    def __init__(self, signing: Signing | None = None) -> None:
        self.parser = Parser()
        self.signing = signing
        self.bytes = 0
        self._strangers = Parser()

    def feed(
        self, chunk: bytes, now: float, sender: Hashable = None, *, stranger: bool = False, whole: bool = False
    ) -> Packets:
        """Return the packets completed by a chunk: see `Parser.feed`.

        `stranger`: the sender is none of those accepted. Its bytes are not counted and its signatures not checked.
        """
        if stranger:
            return Packets(self._strangers.feed(chunk, sender), ())
        self.bytes += len(chunk)
        packets = self.parser.feed(chunk, sender, whole=whole)
        if self.signing is None:
            return Packets(packets, packets)
        self.signing.advance(now)
        verdicts = [(packet, self.signing.judge(packet)) for packet in packets]
        accepted = [packet for packet, why in verdicts if not why]
        return Packets(packets, accepted, [(packet, why) for packet, why in verdicts if why])
