"""The whole loop on one machine: built-in vehicle, emulator and search, each on its own end of a link."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from arva_hil.autopilot.multirotor import Vector
from arva_hil.autopilot.session import Session
from arva_hil.autopilot.vehicle import SimulatedVehicle
from arva_hil.config import Scenario
from arva_hil.drivers import Live
from arva_hil.engine import Emulator, one_vehicle
from arva_hil.events.searches import FromSearch
from arva_hil.links import Link
from arva_hil.observer import Audience, Observer
from arva_hil.scene import transmitters
from arva_hil.search.client import COMPONENT, SearchClient
from arva_hil.search.mission import Plan
from arva_hil.search.outcome import Row
from arva_hil.simulator import Simulator
from firmware_proto import DECODERS

HOME = (46.0123, 7.7456, 1650.0)  # degrees, degrees, metres AMSL

Ends = tuple[Link, Link]  # of one link: the program's, and the far one


class ClosedLoop:
    """Remembers vehicle, emulator and search of one flight; `tasks` are for the loop.

    `autopilot`, `commands`, `port`: the emulator's link to the vehicle, the search's link to it, and the receiver's
    port (the search's end, the emulator's end). `stream_hz`: of the pose, on both links. `start`: s.
    """

    def __init__(
        self,
        scenario: Scenario,
        plan: Plan,
        *,
        autopilot: Ends,
        commands: Ends,
        port: Ends,
        start: float,
        wind: Vector = (0.0, 0.0, 0.0),
        gps_noise_m: float = 0.0,
        stream_hz: float = 50.0,
        observers: Sequence[Observer] = (),
        log: Callable[[Row], None] = lambda _: None,
    ) -> None:
        format = scenario.output_format
        self._scenario = scenario
        self.vehicle = SimulatedVehicle(HOME, wind=wind, gps_noise_m=gps_noise_m, seed=scenario.seed, boot_time=start)
        audience = Audience(observers)
        self.emulator = Emulator([one_vehicle(scenario, Session(rate_hz=stream_hz))], start=start, timeout_s=10.0)
        live = Live(self.emulator, {"autopilot": autopilot[0]}, {"port": port[1]}, audience)
        self.search = SearchClient(
            plan,
            Session(rate_hz=stream_hz, component=COMPONENT),
            commands[0],
            port[0],
            DECODERS[format](),
            start=start,
            emit=lambda event: audience.tell([FromSearch(event.time_s, event)]),
            log=log,
        )
        self.tasks: list[Simulator | Live | SearchClient] = [
            Simulator(self.vehicle, [autopilot[1], commands[1]]),
            live,
            self.search,
        ]

    @property
    def over(self) -> bool:
        """The search has ended, though the vehicle may still be in the air."""
        mission = self.search.mission
        return self.search.outcome is not None or (mission is not None and bool(mission.ended))

    def truth(self) -> dict[int, tuple[float, float]]:
        """Where the transmitters are: north and east of the take-off point, by id. Needs a search in the air."""
        origin, datum = self.search.origin, self.emulator.vehicles[0].datum.frame
        assert origin is not None
        assert datum is not None
        places = transmitters(self._scenario, datum)
        ned = [origin.ned(*datum.lla(position)) for position in places.positions]
        return {id_: (float(n), float(e)) for id_, (n, e, _) in zip(places.ids, ned, strict=True)}

    def error(self) -> float | None:
        """Horizontal distance [m] from the place reported to the transmitter searched for; None: none is reported."""
        found = self.search.mission.found if self.search.mission else None
        return None if found is None else self.distance((found.north, found.east))

    def distance(self, place: tuple[float, float]) -> float | None:
        """From a place to the transmitter searched for, m, horizontally; the nearest one when frames carry no ids."""
        mission = self.search.mission
        if mission is None or mission.target is None:
            return None
        places = self.truth()
        of = [places[mission.target]] if mission.target in places else places.values()
        return min(math.dist(place, true) for true in of)
