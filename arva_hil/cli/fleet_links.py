"""The links of a run whose scenario names its vehicles, and whether they fit together."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Final, NamedTuple

from arva_hil.cli.outcome import UsageError
from arva_hil.cli.run_links import choose_autopilot, place
from arva_hil.config import Scenario, VehicleConfig
from arva_hil.emulator.engine import sink_name
from arva_hil.links import Address, AddressError, parse

_OWN: Final = {"port": "each receiver has its own port", "target_system": "each vehicle has its own system"}


class FleetSides(NamedTuple):
    """`autopilots`: connection strings of the links, by the engine's names for them; `of_vehicle`: the name of each
    vehicle's link; `ports`: connection strings by the engine's names for receivers' ports.
    """

    autopilots: dict[str, str]
    of_vehicle: dict[str, str]
    ports: dict[str, str]


def fleet_sides(options: argparse.Namespace, chosen: Scenario) -> FleetSides:
    """The links of a scenario with vehicles. Raises UsageError if options or addresses do not fit together."""
    source = chosen.source
    for option, why in _OWN.items():
        if getattr(options, option) is not None:
            raise UsageError(f"--{option.replace('_', '-')}: {source} has vehicles, and {why}: leave it out")
    if options.autopilot and all(vehicle.autopilot for vehicle in chosen.vehicles):
        raise UsageError(f"--autopilot: every vehicle of {source} names its own: leave it out")
    ports = {
        sink_name(vehicle, receiver): receiver.port
        for vehicle in chosen.vehicles
        for receiver in vehicle.receivers
        if receiver.port
    }
    usual = options.autopilot
    if not usual and not all(vehicle.autopilot for vehicle in chosen.vehicles):
        usual = choose_autopilot(*ports.values())
    autopilots = {vehicle.name: vehicle.autopilot or str(usual) for vehicle in chosen.vehicles}
    _check_ports(source, ports, autopilots, json=options.json)
    by_place = {_place(source, name, address): address for name, address in reversed(autopilots.items())}
    of_vehicle = {name: by_place[_place(source, name, address)] for name, address in autopilots.items()}
    for link in dict.fromkeys(of_vehicle.values()):
        _check_systems(source, link, [vehicle for vehicle in chosen.vehicles if of_vehicle[vehicle.name] == link])
    return FleetSides({link: link for link in dict.fromkeys(of_vehicle.values())}, of_vehicle, ports)


def _check_ports(source: str, ports: dict[str, str], autopilots: dict[str, str], *, json: bool) -> None:
    """Check that frames can be sent to each port, and that nothing else is sent there. Raises UsageError."""
    taken = {}
    for name, address in autopilots.items():
        if parse_or_fail(source, name, address).kind == "stdout":
            raise UsageError(
                f"{source}: {name}: its autopilot is stdout, which cannot be read: name the autopilot's link"
            )
        taken[_place(source, name, address)] = f"the autopilot of {name}"
    for name, address in ports.items():
        kind = parse_or_fail(source, name, address).kind
        if kind == "tlog":
            raise UsageError(f"{source}: {name}: its port {address} is a log: frames cannot be sent there")
        if kind == "stdout" and json:
            raise UsageError(f"{source}: {name}: --json and its port - both want stdout: choose one")
        where = _place(source, name, address)
        if where != Address("pty") and where in taken:
            raise UsageError(f"{source}: {name}: its port {address} is also {taken[where]}: each needs its own")
        taken[where] = f"the port of {name}"


def _check_systems(source: str, link: str, vehicles: Sequence[VehicleConfig]) -> None:
    """Check that vehicles on one link can be told apart. Raises UsageError."""
    systems = [vehicle.system for vehicle in vehicles]
    if len(vehicles) > 1 and (None in systems or len(set(systems)) < len(systems)):
        names = ", ".join(vehicle.name for vehicle in vehicles)
        raise UsageError(f"{source}: {names} are all on {link}: give each its own `system`")


def _place(source: str, name: str, address: str) -> Address:
    parse_or_fail(source, name, address)
    return place(address)


def parse_or_fail(source: str, name: str, address: str) -> Address:
    """Parse an address of a vehicle or receiver. Raises UsageError."""
    try:
        return parse(address)
    except AddressError as error:
        raise UsageError(f"{source}: {name}: {error}") from None
