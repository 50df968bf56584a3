"""The built-in vehicle on links: the far end of the demonstration and of loopback tests."""

from __future__ import annotations

from collections.abc import Sequence

from arva_hil.links import Link
from arva_hil.runtime.clock import Clock
from arva_hil.simulated.vehicle import SimulatedVehicle


class Simulator:
    """A simulated vehicle that hears and speaks on every one of `links`; served by the loop as an emulator is."""

    def __init__(self, vehicle: SimulatedVehicle, links: Sequence[Link]) -> None:
        self.vehicle = vehicle
        self.links = links

    def service(self, clock: Clock) -> float:
        now = clock.now()
        for link in self.links:
            if chunk := link.read():
                self.vehicle.feed(chunk, now)
        if said := self.vehicle.poll(now):
            for link in self.links:
                link.write(said)
        return self.vehicle.next_due
