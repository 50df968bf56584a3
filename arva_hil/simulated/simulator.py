"""Built-in vehicles on links: the far end for demonstrations and loopback tests."""

from __future__ import annotations

from collections.abc import Sequence

from arva_hil.links import Link
from arva_hil.runtime.clock import Clock
from arva_hil.simulated.vehicle import SimulatedVehicle


class Simulator:
    """Simulated vehicles that all use all `links`. A task of the loop."""

    def __init__(self, vehicles: Sequence[SimulatedVehicle], links: Sequence[Link]) -> None:
        self.vehicles = vehicles
        self.links = links

    def service(self, clock: Clock) -> float:
        now = clock.now()
        for number, link in enumerate(self.links):
            if chunk := link.read():
                for vehicle in self.vehicles:
                    vehicle.feed(chunk, now, number)
        for vehicle in self.vehicles:
            if said := vehicle.poll(now):
                for link in self.links:
                    link.write(said)
        return min([vehicle.next_due for vehicle in self.vehicles])
