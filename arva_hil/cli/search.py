"""`arva-hil search`: flies one vehicle by one receiver, and says how it ended."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from arva_hil.cli import common
from arva_hil.cli.outcome import FAILED, INTERRUPTED, OK, SignalGuard, UsageError
from arva_hil.cli.run_links import check_ground_station, signing
from arva_hil.cli.run_links import session as session_of
from arva_hil.cli.search_plan import client_of, describe, plan_of
from arva_hil.cli.search_report import EXIT, as_dict, close_log, result, would_order
from arva_hil.cli.terminal import TerminalQuestion, show_json, somebody_is_there
from arva_hil.cli.watchers import close_all, live_observers, open_page
from arva_hil.clock import RealClock
from arva_hil.events import Event
from arva_hil.events.searches import SetPointPlanned, WouldOrder
from arva_hil.events.words.text import Notice
from arva_hil.links.reconnecting import open_reconnecting
from arva_hil.observers.console import Printer
from arva_hil.observers.ground_station import GroundStation
from arva_hil.observers.web.state import State
from arva_hil.records.writing.search_log import SearchLog
from arva_hil.runtime.audience import Audience
from arva_hil.runtime.loop import run
from arva_hil.search.flight.client import COMPONENT, SearchClient
from arva_hil.search.mission.outcome import SearchStep
from arva_hil.search.strategies.strategy_process import StrategyProcess
from firmware_proto import INNER

if TYPE_CHECKING:
    from arva_hil.cli import search_team


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
    plan = team.mate.layered(plan_of(options)) if team else plan_of(options)
    way = f"a part of the area of {team.size}" if team else describe(plan)
    clock, guard = RealClock(), SignalGuard()
    start = clock.now()
    client: SearchClient | None = None
    with ExitStack() as stack:
        worker = stack.enter_context(closing(StrategyProcess(partial(plan.strategy, plan.speed))))
        stack.enter_context(common.run_first())
        key = signing(options.signing_key, clock.epoch_us, stack)
        on_the_ground = partial(open_reconnecting, wanted=lambda: not (client and client.launched))
        autopilot, receiver = (
            stack.enter_context(closing(common.open_or_fail(url, clock, opener, patient=True)))
            for url, opener in ((options.autopilot, on_the_ground), (options.receiver, open_reconnecting))
        )
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
        stack.enter_context(guard)  # what is begun from here on is closed below
        log = SearchLog(Path(options.record), start_s=start) if options.record else None
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
            worker=worker,
        )

        def over() -> bool:
            if guard.caught:
                client.stop()
            return client.outcome is not None

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


def rows_to(printer: Printer, log: SearchLog | None) -> Callable[[SearchStep], None]:
    """Return the receiver of a flight's steps: the log and the status line."""

    def take(row: SearchStep) -> None:
        if log is not None:
            log.row(row)
        if row.d_cm is not None:
            direction = "" if row.zone == INNER else f" {row.delta_deg:+d}°"
            d = f"{row.d_cm} cm{direction}" if row.d_cm > 0 else "no signal"
            place = f"{row.north_m:z.1f} m N, {row.east_m:z.1f} m E, {-row.down_m:z.1f} m high"
            printer.show(row.time_s, [d, row.phase, place])

    return take
