"""The plan that the options of a search ask for, and the vehicles that fly it: one, or several of a scenario."""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Final

from arva_hil.cli.outcome import UsageError
from arva_hil.cli.terminal import tell
from arva_hil.config import Lla, Scenario, ScenarioError, VehicleConfig, load, parse
from arva_hil.emulator.build import mount
from arva_hil.emulator.setup import scenario_of
from arva_hil.links import parse as parse_link
from arva_hil.links.url import show
from arva_hil.model.field import LocalFrame
from arva_hil.model.field.rotation import Mount, from_euler
from arva_hil.records.writing.search_log import refuse_team
from arva_hil.registry import STRATEGIES, formats_with_ids
from arva_hil.runtime.fleet_links import check_links, shared_links
from arva_hil.search.flight.client import COMPONENT
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strips import Strips
from arva_hil.search.team.team import Bus, TeamField, Teammate, divide
from arva_hil.search.team.team_tunnel import MOST_MEMBERS, TeamTunnel

_NARROWEST_M: Final = 4.0  # narrowest part of an area that is worth a drone


def plan_of(options: argparse.Namespace, scenario: Scenario | None = None) -> SearchPlan:
    """Return the plan of the options; `scenario`: that of the receiver of `--strip-width auto`."""
    place = options.mount or (0.0,) * 6
    return SearchPlan(
        STRATEGIES[options.strategy],
        speed=options.max_speed,
        height=options.height,
        take_off=options.take_off,
        trust_gps=options.trust_height,
        area=options.area,
        strip_width=_strip_width(options, scenario),
        patience_s=options.patience,
        limit_s=options.limit,
        victims=None if options.victims == "all" else options.victims,
        mount=Mount(place[:3], from_euler(*map(math.radians, place[3:]))),
    )


def _strip_width(options: argparse.Namespace, scenario: Scenario | None) -> float:
    """Return the given width, or the width that a receiver allows. Raises UsageError."""
    given = options.strip_width
    if isinstance(given, float):
        return given
    from arva_hil.campaign.range_test.walk import strip_width  # slow to import

    if given != "auto":
        file = {"spec": 2, "transmitters": [{"id": 0, "ned": [0, 0, 0]}], "receiver": {"profile": given}}
        try:
            scenario = parse(json.dumps(file), "--strip-width")
        except ScenarioError as error:
            wrong = error.problems[0]
            if wrong.source != "--strip-width":
                raise UsageError(*error.problems) from None
            hint = f", did you mean {wrong.nearest}?" if wrong.nearest else ""
            raise UsageError(f"--strip-width: {wrong.found}, expected {wrong.expected}{hint}") from None
    if scenario is None:
        raise UsageError("--strip-width auto: give the receiver's profile, e.g. --strip-width builtin:two_antennas")
    if (width := strip_width(scenario, options.height, options.max_speed)) is None:
        raise UsageError(f"--strip-width {given}: that receiver's range is too short for strips")
    tell(
        f"strips at most {width.metres:.0f} m wide: 1.26 × the range for the weakest transmitter; "
        f"{width.detection:.1%} of simulated flights along such a strip receive it"
    )
    return width.metres


def describe(plan: SearchPlan) -> str:
    """Return a line about the strips before the first signal. Raises UsageError if they take too much time."""
    lanes = Strips(plan.area, plan.speed, (0.0, 0.0, 0.0), width=plan.strip_width).lanes
    there = math.hypot(*lanes[0])
    way = there + sum(math.dist(a, b) for a, b in pairwise(lanes))
    at = f"at {plan.speed:g} m/s"
    if there > plan.limit_s * plan.speed:
        raise UsageError(f"--area: its nearest corner is {there:.0f} m away, {at} too far for --limit {plan.limit_s:g}")
    less = f", more than the {plan.limit_s:g} s there are" if way > plan.limit_s * plan.speed else ""
    return f"strips of {way:.0f} m until the first signal, {way / plan.speed:.0f} s {at}{less}"


def check_receivers(base: Scenario) -> None:
    """Check that each vehicle has one receiver, whose frames carry ids. Raises UsageError."""
    for vehicle in base.vehicles:
        if len(vehicle.receivers) > 1:
            raise UsageError(f"{base.source}: {vehicle.name}: {len(vehicle.receivers)} receivers; a drone has one here")
    formats = [receiver.output_format for vehicle in base.vehicles for receiver in vehicle.receivers]
    for of in formats or [base.output_format]:
        if of not in (usable := formats_with_ids()):
            raise UsageError(f"format {of}: several drones need {' or '.join(usable)}, whose frames carry ids")


def tell_ropes(base: Scenario) -> None:
    """Warn if a receiver hangs on a rope: a search takes it to be at the rope's upper end."""
    every = [one.receiver for vehicle in base.vehicles for one in vehicle.receivers] or [base.receiver]
    if longest := max((one.mount.sling.length_m for one in every if one.mount.sling), default=0.0):
        tell(
            f"warning: {base.source}: a receiver hangs on a rope, which the search does not know: "
            f"places are up to {longest:g} m too high"
        )


def check_width(options: argparse.Namespace, count: int) -> None:
    """Check that the parts of the area are wide enough. Raises UsageError."""
    _, west, _, east = divide(options.area, count)[0]
    if east - west < _NARROWEST_M:
        raise UsageError(
            f"--area: {count} drones would have {east - west:.1f} m each, at least {_NARROWEST_M:g} m needed"
        )


_ONE_ONLY: Final = ("receiver", "gcs", "foxglove", "ros2", "signing_key", "target_system", "target_component")
_READ_AT: Final = {
    "udpout": "udpin",
    "tcpin": "tcp",
    "tcp": "tcpin",
    "udpin": "udpout",
}  # the link of a port → the link of its other end


@dataclass(frozen=True)
class Member:
    """One search of this program. `autopilot`, `receiver`: connection strings of its links."""

    name: str
    """Of its vehicle; "" if this program flies no other."""
    system: int | None
    autopilot: str
    receiver: str
    format: str
    mount: Mount | None = None
    """That of the scenario; None for the plan's."""
    mate: Teammate | None = None
    """The search in its team."""
    tunnel: TeamTunnel | None = None
    """The connection to searches of the team in other programs."""
    team: int = 1
    """Number of searches that divide the area."""


def members_of(options: argparse.Namespace) -> list[Member]:
    """Return the searches of this program. Raises UsageError."""
    if options.scenario and options.vehicle is None:
        return _all_members(options)
    if options.scenario:
        alone = _one_of_team(options)
    elif options.vehicle:
        raise UsageError(f"--vehicle {options.vehicle}: one of the vehicles of --scenario FILE, which is missing")
    else:
        alone = Member("", options.target_system, options.autopilot, options.receiver, options.format or "binary")
    for name in ("autopilot", "receiver"):
        if getattr(alone, name) in (None, "-"):
            raise UsageError(
                f"--{name} is missing, e.g. arva-hil search --autopilot udpin:127.0.0.1:14540 --receiver /tmp/arva0"
            )
    return [alone]


def _one_of_team(options: argparse.Namespace) -> Member:
    """Return the vehicle that --vehicle names; other programs fly the others."""
    scenario = load(options.scenario)
    if options.target_system is not None:
        raise UsageError(f"--target-system: {scenario.source} has the system of each vehicle: leave it out")
    names = [vehicle.name for vehicle in scenario.vehicles]
    if options.vehicle not in names:
        raise UsageError(f"--vehicle {options.vehicle}: {scenario.source} has {', '.join(names) or 'no vehicles'}")
    number = names.index(options.vehicle)
    _, field, systems = _team(options, scenario)
    member = _member(options, scenario.vehicles[number], scenario)
    tunnel = TeamTunnel(systems, COMPONENT)
    return replace(member, name="", mate=Teammate(number, tunnel.send, field), tunnel=tunnel, team=len(systems))


def _all_members(options: argparse.Namespace) -> list[Member]:
    """Return all vehicles of the scenario."""
    for name in _ONE_ONLY:
        if getattr(options, name, None) not in (None, False, "", "off"):
            flag = name.replace("_", "-")
            raise UsageError(f"--{flag}: of one search: with --scenario, name its --vehicle, or leave it out")
    scenario = load(options.scenario)
    vehicles, field, _ = _team(options, scenario)
    members = _fitted(scenario.source, [_member(options, vehicle, scenario) for vehicle in vehicles])
    if options.record:  # before any of them begins: the folder can be used again then
        refuse_team(Path(options.record), [member.name for member in members])
    bus = Bus(field)
    return [replace(member, mate=bus.join()) for member in members]


def _team(
    options: argparse.Namespace, scenario: Scenario
) -> tuple[tuple[VehicleConfig, ...], TeamField, tuple[int, ...]]:
    """Return the vehicles, what they divide, and their systems. Raises UsageError for a scenario that has no team."""
    source, vehicles = scenario.source, scenario.vehicles
    if options.victims != 1:
        raise UsageError("--victims: several drones share the transmitters, one each: leave it out")
    if "format" in options.typed:
        raise UsageError(f"--format: {source} has the format of each receiver: leave it out")
    if not 1 <= len(vehicles) <= MOST_MEMBERS:
        raise UsageError(f"{source}: {len(vehicles)} vehicles, expected 1 to {MOST_MEMBERS} that search")
    if not isinstance(scenario.datum, Lla):
        raise UsageError(f"{source}: datum: home: several searches need one in common: datum: {{lat, lon, alt}}")
    systems = tuple(vehicle.system or 0 for vehicle in vehicles)
    if again := next((s for s in systems if not s or systems.count(s) > 1), None):
        raise UsageError(f"{source}: system {again} twice: each vehicle that searches needs its own")
    if 0 in systems:
        raise UsageError(f"{source}: {vehicles[systems.index(0)].name}: its system is missing")
    check_receivers(scenario)
    tell_ropes(scenario)
    check_width(options, len(vehicles))
    datum = scenario.datum
    return vehicles, TeamField(options.area, LocalFrame(datum.lat, datum.lon, datum.alt), len(vehicles)), systems


def _member(options: argparse.Namespace, vehicle: VehicleConfig, scenario: Scenario) -> Member:
    source = scenario.source
    if not (autopilot := options.autopilot or vehicle.autopilot):
        raise UsageError(f"{source}: {vehicle.name}: its autopilot is missing: name its link, or --autopilot")
    (receiver,) = vehicle.receivers
    return Member(
        vehicle.name,
        vehicle.system,
        autopilot,
        options.receiver or far_end(receiver.port or "", f"{source}: {vehicle.name}"),
        receiver.output_format,
        None if options.mount else mount(scenario_of(scenario, receiver)),
    )


def _fitted(source: str, members: list[Member]) -> list[Member]:
    """Return the members, with one spelling of a shared link. Raises UsageError if their links do not fit together."""
    autopilots = {member.name: member.autopilot for member in members}
    try:
        check_links(source, {member.name: member.receiver for member in members}, autopilots)
        links = shared_links(source, autopilots)
    except ValueError as error:
        raise UsageError(error) from None
    return [replace(member, autopilot=links[member.name]) for member in members]


def far_end(port: str, whose: str) -> str:
    """Return the address at which the frames sent to a port are read."""
    there = parse_link(port)
    if there.kind == "pty" and not there.path:
        raise UsageError(f"{whose}: its port is a new pseudo-terminal each time: name it, e.g. pty:/tmp/NAME")
    if there.kind == "stdout":
        raise UsageError(f"{whose}: its port is stdout, where no frames can be read: name a port")
    if there.kind in _READ_AT:
        return f"{_READ_AT[there.kind]}:{show(there.host, there.port)}"
    return there.path if there.kind == "pty" else port
