"""From a scenario to the vehicles and receivers of an engine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from arva_hil.autopilot.following.session import Session
from arva_hil.config import ReceiverConfig, Scenario, VehicleConfig
from arva_hil.registry import over_mavlink


@dataclass(frozen=True)
class ReceiverSetup:
    """One receiver. `sink`: the link for its frames; for formats inside MAVLink, the autopilot's own.

    `faults_change`: its faults may change during the run.
    """

    name: str
    sink: str
    scenario: Scenario
    faults_change: bool = False


@dataclass(frozen=True)
class VehicleSetup:
    """One vehicle with its receivers. `link`: its link. `session`: follows it there."""

    name: str
    link: str
    session: Session
    scenario: Scenario
    receivers: Sequence[ReceiverSetup]


def one_vehicle(scenario: Scenario, session: Session, *, link: str = "autopilot", sink: str = "port") -> VehicleSetup:
    """Return one vehicle with one receiver, for a scenario without `vehicles`. Formats inside MAVLink use no `sink`."""
    sink = link if over_mavlink(scenario.output_format) else sink
    return VehicleSetup("vehicle", link, session, scenario, [ReceiverSetup("receiver", sink, scenario)])


def scenario_of(scenario: Scenario, receiver: ReceiverConfig) -> Scenario:
    """Return the scenario of one of its receivers: with its mount, rate, format and seed, and without vehicles."""
    return replace(
        scenario, receiver=receiver.receiver, output_format=receiver.output_format, seed=receiver.seed, vehicles=()
    )


def receivers_of(scenario: Scenario) -> list[tuple[str, str]]:
    """Return the names of all receivers: (vehicle, receiver)."""
    return [(vehicle.name, receiver.name) for vehicle in scenario.vehicles for receiver in vehicle.receivers]


def sink_name(vehicle: VehicleConfig, receiver: ReceiverConfig) -> str:
    """Return the engine's name of a receiver's port."""
    return f"{vehicle.name}/{receiver.name}"


def vehicle_setups(
    scenario: Scenario, link_of: Callable[[VehicleConfig], str], session_of: Callable[[VehicleConfig], Session]
) -> list[VehicleSetup]:
    """Return the setups of the vehicles of a scenario with `vehicles`.

    `link_of`: gives the engine's name of a vehicle's link; `session_of`: its session. Sessions on one link need the
    same reader. Frames of a receiver without a port are sent over the vehicle's link.
    """
    setups = []
    for vehicle in scenario.vehicles:
        link = link_of(vehicle)
        receivers = [
            ReceiverSetup(one.name, sink_name(vehicle, one) if one.port else link, scenario_of(scenario, one))
            for one in vehicle.receivers
        ]
        setups.append(VehicleSetup(vehicle.name, link, session_of(vehicle), scenario, receivers))
    return setups


def check_systems(source: str, link: str, vehicles: Sequence[VehicleConfig]) -> None:
    """Check that the system ids of vehicles on one link differ. Raises ValueError."""
    systems = [vehicle.system for vehicle in vehicles]
    if len(vehicles) > 1 and (None in systems or len(set(systems)) < len(systems)):
        names = ", ".join(vehicle.name for vehicle in vehicles)
        raise ValueError(f"{source}: {names} are all on {link}: give each its own `system`")
