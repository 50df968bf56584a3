"""The closed loop on one machine: built-in vehicles, one emulator for all, and a search for each."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from functools import partial
from typing import NamedTuple

from arva_hil.autopilot.following.session import Session
from arva_hil.config import Lla, ReceiverConfig, Scenario, VehicleConfig
from arva_hil.emulator.build import mount, moving_transmitters
from arva_hil.emulator.engine import EmulatedVehicle, Emulator
from arva_hil.emulator.setup import VehicleSetup, one_vehicle, vehicle_setups
from arva_hil.events import Event
from arva_hil.events.searches import FromSearch
from arva_hil.links import Link, memory
from arva_hil.model.field import LocalFrame
from arva_hil.registry import FORMATS
from arva_hil.runtime.audience import Audience, Observer
from arva_hil.runtime.drivers import Live
from arva_hil.search.flight.client import COMPONENT, SearchClient
from arva_hil.search.mission.mission import Mission
from arva_hil.search.mission.outcome import SearchStep
from arva_hil.search.mission.victims import Victim
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.team.team import Bus, TeamField, Teammate
from arva_hil.simulated import HOME
from arva_hil.simulated.messages import SENSORS
from arva_hil.simulated.multirotor import Vector
from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator

APART_M = 5.0  # between the vehicles of a team at the start, from west to east

Ends = tuple[Link, Link]  # of one link


class Wires(NamedTuple):
    """The three links of one drone, both ends of each."""

    autopilot: Ends
    """The emulator's end, the vehicle's end."""
    commands: Ends
    """The search's end, the vehicle's end."""
    port: Ends
    """The search's end, the emulator's end."""


def in_memory() -> Wires:
    """Return wires in the memory of this program."""
    return Wires(memory.pair(), memory.pair(), memory.pair())


def several(scenario: Scenario, count: int) -> Scenario:
    """Return the scenario with one datum for all and `count` vehicles, each with its receiver.

    A scenario that has vehicles keeps them.
    """
    scenario = replace(scenario, datum=_datum(scenario))
    if scenario.vehicles:
        return scenario
    vehicles = []
    for n in range(count):
        receiver = ReceiverConfig("receiver", "pty", scenario.receiver, scenario.output_format, scenario.seed + n)
        vehicles.append(VehicleConfig(f"drone-{n + 1}", system=n + 1, receivers=(receiver,)))
    return replace(scenario, vehicles=tuple(vehicles))


def _datum(scenario: Scenario) -> Lla:
    """Return the scenario's datum, or the place of the vehicles: all have the same, though each has its own home."""
    return Lla(*HOME) if scenario.datum == "home" else scenario.datum


def _flown(scenario: Scenario, *, noisy: bool) -> Scenario:
    """Return the scenario with one datum for a team. `noisy`: the report is not the truth."""
    if scenario.vehicles:
        scenario = replace(scenario, datum=_datum(scenario))
    return replace(scenario, pose="truth", navigation_error=None) if noisy else scenario


@dataclass(frozen=True)
class Drone:
    """One vehicle with its search. `commands`: the vehicle's end of the link on which the search sends commands.

    `emulated`: the same vehicle in the emulator of `scenario`. Distances are horizontal, in m.
    """

    name: str
    vehicle: SimulatedVehicle
    search: SearchClient
    commands: Link
    emulated: EmulatedVehicle
    scenario: Scenario

    @property
    def mission(self) -> Mission | None:
        return self.search.mission

    @property
    def decided(self) -> bool:
        """True if the search has ended. The vehicle may still be in the air."""
        return self.search.outcome is not None or (self.mission is not None and bool(self.mission.ended))

    @property
    def several(self) -> bool:
        """True if this drone searches for more than one transmitter."""
        return self.mission is not None and self.mission.victims.several

    def truth(self) -> dict[int, tuple[float, float, float]]:
        """Return the true places of the transmitters at the newest frame, by id: NED from the take-off point [m].

        Without a take-off point there are none.
        """
        origin, datum = self.search.origin, self.emulated.world.datum.frame
        if origin is None or datum is None:
            return {}
        last = self.emulated.units[0].port.last
        there = moving_transmitters(self.scenario, datum).at(last.instant_s if last else 0.0)
        ned = [origin.ned(*datum.lla(position)).tolist() for position in there.positions]
        return {id_: (north, east, down) for id_, (north, east, down) in zip(there.ids, ned, strict=True)}

    def off(self, now: float) -> float | None:
        """Return the distance from the true place of the vehicle to the transmitter searched for."""
        true = self._true(now)
        return self._distance(true) if true else None

    def relative_error(self, now: float) -> float | None:
        """Return the error of the vector from the vehicle to its landing place; None: no place yet."""
        true = self._true(now)
        if true is None or self.mission is None or self.mission.found is None:
            return None
        goal, told = self.mission.found.goal, self.mission.progress.position
        return self._distance((true[0] + goal[0] - told[0], true[1] + goal[1] - told[1]))

    def error(self) -> float | None:
        """Return the distance from the reported place to the transmitter searched for; None: no place yet.

        If several are searched for: the largest distance.
        """
        if self.several:
            return max(self.errors().values(), default=None)
        found = self.mission.found if self.mission else None
        return None if found is None else self._distance((found.north, found.east))

    def errors(self) -> dict[Victim, float]:
        """Return `error` for each place that a search for several reports. No transmitter is counted twice."""
        left, found = self.truth(), dict[Victim, float]()
        for victim in self.mission.victims.places if self.mission else ():
            place = victim.found[:2]
            nearest = min(left, key=lambda id_: math.dist(place, left[id_][:2]), default=None)
            id_ = victim.id if victim.id in left else nearest
            found[victim] = math.inf if id_ is None else math.dist(place, left.pop(id_)[:2])
        return found

    def _true(self, now: float) -> tuple[float, float] | None:
        """Return the true place of the vehicle, north and east of the take-off point; None before that is known."""
        origin, there = self.search.origin, self.emulated.world.at(now)
        if origin is None:
            return None
        true = origin.ned(*self.vehicle.truth(now).lla)
        if self.scenario.navigation_error is not None and there.pose is not None and there.reported is not None:
            true += there.pose.position - there.reported.position
        north, east, _ = true.tolist()
        return north, east

    def _distance(self, place: tuple[float, float]) -> float | None:
        """Return the distance from a place to the transmitter searched for; to the nearest without ids."""
        if self.mission is None or self.mission.choice.target is None:
            return None
        places = self.truth()
        of = [places[self.mission.choice.target]] if self.mission.choice.target in places else places.values()
        return min(math.dist(place, true[:2]) for true in of)


class ClosedLoop:
    """Remembers the drones of one field and their emulator; `tasks` are for the loop.

    A scenario without vehicles has one drone. The vehicles of a scenario are a team, each with one receiver. They stand
    in a row from west to east, 5 m apart, and divide the plan's area in that order; its origin is the middle of the
    row. Neighbours fly at different heights. Receivers are at the true pose of their vehicle; searches use the reported
    pose.

    - `stream_hz`: of the pose, on both links. `start`: s.
    - `sensors`: of the vehicles, besides their GPS. `wind`: NED, m/s.
    - `tell_packets`: the observers get all packets, for a record.
    - `emit`: gets the events of each search, with its vehicle's name; by default the observers get them.
    - `log`: gets the steps of each search.
    - `wires`: of each drone; by default in memory.
    - `mounts_known`: each search knows the mount of its receiver in the scenario, otherwise that of the plan.
    """

    def __init__(
        self,
        scenario: Scenario,
        plan: SearchPlan,
        *,
        start: float,
        wires: Sequence[Wires] | None = None,
        mounts_known: bool = False,
        wind: Vector = (0.0, 0.0, 0.0),
        gps_noise_m: float = 0.0,
        sensors: int = SENSORS,
        stream_hz: float = 50.0,
        observers: Sequence[Observer] = (),
        tell_packets: bool = False,
        emit: Callable[[str, Event], None] | None = None,
        log: Callable[[SearchStep], None] | None = None,
    ) -> None:
        self.frame = LocalFrame(*astuple(_datum(scenario)))
        scenario = _flown(scenario, noisy=bool(gps_noise_m))
        audience = Audience(observers)
        emit = emit or (lambda name, event: audience.emit([FromSearch(event.time_s, event, name)]))
        told = {"tell_packets": tell_packets, "tell_status": bool(observers)}
        setups = _setups(scenario, stream_hz)
        self.emulator = Emulator(setups, start=start, timeout_s=10.0, **told)
        bus = Bus(TeamField(plan.area, self.frame, len(setups)))
        make = partial(SimulatedVehicle, wind=wind, gps_noise_m=gps_noise_m, sensors=sensors, boot_time=start)
        self.drones: list[Drone] = []
        autopilots, ports, simulators = dict[str, Link](), dict[str, Link](), list[Simulator]()
        for n, (setup, links) in enumerate(zip(setups, wires or [in_memory() for _ in setups], strict=True)):
            name, system, home = self._berth(scenario, n)
            vehicle = make(home, system or 1, seed=scenario.seed + n)
            simulators.append(Simulator([vehicle], [links.autopilot[1], links.commands[1]]))
            (receiver,) = setup.receivers
            autopilots[setup.link], ports[receiver.sink] = links.autopilot[0], links.port[1]
            kind, mate = FORMATS[receiver.scenario.output_format], bus.join() if scenario.vehicles else None
            search = SearchClient(
                _plan(plan, mate, receiver.scenario if mounts_known else None),
                Session(target_system=system, rate_hz=stream_hz, component=COMPONENT),
                links.commands[0],
                links.port[0],
                kind.decoder(),
                start=start,
                emit=partial(emit, name),
                log=log,
                host=getattr(kind, "host", None),
                team=mate,
            )
            self.drones.append(Drone(name, vehicle, search, links.commands[1], self.emulator.vehicles[n], scenario))
        live = Live(self.emulator, autopilots, ports, audience)
        self.tasks: list[Simulator | Live | SearchClient] = [*simulators, live, *(one.search for one in self.drones)]

    @property
    def over(self) -> bool:
        """True if every search has ended, with its vehicle landed or hovering."""
        return all(drone.search.outcome is not None for drone in self.drones)

    @property
    def found(self) -> set[int]:
        """The ids of the transmitters found surely."""
        choices = [one.choice for drone in self.drones if (one := drone.mission) and one.found is not None and one.sure]
        return {choice.target for choice in choices if choice.target is not None}

    def _berth(self, scenario: Scenario, n: int) -> tuple[str, int | None, Vector]:
        """Return the name and the system id of a drone, and its place at the start: degrees, degrees, metres AMSL.

        A drone that is alone has no name, and no id to follow.
        """
        if not scenario.vehicles:
            return "", None, HOME
        vehicle, east = scenario.vehicles[n], (n - (len(scenario.vehicles) - 1) / 2) * APART_M
        lat, lon, alt = (float(value) for value in self.frame.lla([0.0, east, 0.0]))
        return vehicle.name, vehicle.system or n + 1, (lat, lon, alt)


def _plan(plan: SearchPlan, mate: Teammate | None, known: Scenario | None) -> SearchPlan:
    """Return the plan of one drone; with the mount of the receiver in `known`."""
    plan = mate.layered(plan) if mate else plan
    return replace(plan, mount=mount(known)) if known else plan


def _setups(scenario: Scenario, stream_hz: float) -> list[VehicleSetup]:
    if not scenario.vehicles:
        return [one_vehicle(scenario, Session(rate_hz=stream_hz))]

    def session(vehicle: VehicleConfig) -> Session:
        return Session(target_system=vehicle.system, rate_hz=stream_hz, name=vehicle.name)

    return vehicle_setups(scenario, lambda v: v.name, session)
