"""`arva-hil demo`: flies the closed loop, on pseudo-terminals or in memory at full speed."""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import re
import stat
import tempfile
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Final

from arva_hil.cli import common, search_report
from arva_hil.cli.outcome import FAILED, INTERRUPTED, NO_LINK, OK, Failure, UsageError
from arva_hil.cli.pace import Pace
from arva_hil.cli.search_plan import plan_of
from arva_hil.cli.search_report import PICTURE
from arva_hil.cli.terminal import tell
from arva_hil.cli.victims_report import name as name_of
from arva_hil.clock import Clock, RealClock, StepClock, utc
from arva_hil.config import Scenario
from arva_hil.links import LinkError, memory
from arva_hil.links.pty import PtyLink
from arva_hil.observers.web.address import HostPort
from arva_hil.records.writing.layout import FILES
from arva_hil.records.writing.search_log import SEARCH_FILES, SearchLog, refuse_search
from arva_hil.registry import MAVLINK_FORMATS
from arva_hil.runtime.loop import run
from arva_hil.search.mission.outcome import Outcome
from arva_hil.simulated.closed_loop import ClosedLoop, Ends

KEPT_DAYS: Final = 7
_PREFIX: Final = "arva-demo-"
_DAY_S: Final = 86400
_OURS: Final = {*FILES, *SEARCH_FILES, PICTURE}


def new_folder() -> Path:
    """Make a folder, named by the time. Removes folders of earlier demos that were not changed for some days."""
    now_us = RealClock().epoch_us
    for name in _old(now_us / 1e6 - KEPT_DAYS * _DAY_S):
        with contextlib.suppress(OSError):
            _remove(name)
    stamp = re.sub(r"\.\d+|[^0-9T]", "", utc(now_us))
    return Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{stamp}-"))


def _old(before_s: float) -> list[str]:
    """Folders of demos that were last changed before `before_s`, seconds since 1970."""
    found = []
    with contextlib.suppress(OSError), os.scandir(tempfile.gettempdir()) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):
                if entry.name.startswith(_PREFIX) and entry.stat(follow_symlinks=False).st_mtime < before_s:
                    found.append(entry.path)
    return found


def _remove(path: str) -> None:
    """Remove a demo's folder and the files in it. Keeps all of it if the folder contains anything else.

    The folder is open meanwhile, so that nothing is removed through a symlink that another user puts in its place.
    """
    if os.unlink not in os.supports_dir_fd:
        return
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        status = os.fstat(folder)
        names = set(os.listdir(folder))
        if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid() or not names <= _OURS:
            return
        for name in names:
            os.unlink(name, dir_fd=folder)
    finally:
        os.close(folder)
    os.rmdir(path)


_AROUND_S: Final = 120.0  # for take-off and landing


def main(options: argparse.Namespace) -> int:
    chosen = common.scenario(options, fleet=True)
    if options.web is None and not options.headless:
        options.web = HostPort()
    if chosen.vehicles or options.count is not None:
        from arva_hil.cli.demo_fleet import fly

        return fly(options, chosen)
    if chosen.output_format in MAVLINK_FORMATS:
        raise UsageError(f"--format {chosen.output_format}: the demo has a port: choose binary, nmea or text")
    if chosen.navigation_error:
        raise UsageError(
            "navigation_error: the demo does not support it, its vehicle reports its true pose: leave it out"
        )
    if not options.record:
        options.record = str(new_folder())
        tell(f"record: {options.record}, kept for {KEPT_DAYS} days; --record DIR keeps it elsewhere")
    check_victims(options, chosen)
    refuse_search(Path(options.record))  # before the emulator begins its record in this folder
    fast = options.speed == math.inf
    clock: RealClock | StepClock = StepClock() if fast else RealClock(options.speed)
    pace = Pace()
    with ExitStack() as stack:
        autopilot, port = (memory.pair(), memory.pair()) if fast else _ptys(stack, clock)
        surroundings = stack.enter_context(
            common.Run(options, chosen, clock.epoch_us, live=not options.headless, kind="demo")
        )
        log = SearchLog(Path(options.record))
        start = clock.now()
        loop = ClosedLoop(
            chosen,
            plan_of(options, chosen),
            autopilot=autopilot,
            commands=memory.pair(),
            port=port,
            start=start,
            observers=surroundings.observers,
            tell_packets=True,
            log=log.row,
        )
        if not fast:
            surroundings.printer.say(f"vehicle at {autopilot[0].name}, frames at {port[0].name}")
        code = surroundings.drive(
            loop.emulator,
            lambda: run(
                loop.tasks if fast else [*loop.tasks, pace],
                clock,
                until=options.limit + _AROUND_S,
                stopped=lambda: loop.search.outcome is not None or surroundings.stopped(),
            ),
        )
    outcome = loop.search.outcome
    if outcome is None:
        outcome = Outcome("failed", "interrupted" if code == INTERRUPTED else "it did not end")
    elif outcome.kind != "found":
        code = code or FAILED
    lines = search_report.result(outcome) + _errors(loop, clock.now())
    if code not in (OK, INTERRUPTED) and (complaint := pace.complaint(options.speed)):
        lines.append(complaint)
    if surroundings.page:
        lines.append(f"to see it again: arva-hil view {options.record}")
    truth = loop.truth() if loop.search.origin else {}
    for line in lines + search_report.close_log(log, outcome, code, clock.epoch_us + start * 1e6, truth):
        tell(line)
    return code


def check_victims(options: argparse.Namespace, chosen: Scenario) -> None:
    """Raise UsageError when more are searched for than there are."""
    count = len(chosen.transmitters)
    if options.victims != "all" and options.victims > count:
        there = "is one transmitter" if count == 1 else f"are {count} transmitters"
        raise UsageError(f"--victims {options.victims}: there {there} in {chosen.source or 'the scenario'}")


def _errors(loop: ClosedLoop, now: float) -> list[str]:
    """The errors of the search against the simulator's truth, in words."""
    if loop.several:
        return [f"{name_of(victim.id)} is {metres:.2f} m from there" for victim, metres in loop.errors().items()]
    error, off = loop.error(), loop.off(now)
    if error is None or off is None:
        return []
    return [f"the transmitter is {error:.2f} m from there", f"the vehicle has landed {off:.2f} m from it"]


def _ptys(stack: ExitStack, clock: Clock) -> tuple[Ends, Ends]:
    """The autopilot's link and the receiver's: each a pseudo-terminal and a serial link opened on it."""
    try:
        vehicle, receiver = (stack.enter_context(closing(PtyLink())) for _ in range(2))
    except LinkError as error:
        raise Failure(NO_LINK, f"{error}, or demo --speed max, which needs none") from None
    autopilot, port = (stack.enter_context(closing(common.open_or_fail(p.path, clock))) for p in (vehicle, receiver))
    return (autopilot, vehicle), (port, receiver)
