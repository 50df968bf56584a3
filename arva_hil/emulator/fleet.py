"""The vehicles of a scenario as the engine takes them: each with its link, its session and its receivers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from arva_hil.config import ReceiverConfig, Scenario, VehicleConfig
from arva_hil.emulator.engine import ReceiverSetup, VehicleSetup
from arva_hil.vehicle.session import Session


def scenario_of(scenario: Scenario, receiver: ReceiverConfig) -> Scenario:
    """The scenario as one of its receivers has it: its own mount, rate, format and seed, and no other vehicles."""
    return replace(
        scenario,
        receiver=receiver.receiver,
        output_format=receiver.output_format,
        seed=receiver.seed,
        vehicles=(),
    )


def receivers_of(scenario: Scenario) -> list[tuple[str, str]]:
    """The names of all receivers, each with its vehicle's."""
    return [(vehicle.name, receiver.name) for vehicle in scenario.vehicles for receiver in vehicle.receivers]


def sink_name(vehicle: VehicleConfig, receiver: ReceiverConfig) -> str:
    """The engine's name of a receiver's port."""
    return f"{vehicle.name}/{receiver.name}"


def vehicle_setups(
    scenario: Scenario, link_of: Callable[[VehicleConfig], str], session_of: Callable[[VehicleConfig], Session]
) -> list[VehicleSetup]:
    """Every vehicle of a scenario with `vehicles`.

    `link_of`: the engine's name of a vehicle's link; `session_of`: who follows it there. Sessions of one link need the
    same reader. Frames of a receiver without a port go over the vehicle's link.
    """
    return [
        VehicleSetup(
            vehicle.name,
            link_of(vehicle),
            session_of(vehicle),
            scenario,
            [
                ReceiverSetup(
                    receiver.name,
                    sink_name(vehicle, receiver) if receiver.port else link_of(vehicle),
                    scenario_of(scenario, receiver),
                )
                for receiver in vehicle.receivers
            ],
        )
        for vehicle in scenario.vehicles
    ]
