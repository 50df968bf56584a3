"""Which of many vehicles have something to do now. The cost does not grow with the number of those that have not."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence

from arva_hil.emulator.emulated_vehicle import EmulatedVehicle


class Agenda:
    """Remembers when each vehicle wants to be served, and which ones must be served whatever the time is.

    A vehicle that is alone is always served. Times are seconds on the driver's clock.
    """

    def __init__(self, vehicles: Sequence[EmulatedVehicle]) -> None:
        self._vehicles = vehicles
        self._number = {vehicle: number for number, vehicle in enumerate(vehicles)}
        self._dues = [math.inf] * len(vehicles)
        self._heap: list[tuple[float, int]] = []  # some of these are out of date: they differ from `_dues`
        self._called = set(range(len(vehicles)))

    def call(self, vehicle: EmulatedVehicle) -> None:
        """Something has come for a vehicle: it is served the next time."""
        self._called.add(self._number[vehicle])

    def due(self, now: float) -> Sequence[EmulatedVehicle]:
        """The vehicles to serve at `now`, in their order. Hand each back to `served`."""
        if len(self._vehicles) == 1:
            return self._vehicles
        heap, called = self._heap, self._called
        while heap and heap[0][0] <= now:
            due, number = heapq.heappop(heap)
            if due == self._dues[number]:
                self._dues[number] = math.inf
                called.add(number)
        self._called = set()
        return [self._vehicles[number] for number in sorted(called)]

    def served(self, vehicle: EmulatedVehicle) -> None:
        """A vehicle has been served until now."""
        self._note(self._number[vehicle])

    def first(self) -> float:
        """When the first of them wants to be served."""
        if len(self._vehicles) == 1:
            return self._vehicles[0].next_due
        for number in self._called:
            self._note(number)
        heap = self._heap
        while heap and heap[0][0] != self._dues[heap[0][1]]:
            heapq.heappop(heap)
        return heap[0][0] if heap else math.inf

    def _note(self, number: int) -> None:
        due = self._vehicles[number].next_due
        if due != self._dues[number]:
            self._dues[number] = due
            heapq.heappush(self._heap, (due, number))
