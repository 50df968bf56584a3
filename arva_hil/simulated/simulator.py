"""Built-in vehicles on links: the far end for demonstrations and loopback tests."""

from __future__ import annotations

from collections.abc import Sequence

from arva_hil.clock import Clock
from arva_hil.links import Link
from arva_hil.mavlink.codec import Parser, dialect
from arva_hil.simulated.vehicle import SimulatedVehicle


class Simulator:
    """Simulated vehicles that all use all `links`. A task of the loop.

    `relays`: TUNNEL messages are forwarded to all other links, as by autopilots that are in contact.
    """

    def __init__(self, vehicles: Sequence[SimulatedVehicle], links: Sequence[Link], *, relays: bool = False) -> None:
        self.vehicles = vehicles
        self.links = links
        self._parsers = [Parser() for _ in links] if relays else []

    def service(self, clock: Clock) -> float:
        now = clock.now()
        for number, link in enumerate(self.links):
            if chunk := link.read():
                for vehicle in self.vehicles:
                    vehicle.feed(chunk, now, number)
                if self._parsers:
                    self._relay(number, chunk)
        for vehicle in self.vehicles:
            if said := vehicle.poll(now):
                for link in self.links:
                    link.write(said)
        return min([vehicle.next_due for vehicle in self.vehicles])

    def _relay(self, number: int, chunk: bytes) -> None:
        for packet in self._parsers[number].feed(chunk):
            if packet.msgid == dialect.MAVLINK_MSG_ID_TUNNEL:
                for other, link in enumerate(self.links):
                    if other != number:
                        link.write(packet.raw)
