"""`arva-hil demo`: flies the closed loop of one drone or several, on pseudo-terminals or in memory at full speed."""

from __future__ import annotations

import argparse
import math
import os
import re
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from arva_hil.cli import common
from arva_hil.cli.outcome import FAILED, INTERRUPTED, NO_LINK, OK, Failure, UsageError
from arva_hil.cli.search_plan import check_receivers, check_width, plan_of, tell_ropes
from arva_hil.cli.search_report import close_log, result
from arva_hil.cli.search_report import name as name_of
from arva_hil.cli.terminal import tell
from arva_hil.clock import Clock, RealClock, StepClock, Waitable, utc
from arva_hil.config import Scenario
from arva_hil.events.reasons import Why, because
from arva_hil.events.words.text import in_metres
from arva_hil.links import LinkError, memory
from arva_hil.links.pty import PtyLink
from arva_hil.observers.web.address import HostPort
from arva_hil.records.writing.search_log import SearchLog, refuse_search
from arva_hil.registry import over_mavlink
from arva_hil.runtime.loop import run
from arva_hil.search.mission.outcome import Outcome
from arva_hil.simulated.closed_loop import ClosedLoop, Drone, Wires, several

_EVERY_S: Final = 0.1
_BEHIND_S: Final = 0.5  # less changes nothing in a flight


class Pace:
    """A task of the loop that remembers `worst_s`, the largest delay of the loop against its clock.

    `start`: of the loop, s on its clock.
    """

    links: Sequence[Waitable] = ()

    def __init__(self, start: float) -> None:
        self.worst_s = 0.0
        self._due = start

    def service(self, clock: Clock) -> float:
        now = clock.now()
        self.worst_s = max(self.worst_s, now - self._due)
        self._due = now + _EVERY_S
        return self._due

    def complaint(self, speed: float) -> str:
        """Return a warning for a flight at `speed` times real time; "" if there is none."""
        if self.worst_s < _BEHIND_S:
            return ""
        what = "real time" if speed == 1 else f"--speed {speed:g}"
        cure = "a lower --speed, or --speed max, which waits for nothing" if speed > 1 else "--speed max"
        return (
            f"this computer was too slow for {what}: up to {self.worst_s:.1f} s of the flight behind, which may be why "
            f"the search failed: choose {cure}"
        )


_AROUND_S: Final = 120.0  # for take-off and landing


def main(options: argparse.Namespace) -> int:
    chosen = common.scenario(options)
    if options.web is None and not options.headless:
        options.web = HostPort()
    team = bool(chosen.vehicles) or options.count is not None
    chosen = _team(options, chosen) if team else _alone(options, chosen)
    flown = _fly(options, chosen, team=team)
    return _end_of_team(flown) if team else _end_alone(options, flown)


@dataclass(frozen=True)
class Flown:
    """A demo at its end. `start`: on the clock, s; `complaint`: this computer was too slow; "" if it was not."""

    loop: ClosedLoop
    clock: RealClock | StepClock
    start: float
    log: SearchLog | None
    code: int
    complaint: str
    has_page: bool


def _fly(options: argparse.Namespace, chosen: Scenario, *, team: bool) -> Flown:
    plan = plan_of(options, chosen)
    tell_ropes(chosen)
    fast = options.speed == math.inf
    clock: RealClock | StepClock = StepClock() if fast else RealClock(options.speed)
    with ExitStack() as stack:
        if not team and not options.record:
            options.record = _temporary(stack)
        wires = None if fast or team else [_ptys(stack, clock)]
        surroundings = stack.enter_context(
            common.Run(options, chosen, clock.epoch_us, live=not options.headless, kind="demo")
        )
        log = None if team else SearchLog(Path(options.record))
        start = clock.now()
        loop = ClosedLoop(
            chosen,
            plan,
            start=start,
            gps_noise_m=options.gps_noise,
            wires=wires,
            mounts_known=options.mount is None,
            observers=surroundings.observers,
            tell_packets=bool(options.record or surroundings.page),
            log=log.row if log else None,
        )
        surroundings.printer.say(
            *(f"vehicle at {one.autopilot[0].name}, frames at {one.port[0].name}" for one in wires or ())
        )
        pace = Pace(clock.now())
        code = surroundings.drive(
            loop.emulator,
            lambda: run(
                loop.tasks if fast else [*loop.tasks, pace],
                clock,
                until=options.limit + _AROUND_S,
                stopped=lambda: loop.over or surroundings.stopped(),
            ),
        )
    return Flown(loop, clock, start, log, code, pace.complaint(options.speed), surroundings.page is not None)


def _temporary(stack: ExitStack) -> str:
    """Make a folder for the record. It is removed at the end if it is empty: the demo could not begin."""
    stamp = re.sub(r"\.\d+|[^0-9T]", "", utc(RealClock().epoch_us))
    folder = tempfile.mkdtemp(prefix=f"arva-demo-{stamp}-")
    tell(f"record: {folder}; --record DIR keeps it elsewhere")

    def remove() -> None:
        with suppress(OSError):
            os.rmdir(folder)

    stack.callback(remove)
    return folder


def _alone(options: argparse.Namespace, chosen: Scenario) -> Scenario:
    """Check the scenario of one drone, and the folder of its record. Raises UsageError."""
    if over_mavlink(chosen.output_format):
        raise UsageError(f"--format {chosen.output_format}: the demo has a port: choose binary, nmea or text")
    _check_pose(chosen, "its vehicle reports its true pose")
    count = len(chosen.transmitters)
    if options.victims != "all" and options.victims > count:
        there = "is one transmitter" if count == 1 else f"are {count} transmitters"
        raise UsageError(f"--victims {options.victims}: there {there} in {chosen.source or 'the scenario'}")
    if options.record:
        refuse_search(Path(options.record))  # before the emulator begins its record in this folder
    return chosen


def _team(options: argparse.Namespace, base: Scenario) -> Scenario:
    """Return the scenario of several drones. Raises UsageError for options that they do not support."""
    if options.victims != 1:
        raise UsageError("--victims: several drones share the transmitters, one each: leave it out")
    if options.count is not None and base.vehicles and options.count != len(base.vehicles):
        raise UsageError(f"--count {options.count}: {base.source} has {len(base.vehicles)} vehicles: leave it out")
    _check_pose(base, "its vehicles report their true poses")
    check_receivers(base)
    chosen = several(base, options.count or 1)
    check_width(options, len(chosen.vehicles))
    return chosen


def _check_pose(chosen: Scenario, why: str) -> None:
    if chosen.navigation_error:
        raise UsageError(f"navigation_error: the demo does not support it, {why}: use --gps-noise instead")


def _outcome(drone: Drone, code: int) -> Outcome:
    return drone.search.outcome or Outcome("failed", (because(Why.INTERRUPTED if code == INTERRUPTED else Why.NO_END),))


def _end_alone(options: argparse.Namespace, flown: Flown) -> int:
    """Print the end of the search, and close its log. Returns the exit code."""
    (drone,), code, log = flown.loop.drones, flown.code, flown.log
    assert log is not None
    outcome = _outcome(drone, code)
    if outcome.kind != "found":
        code = code or FAILED
    lines = result(outcome) + _errors(drone, flown.clock.now())
    if outcome.found and not options.gps_noise:
        lines.append("the GPS of this flight had no error; --gps-noise 1.5 flies with one")
    if code not in (OK, INTERRUPTED) and flown.complaint:
        lines.append(flown.complaint)
    if flown.has_page:
        lines.append(f"to see it again: arva-hil view {options.record}")
    tell(*lines, *close_log(log, outcome, code, flown.clock.epoch_us + flown.start * 1e6))
    return code


def _end_of_team(flown: Flown) -> int:
    """Print the end of each search, and the transmitters that were not found. Returns the exit code."""
    loop, code = flown.loop, flown.code
    for drone in loop.drones:
        first, *_ = result(_outcome(drone, code))
        error = drone.error()
        tell(f"{drone.name}: {first}" + ("" if error is None else f"; error: {in_metres(error)}"))
    lacking = {transmitter.id for transmitter in loop.drones[0].scenario.transmitters} - loop.found
    if lacking:
        tell(f"not found: {', '.join(f'transmitter {id_}' for id_ in sorted(lacking))}")
        if code != INTERRUPTED and flown.complaint:
            tell(flown.complaint)
    return code or (FAILED if lacking else OK)


def _errors(drone: Drone, now: float) -> list[str]:
    """Return the lines about the errors of the search, against the simulator's truth."""
    if drone.several:
        return [f"error of {name_of(victim.id)}: {in_metres(metres)}" for victim, metres in drone.errors().items()]
    error, off = drone.error(), drone.off(now)
    if error is None or off is None:
        return []
    return [f"error of the place: {in_metres(error)}", f"error of the landing: {in_metres(off)}"]


def _ptys(stack: ExitStack, clock: Clock) -> Wires:
    """Make the links of autopilot and receiver: each is a pseudo-terminal with a serial link open on it."""
    try:
        vehicle, receiver = (stack.enter_context(closing(PtyLink())) for _ in range(2))
    except LinkError as error:
        raise Failure(NO_LINK, f"{error}, or demo --speed max, which needs none") from None
    autopilot, port = (stack.enter_context(closing(common.open_or_fail(p.path, clock))) for p in (vehicle, receiver))
    return Wires((autopilot, vehicle), memory.pair(), (port, receiver))
