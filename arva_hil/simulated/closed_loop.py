"""The closed loop on one machine: built-in vehicle, emulator and search, connected by links."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from arva_hil.autopilot.following.session import Session
from arva_hil.config import Scenario
from arva_hil.emulator.build import moving_transmitters
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import one_vehicle
from arva_hil.events import Event
from arva_hil.events.searches import FromSearch
from arva_hil.links import Link
from arva_hil.registry import FORMATS
from arva_hil.runtime.audience import Audience, Observer
from arva_hil.runtime.drivers import Live
from arva_hil.search.flight.client import COMPONENT, SearchClient
from arva_hil.search.mission.outcome import SearchStep
from arva_hil.search.mission.victims import Victim
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.simulated.messages import SENSORS
from arva_hil.simulated.multirotor import Vector
from arva_hil.simulated.simulator import Simulator
from arva_hil.simulated.vehicle import SimulatedVehicle

HOME = (46.0123, 7.7456, 1650.0)  # degrees, degrees, metres AMSL

Ends = tuple[Link, Link]  # of one link: the program's, and the far one


class ClosedLoop:
    """Remembers vehicle, emulator and search of one flight; `tasks` are for the loop.

    The receiver is at the true pose of the vehicle; the search uses the reported pose.

    `autopilot`, `commands`, `port`: the emulator's link to the vehicle, the search's link to it, and the receiver's
    port (the search's end, the emulator's end). `stream_hz`: of the pose, on both links. `start`: s. `sensors`: of the
    vehicle, besides its GPS. `tell_packets`: whether the observers get all packets, for a record.
    """

    def __init__(
        self,
        scenario: Scenario,
        plan: SearchPlan,
        *,
        autopilot: Ends,
        commands: Ends,
        port: Ends,
        start: float,
        wind: Vector = (0.0, 0.0, 0.0),
        gps_noise_m: float = 0.0,
        sensors: int = SENSORS,
        stream_hz: float = 50.0,
        observers: Sequence[Observer] = (),
        tell_packets: bool = False,
        log: Callable[[SearchStep], None] | None = None,
    ) -> None:
        format = scenario.output_format
        self._scenario = scenario
        self.vehicle = SimulatedVehicle(
            HOME, wind=wind, gps_noise_m=gps_noise_m, seed=scenario.seed, boot_time=start, sensors=sensors
        )
        audience = Audience(observers)
        if gps_noise_m:  # otherwise the report is the truth, and needs less time
            scenario = replace(scenario, pose="truth", navigation_error=None)
        self.emulator = Emulator(
            [one_vehicle(scenario, Session(rate_hz=stream_hz))],
            start=start,
            timeout_s=10.0,
            tell_packets=tell_packets,
            tell_status=bool(observers),
        )

        def emit(event: Event) -> None:
            audience.tell([FromSearch(event.time_s, event)])

        live = Live(self.emulator, {"autopilot": autopilot[0]}, {"port": port[1]}, audience)
        self.search = SearchClient(
            plan,
            Session(rate_hz=stream_hz, component=COMPONENT),
            commands[0],
            port[0],
            FORMATS[format].decoder(),
            start=start,
            emit=emit if observers else lambda _: None,
            log=log,
            host=getattr(FORMATS[format], "host", None),
        )
        simulator = Simulator([self.vehicle], [autopilot[1], commands[1]])
        self.tasks: list[Simulator | Live | SearchClient] = [simulator, live, self.search]

    @property
    def over(self) -> bool:
        """True if the search has ended. The vehicle may still be in the air."""
        mission = self.search.mission
        return self.search.outcome is not None or (mission is not None and bool(mission.ended))

    @property
    def several(self) -> bool:
        """True if more than one transmitter is searched for."""
        return self.search.mission is not None and self.search.mission.victims.several

    def truth(self) -> dict[int, tuple[float, float]]:
        """The true places of the transmitters at the newest frame, by id: north and east [m] of the take-off point of
        the search, which must have one.
        """
        (vehicle,) = self.emulator.vehicles
        origin, datum, last = self.search.origin, vehicle.world.datum.frame, vehicle.units[0].port.last
        assert origin is not None
        assert datum is not None
        there = moving_transmitters(self._scenario, datum).at(last.instant_s if last else 0.0)
        ned = [origin.ned(*datum.lla(position)) for position in there.positions]
        return {id_: (float(n), float(e)) for id_, (n, e, _) in zip(there.ids, ned, strict=True)}

    def off(self, now: float) -> float | None:
        """Horizontal distance [m] from the true place of the vehicle to the transmitter searched for."""
        if self.search.origin is None:
            return None
        north, east, _ = self.search.origin.ned(*self.vehicle.truth(now).lla).tolist()
        return self.distance((north, east))

    def error(self) -> float | None:
        """Horizontal distance [m] from the reported place to the transmitter searched for; None: no place yet.

        If several are searched for: the largest distance.
        """
        if self.several:
            return max(self.errors().values(), default=None)
        found = self.search.mission.found if self.search.mission else None
        return None if found is None else self.distance((found.north, found.east))

    def errors(self) -> dict[Victim, float]:
        """`error` for each place that a search for several reports. No transmitter is counted twice."""
        left, found = self.truth() if self.search.origin else {}, dict[Victim, float]()
        for victim in self.search.mission.victims.places if self.search.mission else ():
            place = victim.found[:2]
            id_ = (
                victim.id if victim.id in left else min(left, key=lambda id_: math.dist(place, left[id_]), default=None)
            )
            found[victim] = math.inf if id_ is None else math.dist(place, left.pop(id_))
        return found

    def distance(self, place: tuple[float, float]) -> float | None:
        """Horizontal distance [m] from a place to the transmitter searched for; to the nearest without ids."""
        mission = self.search.mission
        if mission is None or mission.target is None:
            return None
        places = self.truth()
        of = [places[mission.target]] if mission.target in places else places.values()
        return min(math.dist(place, true) for true in of)
