"""`arva-hil search`: flies one vehicle, or several as a team, each by its receiver, and prints each outcome."""

from __future__ import annotations

import argparse
import gc
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from arva_hil.autopilot.following.session import Session
from arva_hil.cli import common
from arva_hil.cli.outcome import FAILED, INTERRUPTED, OK, SignalGuard
from arva_hil.cli.run_links import check_ground_station, signing
from arva_hil.cli.search_plan import Member, describe, members_of, plan_of
from arva_hil.cli.search_report import as_dict, close_log, exit_code, found_by, result, would_order
from arva_hil.cli.terminal import TerminalQuestion, show_json, somebody_is_there
from arva_hil.cli.watchers import background_of, close_all, live_observers, open_page
from arva_hil.clock import RealClock
from arva_hil.events import Event
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import FromSearch, SetPointPlanned, WouldOrder
from arva_hil.events.words.reasons import in_words
from arva_hil.events.words.sentences import sentence
from arva_hil.events.words.text import Notice
from arva_hil.links import Link
from arva_hil.links.memory import SharedLink
from arva_hil.links.reconnecting import open_reconnecting
from arva_hil.mavlink.signing import Signing
from arva_hil.observers.console import Printer
from arva_hil.observers.ground_station import GroundStation
from arva_hil.observers.web.address import HostPort
from arva_hil.observers.web.state import State
from arva_hil.records.writing.search_log import SearchLog
from arva_hil.registry import FORMATS
from arva_hil.runtime.audience import Audience, Observer
from arva_hil.runtime.loop import run
from arva_hil.search.flight.client import COMPONENT, SearchClient
from arva_hil.search.flight.preflight import Permission, Question
from arva_hil.search.mission.outcome import Outcome, SearchStep
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy_process import StrategyProcess
from firmware_proto import INNER


@dataclass
class Searcher:
    """One search. Remembers its links, its log, what it has `planned` in a dry run, and its client once it begins."""

    member: Member
    worker: StrategyProcess
    autopilot: Link
    receiver: Link
    session: Session
    log: SearchLog | None = None
    planned: list[Event] = field(default_factory=list)
    client: SearchClient | None = None

    @property
    def outcome(self) -> Outcome:
        return (self.client and self.client.outcome) or Outcome("failed", (because(Why.INTERRUPTED),))

    def observe(self, event: Event) -> None:
        if isinstance(event, WouldOrder | SetPointPlanned):
            self.planned.append(event)


def main(options: argparse.Namespace) -> int:
    members = members_of(options)
    if options.gcs:
        check_ground_station(options.gcs, members[0].autopilot, members[0].receiver)
    plan = plan_of(options)
    title, *lines = _introduction(options, members, plan)
    clock, guard = RealClock(), SignalGuard()
    start = clock.now()
    with ExitStack() as stack:
        workers = [stack.enter_context(closing(StrategyProcess(partial(plan.strategy, plan.speed)))) for _ in members]
        stack.enter_context(common.run_first())
        key = signing(options.signing_key, clock.epoch_us, stack)
        searchers = _searchers(options, members, workers, key, clock, stack)
        printer = Printer(sys.stderr)
        printer.say(*map(_links, searchers), *lines)
        named = bool(members[0].name)
        under = background_of(options.map, None) if options.map else None
        state = partial(State, "search", title, known=False, named=named, background=under)
        page = open_page(options, state, printer.say)
        if page:
            stack.callback(lambda: page.close(*_end(searchers, guard)))
        live = live_observers(options, None, clock.epoch_us)
        if options.gcs:
            live.append(_ground_station(options.gcs, searchers[0].session, clock, printer))
        stack.enter_context(guard)  # what is begun from here on is closed below
        question = TerminalQuestion(printer.say) if not named and somebody_is_there() else None
        clients = []
        for one in searchers:
            one.log = SearchLog(Path(options.record) / one.member.name, start_s=start) if options.record else None
            emit = _teller(one, printer, [*live, page] if page else live)
            one.client = _client(options, plan, one, start=start, question=question, emit=emit, printer=printer)
            clients.append(one.client)

        def over() -> bool:
            for client in clients if guard.caught else ():
                client.stop()
            return all(client.outcome for client in clients)

        gc.freeze()  # the garbage collector would visit all objects of the start-up, which takes 20 ms
        run(clients, clock, stopped=over)
    code = _tell_ends(searchers, printer, guard, clock.epoch_us + start * 1e6)
    close_all(live, printer.notice)
    printer.close()
    for one in searchers if options.json else ():
        vehicle = {"vehicle": one.member.name} if one.member.name else {}
        orders = {"would_order": would_order(one.planned)} if options.dry_run else {}
        show_json(vehicle | as_dict(one.outcome) | orders)
    return code


def _introduction(options: argparse.Namespace, members: Sequence[Member], plan: SearchPlan) -> list[str]:
    """Return the title of the page, and lines about the plan of a search that is alone in this program."""
    if members[0].name:
        return [f"{options.strategy}, {len(members)} vehicles"]
    (alone,) = members
    way = f"a part of the area of {alone.team}" if alone.mate else describe(plan)
    lines = [options.strategy, f"strategy {options.strategy}; {way}"]
    if options.dry_run:
        lines.append("dry run: nothing is armed, and nothing that moves the vehicle is ordered")
    return lines


def _links(one: Searcher) -> str:
    of = f"{one.member.name}: system {one.member.system}, " if one.member.name else ""
    return f"{of}autopilot: {one.autopilot.name}, receiver: {one.receiver.name}"


def _searchers(
    options: argparse.Namespace,
    members: Sequence[Member],
    workers: Sequence[StrategyProcess],
    key: Signing | None,
    clock: RealClock,
    stack: ExitStack,
) -> list[Searcher]:
    """Open the links, each autopilot's once. A lost link is reopened until one of its searches has launched."""
    searchers: list[Searcher] = []

    def opened(url: str, *, autopilot: bool) -> Link:
        def wanted() -> bool:
            return not any(
                one.client and one.client.launched for one in searchers if autopilot and one.member.autopilot == url
            )

        opener = partial(open_reconnecting, wanted=wanted)
        return stack.enter_context(closing(common.open_or_fail(url, clock, opener, patient=True)))

    autopilots = [member.autopilot for member in members]
    links: Mapping[str, list[Link]] = {
        url: _for_each(opened(url, autopilot=True), autopilots.count(url)) for url in dict.fromkeys(autopilots)
    }
    for member, worker in zip(members, workers, strict=True):
        receiver = opened(member.receiver, autopilot=False)
        session = Session(
            target_system=member.system,
            target_component=options.target_component,
            rate_hz=options.stream_rate,
            component=COMPONENT,
            signing=key,
            name=member.name,
        )
        searchers.append(Searcher(member, worker, links[member.autopilot].pop(0), receiver, session))
    return searchers


def _for_each(link: Link, users: int) -> list[Link]:
    """Return the link for each of its users."""
    shared = SharedLink(link)
    return [shared.user() for _ in range(users)] if users > 1 else [link]


def _ground_station(url: str, session: Session, clock: RealClock, printer: Printer) -> GroundStation:
    link = common.open_or_fail(url, clock, open_reconnecting, patient=True)
    printer.say(f"ground station: {link.name}")
    return GroundStation(link, lambda: session.vehicle.system if session.vehicle else None, COMPONENT)


def _teller(one: Searcher, printer: Printer, watchers: Sequence[Observer]) -> Callable[[Event], None]:
    """Return the receiver of the events of a search. An observer that raises stops no search."""
    watchers = [_Named(one.member.name, printer, watchers)] if one.member.name else [printer, *watchers]
    audience = Audience([*watchers, one, one.log] if one.log else [*watchers, one])
    return lambda event: audience.emit([event])


@dataclass
class _Named:
    """Gives a person and `watchers` the events of a search with the name of its vehicle."""

    name: str
    printer: Printer
    watchers: Sequence[Observer]

    def observe(self, event: Event) -> None:
        for watcher in self.watchers:
            watcher.observe(FromSearch(event.time_s, event, self.name))
        if said := sentence(event):
            self.printer.notice(Notice(said.level, f"{self.name}: {said.text}"))


def _client(
    options: argparse.Namespace,
    plan: SearchPlan,
    one: Searcher,
    *,
    start: float,
    question: Question | None,
    emit: Callable[[Event], None],
    printer: Printer,
) -> SearchClient:
    member, kind = one.member, FORMATS[one.member.format]
    plan = replace(
        member.mate.layered(plan) if member.mate else plan,
        mount=member.mount or plan.mount,
        land=options.end == "land",
        timeout_s=options.timeout,
        arm_timeout_s=options.arm_timeout,
        take_over=options.take_over,
        countdown_s=options.countdown,
        dry_run=options.dry_run,
    )
    return SearchClient(
        plan,
        one.session,
        one.autopilot,
        one.receiver,
        kind.decoder(),
        start=start,
        permission=Permission(one.session, yes=options.yes, question=question, dry_run=options.dry_run),
        emit=emit,
        log=rows_to(None if member.name else printer, one.log),
        host=getattr(kind, "host", None),
        team=member.mate,
        tunnel=member.tunnel,
        worker=one.worker,
        tell_packets=isinstance(options.web, HostPort),  # for the page
    )


def rows_to(printer: Printer | None, log: SearchLog | None) -> Callable[[SearchStep], None]:
    """Return the receiver of a flight's steps: the log and the status line."""

    def take(row: SearchStep) -> None:
        if log is not None:
            log.row(row)
        if printer is not None and row.d_cm is not None:
            direction = "" if row.zone == INNER else f" {row.delta_deg:+d}°"
            d = f"{row.d_cm} cm{direction}" if row.d_cm > 0 else "no signal"
            place = f"{row.north_m:z.1f} m N, {row.east_m:z.1f} m E, {-row.down_m:z.1f} m high"
            printer.show(row.time_s, [d, row.phase, place])

    return take


def _end(searchers: Sequence[Searcher], guard: SignalGuard) -> tuple[str, bool]:
    """Return the end of the searches, for the page, and True if they have failed."""
    outcomes = [one.outcome for one in searchers]
    failed = not guard.caught and exit_code(outcomes) != OK
    if not searchers[0].member.name:
        return in_words(outcomes[0].how), failed
    return "interrupted" if guard.caught else "ended", failed


def _tell_ends(searchers: Sequence[Searcher], printer: Printer, guard: SignalGuard, started_us: float) -> int:
    """Print the end of each search, and close its log. Returns the exit code."""
    outcomes = {one.member.name: one.outcome for one in searchers}
    code = INTERRUPTED if guard.caught else exit_code(list(outcomes.values()))
    finders = found_by(outcomes)
    for one in searchers:
        lines, name = result(one.outcome, finders), one.member.name
        if not name:
            printer.notice(Notice("info" if code in (OK, INTERRUPTED) else "error", lines.pop(0)))
        if one.log is not None:
            lines += close_log(one.log, one.outcome, code, started_us)
            code = code or (FAILED if one.log.error else OK)
        printer.say(*(f"{name}: {line}" if name else line for line in lines))
    return code
