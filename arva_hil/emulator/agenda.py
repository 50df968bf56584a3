"""The vehicles that are due. The cost does not depend on the number of those that are not."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence

from arva_hil.emulator.emulated_vehicle import EmulatedVehicle


class Agenda:
    """Remembers when each vehicle is due, and in `called` those for which something arrived: they are served next time.

    A single vehicle is always served. Times are seconds on the driver's clock.
    """

    def __init__(self, vehicles: Sequence[EmulatedVehicle]) -> None:
        self._vehicles = vehicles
        self._number = {vehicle: number for number, vehicle in enumerate(vehicles)}
        self._dues = [math.inf] * len(vehicles)
        self._heap: list[tuple[float, int]] = []  # entries that differ from `_dues` are out of date
        self.called = set(vehicles)

    def due(self, now: float) -> Sequence[EmulatedVehicle]:
        """The vehicles to serve at `now`, in their order. Call `served` for each of them."""
        if len(self._vehicles) == 1:
            return self._vehicles
        heap, called = self._heap, self.called
        while heap and heap[0][0] <= now:
            due, number = heapq.heappop(heap)
            if due == self._dues[number]:
                self._dues[number] = math.inf
                called.add(self._vehicles[number])
        self.called = set()
        return sorted(called, key=self._number.__getitem__)

    def served(self, vehicle: EmulatedVehicle) -> None:
        """A vehicle has been served."""
        if len(self._vehicles) > 1:
            self._note(self._number[vehicle])

    def first(self) -> float:
        """The time at which the first vehicle is due."""
        if len(self._vehicles) == 1:
            return self._vehicles[0].next_due
        for vehicle in self.called:
            self._note(self._number[vehicle])
        heap = self._heap
        while heap and heap[0][0] != self._dues[heap[0][1]]:
            heapq.heappop(heap)
        return heap[0][0] if heap else math.inf

    def _note(self, number: int) -> None:
        due = self._vehicles[number].next_due
        if due != self._dues[number]:
            self._dues[number] = due
            heapq.heappush(self._heap, (due, number))
