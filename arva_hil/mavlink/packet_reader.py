"""Splits the bytes of one link into packets and checks them once, for all sessions on that link."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from functools import partial
from typing import Final, NamedTuple

from arva_hil.mavlink.codec import Packet, Parser, usual_record
from arva_hil.mavlink.signing import Signing, Verdict


class Packets(NamedTuple):
    """The packets of one chunk: `every` one; those that are `believed`; those that are not, each with the reason."""

    every: Sequence[Packet]
    believed: Sequence[Packet]
    doubted: Sequence[tuple[Packet, Verdict]] = ()

    def shares(self, systems: Sequence[int | None]) -> list[Packets]:
        """For each of these systems: its own packets and those of all other systems. None has no packets of its own."""
        every, believed = _by_system(self.every, systems), _by_system(self.believed, systems)
        doubted = [
            [(packet, why) for packet, why in self.doubted if packet.system == system or packet.system not in systems]
            for system in systems
        ]
        return [Packets(*parts) for parts in zip(every, believed, doubted, strict=True)]


def _by_system(packets: Sequence[Packet], systems: Sequence[int | None]) -> list[list[Packet]]:
    parts: dict[int | None, list[Packet]] = {system: [] for system in systems}
    for packet in packets:
        if packet.system in parts:
            parts[packet.system].append(packet)
        else:
            for part in parts.values():
                part.append(packet)
    return [parts[system] for system in systems]


_packets: Final = partial(tuple.__new__, Packets)  # from the tuple of its fields, in a third of the time


def unsigned(packets: Sequence[Packet]) -> Packets:
    """The packets of one chunk of a link without signing: all are believed."""
    return _packets((packets, packets, ()))


class PacketReader:
    """Remembers the parser of one link and the number of bytes. `signing`: packets are checked with it."""

    def __init__(self, signing: Signing | None = None) -> None:
        self.parser = Parser()
        self.signing = signing
        self.bytes = 0

    def read(self, chunk: bytes, now: float, sender: Hashable = None, *, whole: bool = False) -> Packets:
        """The packets completed by a chunk: see `Parser.feed`."""
        self.bytes += len(chunk)
        packets = self.parser.feed(chunk, sender, whole=whole)
        if self.signing is None:
            return unsigned(packets)
        self.signing.advance(now)
        verdicts = [(packet, self.signing.judge(packet)) for packet in packets]
        believed = [packet for packet, why in verdicts if not why]
        return Packets(packets, believed, [(packet, why) for packet, why in verdicts if why])

    def read_records(self, records: Sequence[bytes]) -> list[list[Packet]]:
        """The packets of each record of a log, none of which continues in the next one. Only without signing."""
        self.bytes += sum(map(len, records))
        parser, before = self.parser, self.parser.packets
        every = [
            [packet] if (packet := usual_record(raw)) is not None else parser.feed(raw, whole=True) for raw in records
        ]
        parser.packets = before + sum(map(len, every))
        return every
