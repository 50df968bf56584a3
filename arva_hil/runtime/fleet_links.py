"""The links of a run and of its vehicles, each link once."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

from arva_hil.autopilot.following.session import Session
from arva_hil.config import Scenario, VehicleConfig
from arva_hil.emulator.setup import (
    VehicleSetup,
    check_systems,
    one_vehicle,
    sink_name,
    vehicle_setups,
)
from arva_hil.links import Address, AddressError
from arva_hil.links.url import excludes, place
from arva_hil.mavlink.packet_reader import PacketReader


class FleetSides(NamedTuple):
    """The links of a run.

    - `autopilots`: connection strings of the autopilots' links, by the engine's names for them.
    - `of_vehicle`: the name of the link of each vehicle in the scenario.
    - `ports`: connection strings of the receivers' ports, by the engine's names for them.
    """

    autopilots: dict[str, str]
    of_vehicle: dict[str, str]
    ports: dict[str, str]


def live_vehicles(
    chosen: Scenario,
    sides: FleetSides,
    readers: Mapping[str, PacketReader],
    system: int | None,
    component: int | None,
    rate_hz: float,
) -> list[VehicleSetup]:
    """Return the vehicles of a live run, each followed by the reader of its link. For the rest see `Session`.

    `system`: of the vehicle if the scenario names none.
    """
    session, link_of = partial(Session, target_component=component, rate_hz=rate_hz), sides.of_vehicle
    if not chosen.vehicles:
        return [one_vehicle(chosen, session(target_system=system, reader=readers["autopilot"]))]

    def own(vehicle: VehicleConfig) -> Session:
        return session(target_system=vehicle.system, reader=readers[link_of[vehicle.name]], name=vehicle.name)

    return vehicle_setups(chosen, lambda vehicle: link_of[vehicle.name], own)


def vehicles_in_log(chosen: Scenario, log: str, system: int | None, component: int | None) -> list[VehicleSetup]:
    """Return the vehicles of a replay, on the link "autopilot". They differ by their system ids.

    `log`: its name for a person. Raises ValueError if they have the same ids there.
    """
    session = partial(Session, target_component=component, passive=True, reader=PacketReader())
    if not chosen.vehicles:
        return [one_vehicle(chosen, session(target_system=system))]
    check_systems(chosen.source, log, chosen.vehicles)
    return vehicle_setups(chosen, lambda _: "autopilot", lambda v: session(target_system=v.system, name=v.name))


def ports_of(chosen: Scenario) -> dict[str, str]:
    """Return the connection strings of the receivers' ports by the engine's names for them."""
    return {
        sink_name(vehicle, receiver): receiver.port
        for vehicle in chosen.vehicles
        for receiver in vehicle.receivers
        if receiver.port
    }


def fleet_sides(chosen: Scenario, usual: str | None, *, json: bool = False) -> FleetSides:
    """Return the links of a scenario with vehicles. `usual`: of a vehicle that names no link of its autopilot.

    `json`: stdout has other lines, and no frames can go there. Raises ValueError if the addresses do not fit together.
    """
    source, ports = chosen.source, ports_of(chosen)
    autopilots = {}
    for vehicle in chosen.vehicles:
        if not (address := vehicle.autopilot or usual):
            raise ValueError(f"{source}: {vehicle.name}: its autopilot is missing: name its link")
        autopilots[vehicle.name] = address
    check_links(source, ports, autopilots, json=json)
    of_vehicle = shared_links(source, autopilots)
    for link in dict.fromkeys(of_vehicle.values()):
        check_systems(source, link, [vehicle for vehicle in chosen.vehicles if of_vehicle[vehicle.name] == link])
    return FleetSides({link: link for link in dict.fromkeys(of_vehicle.values())}, of_vehicle, ports)


def shared_links(source: str, autopilots: dict[str, str]) -> dict[str, str]:
    """Return the link of each vehicle by its name, in one spelling where several write the same link.

    Raises ValueError.
    """
    by_place = {_place(source, name, address): address for name, address in reversed([*autopilots.items()])}
    return {name: by_place[_place(source, name, address)] for name, address in autopilots.items()}


def check_links(source: str, ports: Mapping[str, str], autopilots: Mapping[str, str], *, json: bool = False) -> None:
    """Check that frames can be sent to each port, and that no two links have the same address.

    `json`: stdout has other lines. Raises ValueError.
    """
    taken = {}
    for name, address in autopilots.items():
        if (where := _place(source, name, address)).kind == "stdout":
            raise ValueError(
                f"{source}: {name}: its autopilot is stdout, which cannot be read: name the autopilot's link"
            )
        taken[where] = f"the autopilot of {name}"
    for name, address in ports.items():
        where = _place(source, name, address)
        if where.kind == "tlog":
            raise ValueError(f"{source}: {name}: its port {address} is a log: frames cannot be sent there")
        if where.kind == "stdout" and json:
            raise ValueError(f"{source}: {name}: --json and its port - both go to stdout: choose one")
        if where != Address("pty") and where in taken:
            raise ValueError(f"{source}: {name}: its port {address} is also {taken[where]}: each needs its own")
        taken[where] = f"the port of {name}"
    for where in [where for where in taken if where.host in ("0.0.0.0", "::")]:
        if other := next((other for other in taken if excludes(where, other)), None):
            raise ValueError(
                f"{source}: {where} is {taken[where]} and listens at all addresses, so {other}, {taken[other]}, cannot "
                "listen there too: choose another port, or for two autopilots the same address"
            )


def _place(source: str, name: str, address: str) -> Address:
    """Return the place of a vehicle's or a receiver's link: see `place`. Raises ValueError."""
    try:
        return place(address)
    except AddressError as error:
        raise ValueError(f"{source}: {name}: {error}") from None
