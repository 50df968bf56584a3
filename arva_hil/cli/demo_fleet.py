"""`arva-hil demo` with several drones: they divide the area and search it together, all in one process."""

from __future__ import annotations

import argparse
import math
from contextlib import ExitStack
from typing import Final

from arva_hil.cli import common, search_report
from arva_hil.cli.outcome import FAILED, INTERRUPTED, OK, UsageError
from arva_hil.cli.pace import Pace
from arva_hil.cli.search_plan import check_receivers, check_width, plan_of
from arva_hil.cli.terminal import tell
from arva_hil.clock import RealClock, StepClock
from arva_hil.config import Scenario
from arva_hil.events import Event
from arva_hil.events.searches import FromSearch, PlaceFound, SearchEnded, TransmitterChosen
from arva_hil.events.words.sentences import sentence
from arva_hil.events.words.text import Notice
from arva_hil.runtime.loop import run
from arva_hil.search.mission.outcome import Outcome
from arva_hil.simulated.closed_fleet import ClosedFleet, several

_AROUND_S: Final = 120.0  # for take-off and landing
_TOLD: Final = (TransmitterChosen, PlaceFound, SearchEnded)


def fly(options: argparse.Namespace, base: Scenario) -> int:
    """The demo. Raises UsageError for what several drones cannot do."""
    _check(options, base)
    chosen = several(base, options.count or 1)
    check_width(options, len(chosen.vehicles))
    fast = options.speed == math.inf
    clock: RealClock | StepClock = StepClock() if fast else RealClock(options.speed)
    pace = Pace()
    with ExitStack() as stack:
        surroundings = stack.enter_context(
            common.Run(options, chosen, clock.epoch_us, live=not options.headless, kind="demo")
        )

        def emit(name: str, event: Event) -> None:
            if surroundings.page:
                surroundings.page.observe(FromSearch(event.time_s, event, name))
            if isinstance(event, _TOLD) and (said := sentence(event)):
                surroundings.printer.notice(Notice(said.level, f"{name}: {said.text}"))

        loop = ClosedFleet(
            chosen,
            plan_of(options, chosen),
            start=clock.now(),
            observers=surroundings.observers,
            tell_packets=bool(options.record),
            emit=emit,
        )
        code = surroundings.drive(
            loop.emulator,
            lambda: run(
                loop.tasks if fast else [*loop.tasks, pace],
                clock,
                until=options.limit + _AROUND_S,
                stopped=lambda: loop.over or surroundings.stopped(),
            ),
        )
    for drone in loop.drones:
        outcome = drone.search.outcome or Outcome("failed", "interrupted" if code == INTERRUPTED else "it did not end")
        first, *_ = search_report.result(outcome)
        error = loop.error(drone)
        tell(f"{drone.name}: {first}" + ("" if error is None else f"; the transmitter is {error:.2f} m from there"))
    lacking = {transmitter.id for transmitter in chosen.transmitters} - loop.found
    if lacking:
        tell(f"not found: {', '.join(f'transmitter {id_}' for id_ in sorted(lacking))}")
        if code != INTERRUPTED and (complaint := pace.complaint(options.speed)):
            tell(complaint)
    return code or (FAILED if lacking else OK)


def _check(options: argparse.Namespace, base: Scenario) -> None:
    if options.victims != 1:
        raise UsageError("--victims: several drones share the transmitters, one each: leave it out")
    if options.count is not None and base.vehicles and options.count != len(base.vehicles):
        raise UsageError(f"--count {options.count}: {base.source} has {len(base.vehicles)} vehicles: leave it out")
    if base.navigation_error:
        raise UsageError(
            "navigation_error: the demo does not support it, its vehicles report their true poses: leave it out"
        )
    check_receivers(base)
