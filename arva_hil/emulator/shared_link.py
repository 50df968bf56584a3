"""Several vehicles that are heard on one link: whose each packet is, and whom to answer there."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

from arva_hil.emulator.emulated_vehicle import EmulatedVehicle
from arva_hil.mavlink.codec import Packet
from arva_hil.mavlink.packet_reader import Packets


class SharedLink:
    """Remembers its vehicles, and to whom what is said to them goes. `senders`: all of theirs."""

    def __init__(self, vehicles: Sequence[EmulatedVehicle]) -> None:
        self.senders: Sequence[Hashable] = ()
        self._vehicles = vehicles
        self._numbers = {vehicle.session.target_system: number for number, vehicle in enumerate(vehicles)}
        self._of_each: list[tuple[Hashable, ...]] = [()] * len(vehicles)

    def hear(
        self, packets: Packets, now: float, sender: Hashable
    ) -> tuple[Sequence[EmulatedVehicle], Sequence[Packet]]:
        """Give each vehicle its packets, and all vehicles those of other systems.

        Returns the vehicles that were given some; and all packets, if they may be of one of these vehicles.
        """
        systems = {packet.system for packet in packets.every}
        numbers: Sequence[int] = range(len(self._vehicles))
        if systems <= self._numbers.keys():
            numbers = sorted(self._numbers[system] for system in systems)
        vehicles = [self._vehicles[number] for number in numbers]
        heard = False
        shares = packets.shares([vehicle.session.target_system for vehicle in vehicles])
        for number, vehicle, share in zip(numbers, vehicles, shares, strict=True):
            heard |= vehicle.session.hear(share, now, sender) and bool(share.every)
            self._note_senders(number, vehicle)
        return vehicles, packets.every if heard else []

    def _note_senders(self, number: int, vehicle: EmulatedVehicle) -> None:
        senders = vehicle.session.senders
        known = (senders.vehicle, *senders.candidates)
        if known != self._of_each[number]:
            self._of_each[number] = known
            self.senders = [one for one in dict.fromkeys(one for of in self._of_each for one in of) if one is not None]
