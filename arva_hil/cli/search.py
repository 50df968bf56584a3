"""`arva-hil search`: flies one vehicle by one receiver, and says how it ended."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final

from arva_hil.cli import common
from arva_hil.cli.outcome import FAILED, INTERRUPTED, NO_LINK, OK, USAGE, SignalGuard, UsageError
from arva_hil.cli.run_links import check_ground_station, signing
from arva_hil.cli.run_links import session as session_of
from arva_hil.cli.search_report import as_dict, close_log, result, would_order
from arva_hil.cli.terminal import TerminalQuestion, show_json, somebody_is_there, tell
from arva_hil.cli.watchers import close_all, live_observers, open_page
from arva_hil.config import Scenario, ScenarioError, parse
from arva_hil.events import Event
from arva_hil.events.searches import SetPointPlanned, WouldOrder
from arva_hil.field.mount import Mount
from arva_hil.field.rotation import from_euler
from arva_hil.links import Link
from arva_hil.links.reconnecting import open_reconnecting
from arva_hil.observers.audience import Audience
from arva_hil.observers.console import Printer
from arva_hil.observers.console.text import Notice
from arva_hil.observers.ground_station import GroundStation
from arva_hil.observers.record.search_log import SearchLog
from arva_hil.observers.web.state import State
from arva_hil.registry import FORMATS, STRATEGIES
from arva_hil.runtime.clock import RealClock
from arva_hil.runtime.loop import run
from arva_hil.search.client import COMPONENT, SearchClient
from arva_hil.search.outcome import SearchStep
from arva_hil.search.permission import Permission, Question
from arva_hil.search.plan import SearchPlan
from arva_hil.search.strips import Strips
from arva_hil.search.team import Teammate, layered
from arva_hil.search.team_tunnel import TeamTunnel
from arva_hil.vehicle.session import Session
from firmware_proto import INNER

if TYPE_CHECKING:
    from arva_hil.cli import search_team

EXIT: Final = {
    "found": OK,
    "not sure": FAILED,
    "not found": FAILED,
    "failed": FAILED,
    "no link": NO_LINK,
    "refused": USAGE,
    "would fly": OK,
}


def plan_of(options: argparse.Namespace, scenario: Scenario | None = None) -> SearchPlan:
    """Of the options; `scenario`: whose receiver `--strip-width auto` means."""
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
        mount=Mount(options.mount[:3], from_euler(*map(math.radians, options.mount[3:]))),
    )


def _strip_width(options: argparse.Namespace, scenario: Scenario | None) -> float:
    """As given, or as wide as a receiver allows. Raises UsageError."""
    given = options.strip_width
    if isinstance(given, float):
        return given
    from arva_hil.range_test.strips import strip_width  # slow to import

    if given != "auto":
        file = {"spec": 2, "transmitters": [{"id": 0, "ned": [0, 0, 0]}], "receiver": {"profile": given}}
        try:
            scenario = parse(json.dumps(file), "--strip-width")
        except ScenarioError as error:
            raise UsageError(*error.problems) from None
    if scenario is None:
        raise UsageError("--strip-width auto: give the receiver's profile, e.g. --strip-width builtin:two_antennas")
    width = strip_width(scenario, options.height, options.max_speed)
    if width is None:
        raise UsageError(f"--strip-width {given}: that receiver hears too little for strips")
    tell(
        f"strips at most {width.metres:.0f} m wide: 1.26 × the range for the weakest transmitter; "
        f"{width.detection:.1%} of simulated flights along such a strip hear it"
    )
    return width.metres


def main(options: argparse.Namespace) -> int:
    team: search_team.Joined | None = None
    if options.scenario:
        from arva_hil.cli import search_team

        if options.vehicle is None:
            return search_team.main(options)
        team = search_team.join(options)
    elif options.vehicle:
        raise UsageError(f"--vehicle {options.vehicle}: one of the vehicles of --scenario FILE, which is missing")
    for name in ("autopilot", "receiver"):
        if getattr(options, name) in (None, "-"):
            example = "arva-hil search --autopilot udpin:127.0.0.1:14540 --receiver /tmp/arva0"
            raise UsageError(f"--{name} is missing, e.g. {example}")
    if options.gcs:
        check_ground_station(options.gcs, options.autopilot, options.receiver)
    plan = layered(plan_of(options), team.member.number) if team else plan_of(options)
    way = f"a part of the area of {team.size}" if team else describe(plan)
    clock, guard = RealClock(), SignalGuard()
    start = clock.now()
    client: SearchClient | None = None
    with ExitStack() as stack:
        key = signing(options.signing_key, clock.epoch_us, stack)
        on_the_ground = partial(open_reconnecting, wanted=lambda: not (client and client.launched))
        autopilot, receiver = (
            stack.enter_context(closing(common.open_or_fail(url, clock, opener, patient=True)))
            for url, opener in ((options.autopilot, on_the_ground), (options.receiver, open_reconnecting))
        )
        log = SearchLog(Path(options.record), start_s=start) if options.record else None
        printer = Printer(sys.stderr)
        printer.say(f"autopilot: {autopilot.name}, receiver: {receiver.name}")
        printer.say(f"strategy {options.strategy}; {way}")
        if options.dry_run:
            printer.say("dry run: nothing is armed, and nothing that moves the vehicle is ordered")
        page = open_page(options.web, lambda: State("search", options.strategy, known=False), printer.say)
        if page:
            stack.callback(lambda: page.close(client.outcome.how if client and client.outcome else "interrupted"))
        planned: list[Event] = []
        live = live_observers(options, None, clock.epoch_us)
        if options.gcs:
            link = common.open_or_fail(options.gcs, clock, open_reconnecting, patient=True)
            live.append(GroundStation(link, lambda: session.vehicle.system if session.vehicle else None, COMPONENT))
            printer.say(f"ground station: {link.name}")
        audience = Audience([printer, *live, *(one for one in (page, log) if one)])

        def emit(event: Event) -> None:
            audience.tell([event])
            if isinstance(event, WouldOrder | SetPointPlanned):
                planned.append(event)

        session = session_of(options, component=COMPONENT, signing=key)
        question = TerminalQuestion(printer.say) if somebody_is_there() else None
        client = client_of(
            options,
            plan,
            (session, autopilot, receiver),
            options.format,
            start=start,
            question=question,
            emit=emit,
            log=rows_to(printer, log),
            team=team.mate if team else None,
            tunnel=team.tunnel if team else None,
        )

        def over() -> bool:
            if guard.caught:
                client.stop()
            return client.outcome is not None

        with guard:
            run([client], clock, stopped=over)
    assert client.outcome is not None
    code = INTERRUPTED if guard.caught else EXIT[client.outcome.kind]
    first, *lines = result(client.outcome)
    printer.notice(Notice("info" if code in (OK, INTERRUPTED) else "error", first))
    if log is not None:
        lines += close_log(log, client.outcome, code, clock.epoch_us + start * 1e6)
        code = code or (FAILED if log.error else OK)
    for line in lines:
        printer.say(line)
    close_all(live, printer.notice)
    printer.close()
    if options.json:
        show_json(as_dict(client.outcome) | ({"would_order": would_order(planned)} if options.dry_run else {}))
    return code


def client_of(
    options: argparse.Namespace,
    plan: SearchPlan,
    vehicle: tuple[Session, Link, Link],
    format_: str,
    *,
    start: float,
    question: Question | None,
    emit: Callable[[Event], None],
    log: Callable[[SearchStep], None],
    team: Teammate | None,
    tunnel: TeamTunnel | None = None,
) -> SearchClient:
    """One search. `vehicle`: its session, its link, and the receiver's, which speaks `format_`."""
    session, autopilot, receiver = vehicle
    kind = FORMATS[format_]
    plan = replace(
        plan,
        land=options.end == "land",
        timeout_s=options.timeout,
        arm_timeout_s=options.arm_timeout,
        take_over=options.take_over,
        countdown_s=options.countdown,
        dry_run=options.dry_run,
    )
    return SearchClient(
        plan,
        session,
        autopilot,
        receiver,
        kind.decoder(),
        start=start,
        permission=Permission(session, yes=options.yes, question=question, dry_run=options.dry_run),
        emit=emit,
        log=log,
        host=getattr(kind, "host", None),
        team=team,
        tunnel=tunnel,
    )


def describe(plan: SearchPlan) -> str:
    """The way before the first signal, in words. Raises UsageError when it is too far for the time there is."""
    lanes = Strips(plan.area, plan.speed, (0.0, 0.0, 0.0), width=plan.strip_width).lanes
    there = math.hypot(*lanes[0])
    way = there + sum(math.dist(a, b) for a, b in pairwise(lanes))
    at = f"at {plan.speed:g} m/s"
    if there > plan.limit_s * plan.speed:
        raise UsageError(f"--area: its nearest corner is {there:.0f} m away, {at} too far for --limit {plan.limit_s:g}")
    less = f", more than the {plan.limit_s:g} s there are" if way > plan.limit_s * plan.speed else ""
    return f"strips of {way:.0f} m until the first signal, {way / plan.speed:.0f} s {at}{less}"


def rows_to(printer: Printer, log: SearchLog | None) -> Callable[[SearchStep], None]:
    """Where the steps of a flight go: the log, and the status line."""

    def take(row: SearchStep) -> None:
        if log is not None:
            log.row(row)
        if row.d_cm is not None:
            direction = "" if row.zone == INNER else f" {row.delta_deg:+d}°"
            d = f"{row.d_cm} cm{direction}" if row.d_cm > 0 else "no signal"
            place = f"{row.north_m:z.1f} m N, {row.east_m:z.1f} m E, {-row.down_m:z.1f} m high"
            printer.show(row.time_s, [d, row.phase, place])

    return take
