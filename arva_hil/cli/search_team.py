"""`arva-hil search --scenario`: the vehicles of a scenario search one area, in one program or each in its own."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from arva_hil.autopilot.following.session import Session
from arva_hil.cli import common
from arva_hil.cli.outcome import FAILED, INTERRUPTED, OK, SignalGuard, UsageError
from arva_hil.cli.search_plan import check_receivers, check_width, client_of, plan_of
from arva_hil.cli.search_report import EXIT, as_dict, close_log, result, would_order
from arva_hil.cli.terminal import show_json
from arva_hil.cli.watchers import open_page
from arva_hil.clock import RealClock
from arva_hil.config import Lla, Scenario, VehicleConfig, load
from arva_hil.events import Event
from arva_hil.events.searches import FromSearch, SetPointPlanned, WouldOrder
from arva_hil.events.words.sentences import sentence
from arva_hil.events.words.text import Notice
from arva_hil.links import Link, parse
from arva_hil.links.reconnecting import open_reconnecting
from arva_hil.links.shared import SharedLink
from arva_hil.links.url import show
from arva_hil.model.field import LocalFrame
from arva_hil.observers.console import Printer
from arva_hil.observers.web.state import State
from arva_hil.records.writing.search_log import SearchLog, refuse_team
from arva_hil.runtime.audience import Audience, Observer
from arva_hil.runtime.fleet_links import check_links, shared_links
from arva_hil.runtime.loop import run
from arva_hil.search.flight.client import COMPONENT, SearchClient
from arva_hil.search.mission.outcome import Outcome
from arva_hil.search.strategies.strategy_process import StrategyProcess
from arva_hil.search.team.team import Bus, Teammate
from arva_hil.search.team.team_field import TeamField
from arva_hil.search.team.team_tunnel import MOST_MEMBERS, TeamTunnel

_ONE_ONLY: Final = ("receiver", "gcs", "foxglove", "ros2", "signing_key", "target_system", "target_component")
_READ_AT: Final = {"udpout": "udpin", "tcpin": "tcp", "tcp": "tcpin", "udpin": "udpout"}  # where frames go: other end


class Member(NamedTuple):
    """One search of a team. `number`: of its part of the area; `receiver`: where its frames are read."""

    number: int
    name: str
    system: int
    autopilot: str
    receiver: str
    format: str


class Joined(NamedTuple):
    """The team of a search that has a program for itself."""

    member: Member
    mate: Teammate
    tunnel: TeamTunnel
    size: int


def join(options: argparse.Namespace) -> Joined:
    """The team of `--vehicle`; its links, system and format become those of the options. Raises UsageError."""
    scenario = load(options.scenario)
    names = [vehicle.name for vehicle in scenario.vehicles]
    if options.vehicle not in names:
        raise UsageError(f"--vehicle {options.vehicle}: {scenario.source} has {', '.join(names) or 'no vehicles'}")
    number = names.index(options.vehicle)
    _, field, systems = _team(options, scenario)
    member = _member(options, scenario.vehicles[number], number, scenario.source)
    options.autopilot, options.receiver = member.autopilot, member.receiver
    options.target_system, options.format = member.system, member.format
    tunnel = TeamTunnel(systems, COMPONENT)
    return Joined(member, Teammate(number, tunnel.send, field), tunnel, len(systems))


def main(options: argparse.Namespace) -> int:
    """All vehicles of the scenario, flown by this program."""
    for name in _ONE_ONLY:
        if getattr(options, name, None) not in (None, False, "", "off"):
            flag = name.replace("_", "-")
            raise UsageError(f"--{flag}: of one search: with --scenario, name its --vehicle, or leave it out")
    scenario = load(options.scenario)
    vehicles, field, _ = _team(options, scenario)
    members = [_member(options, vehicle, number, scenario.source) for number, vehicle in enumerate(vehicles)]
    members = _fitted(scenario.source, members)
    if options.record:  # before any of them begins: the folder can be used again then
        refuse_team(Path(options.record), [member.name for member in members])
    plan, clock, bus = plan_of(options), RealClock(), Bus(field)
    start, clients, logs = clock.now(), dict[str, SearchClient](), dict[str, SearchLog]()
    planned = {member.name: list[Event]() for member in members}
    guard, printer = SignalGuard(), Printer(sys.stderr)
    with ExitStack() as stack:
        make = partial(plan.strategy, plan.speed)
        workers = {member.name: stack.enter_context(closing(StrategyProcess(make))) for member in members}
        stack.enter_context(common.run_first())
        title = f"{options.strategy}, {len(members)} vehicles"
        page = open_page(options.web, lambda: State("search", title, known=False, named=True), printer.say)
        if page:
            stack.callback(lambda: page.close("interrupted" if guard.caught else "ended"))

        def opened(url: str, of: list[Member]) -> Link:
            """A link that is looked for until one of its searches has launched its vehicle."""

            def wanted() -> bool:
                return not any(clients[m.name].launched for m in of if m.name in clients)

            opener = partial(open_reconnecting, wanted=wanted) if of else open_reconnecting
            return stack.enter_context(closing(common.open_or_fail(url, clock, opener, patient=True)))

        users = {url: [m for m in members if m.autopilot == url] for url in dict.fromkeys(m.autopilot for m in members)}
        shared = {url: SharedLink(opened(url, of)) for url, of in users.items()}
        receivers = [opened(member.receiver, []) for member in members]
        stack.enter_context(guard)  # what is begun from here on is closed below
        for member, receiver in zip(members, receivers, strict=True):
            autopilot = shared[member.autopilot].user()
            printer.say(
                f"{member.name}: system {member.system}, autopilot: {autopilot.name}, receiver: {receiver.name}"
            )
            log = SearchLog(Path(options.record) / member.name, start_s=start) if options.record else None
            if log:
                logs[member.name] = log
            rate_hz = options.stream_rate
            session = Session(target_system=member.system, rate_hz=rate_hz, component=COMPONENT, name=member.name)
            mate = bus.join()
            clients[member.name] = client_of(
                options,
                mate.layered(plan),
                (session, autopilot, receiver),
                member.format,
                start=start,
                question=None,
                emit=_emit(_News(printer, page, member.name, planned[member.name]), log),
                log=log.row if log else lambda _: None,
                team=mate,
                worker=workers[member.name],
            )

        def over() -> bool:
            for client in clients.values() if guard.caught else ():
                client.stop()
            return all(client.outcome for client in clients.values())

        run(list(clients.values()), clock, stopped=over)
    outcomes = {name: client.outcome or Outcome("failed", "interrupted") for name, client in clients.items()}
    code = INTERRUPTED if guard.caught else exit_code(list(outcomes.values()))
    finders = found_by(outcomes)
    for name, outcome in outcomes.items():
        lines = result(outcome, finders)
        if name in logs:
            lines += close_log(logs[name], outcome, code, clock.epoch_us + start * 1e6)
            code = code or (FAILED if logs[name].error else OK)
        for line in lines:
            printer.say(f"{name}: {line}")
        if options.json:
            orders = {"would_order": would_order(planned[name])} if options.dry_run else {}
            show_json({"vehicle": name} | as_dict(outcome) | orders)
    printer.close()
    return code


def exit_code(outcomes: list[Outcome]) -> int:
    """0 if something was found surely and nothing has failed: who finds nothing on its strips has not failed."""
    kinds = [outcome.kind for outcome in outcomes]
    wrong = [kind for kind in kinds if kind not in ("found", "would fly", "not found", "not sure")]
    if wrong or not {"found", "would fly"} & set(kinds):
        return max(EXIT[kind] for kind in wrong or kinds)
    return OK


def found_by(outcomes: Mapping[str, Outcome]) -> dict[int, str]:
    """Return the drone that has found each transmitter for sure, by the transmitter's id."""
    return {
        outcome.id: name for name, outcome in outcomes.items() if outcome.kind == "found" and outcome.id is not None
    }


@dataclass
class _News:
    """Tells the page and a person what comes from the search of a vehicle. Remembers what it has `planned`."""

    printer: Printer
    page: Observer | None
    name: str
    planned: list[Event]

    def observe(self, event: Event) -> None:
        if isinstance(event, WouldOrder | SetPointPlanned):
            self.planned.append(event)
        if self.page:
            self.page.observe(FromSearch(event.time_s, event, self.name))
        if said := sentence(event):
            self.printer.notice(Notice(said.level, f"{self.name}: {said.text}"))


def _emit(*observers: Observer | None) -> Callable[[Event], None]:
    """Tells observers an event. One that raises stops no search."""
    audience = Audience([one for one in observers if one])
    return lambda event: audience.tell([event])


def _team(
    options: argparse.Namespace, scenario: Scenario
) -> tuple[tuple[VehicleConfig, ...], TeamField, tuple[int, ...]]:
    """The vehicles, what they divide, and their systems. Raises UsageError for a scenario that has no team."""
    source, vehicles = scenario.source, scenario.vehicles
    if options.victims != 1:
        raise UsageError("--victims: several drones share the transmitters, one each: leave it out")
    if not 1 <= len(vehicles) <= MOST_MEMBERS:
        raise UsageError(f"{source}: {len(vehicles)} vehicles, expected 1 to {MOST_MEMBERS} that search")
    if not isinstance(scenario.datum, Lla):
        raise UsageError(f"{source}: datum: home: several searches need one in common: datum: {{lat, lon, alt}}")
    systems = tuple(vehicle.system or 0 for vehicle in vehicles)
    if again := next((s for s in systems if not s or systems.count(s) > 1), None) if len(systems) > 1 else None:
        raise UsageError(f"{source}: system {again} twice: each vehicle that searches needs its own")
    if 0 in systems:
        raise UsageError(f"{source}: {vehicles[systems.index(0)].name}: its system is missing")
    check_receivers(scenario)
    check_width(options, len(vehicles))
    datum = scenario.datum
    return vehicles, TeamField(options.area, LocalFrame(datum.lat, datum.lon, datum.alt), len(vehicles)), systems


def _member(options: argparse.Namespace, vehicle: VehicleConfig, number: int, source: str) -> Member:
    if not (autopilot := options.autopilot or vehicle.autopilot):
        raise UsageError(f"{source}: {vehicle.name}: its autopilot is missing: name its link, or --autopilot")
    (receiver,) = vehicle.receivers
    port = options.receiver or far_end(receiver.port or "", f"{source}: {vehicle.name}")
    assert vehicle.system is not None
    return Member(number, vehicle.name, vehicle.system, autopilot, port, receiver.output_format)


def _fitted(source: str, members: list[Member]) -> list[Member]:
    """Members on the same link with one spelling of it. Raises UsageError if their links do not fit together."""
    autopilots = {member.name: member.autopilot for member in members}
    try:
        check_links(source, {member.name: member.receiver for member in members}, autopilots)
        links = shared_links(source, autopilots)
    except ValueError as error:
        raise UsageError(error) from None
    return [member._replace(autopilot=links[member.name]) for member in members]


def far_end(port: str, whose: str) -> str:
    """Return the address at which the frames sent to a port are read."""
    there = parse(port)
    if there.kind == "pty" and not there.path:
        raise UsageError(f"{whose}: its port is a new pseudo-terminal each time: name it, e.g. pty:/tmp/NAME")
    if there.kind == "stdout":
        raise UsageError(f"{whose}: its port is stdout, where no frames can be read: name a port")
    if there.kind in _READ_AT:
        return f"{_READ_AT[there.kind]}:{show(there.host, there.port)}"
    return there.path if there.kind == "pty" else port
