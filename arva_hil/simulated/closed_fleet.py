"""Several built-in vehicles among the same transmitters, with one emulator for all and a search for each."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from arva_hil.autopilot.following.session import Session
from arva_hil.config import Lla, ReceiverConfig, Scenario, VehicleConfig
from arva_hil.emulator.build import moving_transmitters
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import sink_name, vehicle_setups
from arva_hil.events import Event
from arva_hil.links import Link, memory
from arva_hil.model.field import LocalFrame
from arva_hil.registry import FORMATS
from arva_hil.runtime.audience import Audience, Observer
from arva_hil.runtime.drivers import Live
from arva_hil.search.flight.client import COMPONENT, SearchClient
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.team.team import Bus
from arva_hil.search.team.team_field import TeamField
from arva_hil.simulated.closed_loop import HOME
from arva_hil.simulated.simulator import Simulator
from arva_hil.simulated.vehicle import SimulatedVehicle

APART_M = 5.0  # between the vehicles at the start, from west to east


def several(scenario: Scenario, count: int) -> Scenario:
    """The scenario with one datum for all and with `count` vehicles, each with its receiver, unless it has vehicles."""
    scenario = replace(scenario, datum=_datum(scenario))
    if scenario.vehicles:
        return scenario
    vehicles = []
    for n in range(count):
        receiver = ReceiverConfig("receiver", "pty", scenario.receiver, scenario.output_format, scenario.seed + n)
        vehicles.append(VehicleConfig(f"drone-{n + 1}", system=n + 1, receivers=(receiver,)))
    return replace(scenario, vehicles=tuple(vehicles))


def _datum(scenario: Scenario) -> Lla:
    """Its own, or the place where the vehicles stand: all of them have the same, though each has its own home."""
    return Lla(*HOME) if scenario.datum == "home" else scenario.datum


class Drone(NamedTuple):
    """One vehicle with its search. `commands`: the vehicle's end of the link on which the search sends commands."""

    name: str
    vehicle: SimulatedVehicle
    search: SearchClient
    commands: Link


class ClosedFleet:
    """Remembers the drones of one field; `tasks` are for the loop.

    Every vehicle of the scenario has one receiver. They stand in a row from west to east, 5 m apart, and divide the
    plan's area, which is around the middle of the row, in that order. Neighbours fly at different heights.
    `emit` gets the events of each search, with its vehicle's name. `start`: s. `wind`: NED, m/s.
    """

    def __init__(
        self,
        scenario: Scenario,
        plan: SearchPlan,
        *,
        start: float,
        stream_hz: float = 50.0,
        gps_noise_m: float = 0.0,
        wind: tuple[float, float, float] = (0.0, 0.0, 0.0),
        observers: Sequence[Observer] = (),
        tell_packets: bool = False,
        emit: Callable[[str, Event], None] = lambda name, event: None,
    ) -> None:
        datum = _datum(scenario)
        scenario = replace(scenario, datum=datum)
        if gps_noise_m:  # otherwise the report is the truth
            scenario = replace(scenario, pose="truth", navigation_error=None)
        self.frame = LocalFrame(datum.lat, datum.lon, datum.alt)
        self._scenario = scenario
        count = len(scenario.vehicles)
        bus = Bus(TeamField(plan.area, self.frame, count))
        autopilots, ports, simulators = dict[str, Link](), dict[str, Link](), list[Simulator]()
        self.drones: list[Drone] = []
        for n, config in enumerate(scenario.vehicles):
            east = (n - (count - 1) / 2) * APART_M
            lat, lon, alt = (float(value) for value in self.frame.lla([0.0, east, 0.0]))
            system = config.system or n + 1
            vehicle = SimulatedVehicle(
                (lat, lon, alt), system, boot_time=start, gps_noise_m=gps_noise_m, wind=wind, seed=scenario.seed + n
            )
            (near, far), (search_end, vehicle_end), (taken, given) = (memory.pair() for _ in range(3))
            (receiver,) = config.receivers
            autopilots[config.name], ports[sink_name(config, receiver)] = near, given
            simulators.append(Simulator([vehicle], [far, vehicle_end]))
            mate = bus.join()
            search = SearchClient(
                mate.layered(plan),
                Session(target_system=system, rate_hz=stream_hz, component=COMPONENT),
                search_end,
                taken,
                FORMATS[receiver.output_format].decoder(),
                start=start,
                emit=lambda event, name=config.name: emit(name, event),  # type: ignore[misc]
                team=mate,
            )
            self.drones.append(Drone(config.name, vehicle, search, vehicle_end))
        setups = vehicle_setups(
            scenario,
            lambda v: v.name,
            lambda v: Session(target_system=v.system, rate_hz=stream_hz, name=v.name),
        )
        told = {"tell_packets": tell_packets, "tell_status": bool(observers)}
        self.emulator = Emulator(setups, start=start, timeout_s=10.0, **told)
        self.live = Live(self.emulator, autopilots, ports, Audience(observers))
        self.tasks: list[Simulator | Live | SearchClient] = [
            *simulators,
            self.live,
            *(drone.search for drone in self.drones),
        ]

    @property
    def over(self) -> bool:
        """True if every search has ended, with its vehicle landed or hovering."""
        return all(drone.search.outcome is not None for drone in self.drones)

    @property
    def found(self) -> set[int]:
        """The ids of the transmitters found surely."""
        missions = [drone.search.mission for drone in self.drones]
        return {m.target for m in missions if m and m.found is not None and m.sure and m.target is not None}

    def error(self, drone: Drone) -> float | None:
        """Horizontal distance [m] from the place reported by a search to its transmitter; None: no place yet."""
        mission, origin = drone.search.mission, drone.search.origin
        if mission is None or mission.found is None or origin is None:
            return None
        there = moving_transmitters(self._scenario, self.frame).at(0.0)
        places = dict(zip(there.ids, there.positions, strict=True))
        if mission.target not in places:
            return None
        place = self.frame.ned(*origin.lla([mission.found.north, mission.found.east, 0.0]))
        return math.dist(place[:2], places[mission.target][:2])
