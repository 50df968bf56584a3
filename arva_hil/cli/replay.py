"""`arva-hil replay`: feeds a recorded flight to the engine."""

from __future__ import annotations

import argparse
import itertools
import math
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing

from arva_hil.cli import common
from arva_hil.cli.outcome import NotWritten, UsageError
from arva_hil.cli.terminal import bar, tell
from arva_hil.clock import RealClock
from arva_hil.config import Scenario
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import VehicleSetup, receivers_of
from arva_hil.events import LogClockSet, LogLayout
from arva_hil.links import Link, LinkError, parse
from arva_hil.links.stdout import StdoutLink
from arva_hil.links.tlog import BIG, TlogReader
from arva_hil.links.tlog_timeline import Record, Timeline
from arva_hil.runtime.audience import Audience
from arva_hil.runtime.drivers import LOOK_AHEAD_S, replay
from arva_hil.runtime.fleet_links import vehicles_in_log

_BAR_STEP_BYTES = 1 << 16


def main(options: argparse.Namespace) -> int:
    _check(options)
    chosen = common.scenario(options)
    vehicles = _vehicles(options, chosen)
    with ExitStack() as stack:
        try:
            log = stack.enter_context(closing(TlogReader(options.log)))
        except LinkError as error:
            raise UsageError(error) from None
        out = stack.enter_context(closing(_out(options, stack)))
        tally = _Tally(log)
        timeline = tally.timeline
        if (first := next(timeline, None)) is None:
            raise UsageError(f"{options.log}: no MAVLink packet in its {log.size} bytes: is it a telemetry log?")
        lines = not (options.port or options.out or options.record)
        surroundings = stack.enter_context(
            common.Run(options, chosen, first.time_us, patient=True, kind="replay", lines=lines)
        )
        if isinstance(out, StdoutLink):
            out.give_up = surroundings.stopped
        emulator = Emulator(
            vehicles,
            start=0.0,
            max_age_s=options.max_age,
            look_ahead_s=LOOK_AHEAD_S,
            tell_packets=bool(options.record or surroundings.page),
        )
        speed = options.speed or (1.0 if options.port else math.inf)
        clock = None if speed == math.inf else RealClock(speed)
        tally.begin(surroundings.audience)
        records: Iterator[Record] = itertools.chain([first], timeline)
        if sys.stderr.isatty():
            records = _progress(log, records)

        def loop() -> None:
            replay(
                emulator,
                records,
                "autopilot",
                lambda output: out.write(output.data),
                surroundings.audience,
                clock=clock,
                stopped=surroundings.stopped,
            )

        return surroundings.drive(emulator, loop, tally.counts, tally.summary_lines)


def _check(options: argparse.Namespace) -> None:
    if not options.log:
        raise UsageError("the log's name is empty: write LOG.tlog")
    if options.port and options.out:
        raise UsageError("--port and --out: choose one")
    if options.port and parse(options.port).kind == "tlog":
        raise UsageError(f"--port {options.port}: this is a log: frames cannot be sent there; --out writes a file")
    if options.json and "-" in (options.out, options.port):
        raise UsageError("--json and the frames both go to stdout: choose one")


def _vehicles(options: argparse.Namespace, chosen: Scenario) -> list[VehicleSetup]:
    """Return the vehicles in the log. Raises UsageError if the scenario's have the same ids."""
    if chosen.vehicles:
        from arva_hil.cli.run_links import refuse_own  # with all kinds of links, which a replay does not need

        refuse_own(options, chosen)
        receivers = len(receivers_of(chosen))
        if options.out and receivers > 1:
            raise UsageError(
                f"--out {options.out}: {chosen.source} has {receivers} receivers: "
                "--record DIR writes the frames of each into a file of its own"
            )
    try:
        vehicles = vehicles_in_log(chosen, options.log, options.target_system, options.target_component)
    except ValueError as error:
        raise UsageError(error) from None
    if chosen.vehicles:
        tell(
            f"searching {options.log} for all vehicles of {chosen.source}; the ports of their receivers are not opened"
        )
    return vehicles


class _Tally:
    """Counts the bytes and clock steps of a log, and reports its clock steps as events."""

    def __init__(self, log: TlogReader) -> None:
        self.timeline = Timeline(
            log, stamped=log.stamped, tell=lambda: self._audience.emit([LogClockSet(0.0, log.path)])
        )
        self._log = log
        self._audience = Audience([])

    def begin(self, audience: Audience) -> None:
        """Report to `audience` from now on; first an unusual layout of the log."""
        self._audience = audience
        if not self._log.stamped or self._log.layout != BIG.name:
            audience.emit([LogLayout(0.0, self._log.path, self._log.layout if self._log.stamped else "")])

    def counts(self) -> dict[str, int]:
        return {
            "log_clock_steps": self.timeline.steps,
            "log_stray_times": self.timeline.strays,
            "log_garbage_bytes": self._log.skipped,
            "log_torn_bytes": self._log.torn,
        }

    def summary_lines(self) -> list[str]:
        lines = []
        if steps := self.timeline.steps + self.timeline.strays:
            lines.append(f"{self._log.path}: its clock was set {steps} ×")
        if self._log.skipped or self._log.torn:
            lines.append(
                f"{self._log.path}: {self._log.skipped} bytes of garbage, {self._log.torn} of an incomplete last record"
            )
        return lines


def _out(options: argparse.Namespace, stack: ExitStack) -> Link:
    """Open the link for frames: a port, a file or stdout; without --port and --out they are discarded."""
    if options.port or options.out == "-":
        return common.open_or_fail(options.port or "-", RealClock())
    path = options.out or os.devnull
    refuse_log(path, options.log)
    try:
        return StdoutLink(stack.enter_context(open(path, "wb", buffering=0)), path)
    except OSError as error:
        raise NotWritten(path, error) from None


def refuse_log(out: str, log: str) -> None:
    """Raise UsageError if the output would replace the log."""
    if os.path.exists(out) and os.path.samefile(out, log):
        raise UsageError(f"--out {out}: this is the log itself: name another file")


def _progress(log: TlogReader, records: Iterator[Record]) -> Iterator[Record]:
    """Yield the log's records, with a progress bar."""
    with bar(log.size, "B", scaled=True) as shown_bar:
        shown = 0
        for record in records:
            if log.consumed - shown > _BAR_STEP_BYTES:
                shown_bar.update(log.consumed - shown)
                shown = log.consumed
            yield record
