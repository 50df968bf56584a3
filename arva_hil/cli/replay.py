"""Replay a recorded flight through the emulator: same log, scenario and seed give the same bytes."""

from __future__ import annotations

import argparse
import itertools
import math
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing

from arva_hil.autopilot.session import Session
from arva_hil.cli import options as opt
from arva_hil.cli import shared
from arva_hil.cli.outcome import UsageError
from arva_hil.cli.terminal import tell
from arva_hil.clock import RealClock
from arva_hil.emulator import Emulator
from arva_hil.links import Link, LinkError
from arva_hil.links.stdout import StdoutLink
from arva_hil.links.tlog import Record, TlogReader, read_tlog
from arva_hil.loop import replay
from arva_hil.output import MAVLINK_FORMATS, MavlinkPort, Port, WirePort

_BAR_STEP_BYTES = 1 << 16


def add_options(parser: opt.Parser) -> None:
    parser.add_argument("log", metavar="LOG.tlog", help="MAVLink telemetry log")
    parser.option(
        "--port",
        type=opt.address,
        metavar="URL",
        help="send the frames there, in the log's rhythm unless --speed says else",
    )
    parser.option("--out", metavar="FILE", help="write the frames to a file; - is stdout")
    parser.option("--speed", type=opt.speed, metavar="N|max", help="times real time; default 1 with --port, else max")
    opt.add_scenario(parser)
    opt.add_target(parser)
    opt.add_max_age(parser)
    opt.add_common(parser)


def main(options: argparse.Namespace) -> int:
    if not options.log:
        raise UsageError("the log's name is empty: write LOG.tlog")
    if options.port and options.out:
        raise UsageError("--port and --out: choose one")
    if options.json and "-" in (options.out, options.port):
        raise UsageError("--json and the frames both want stdout: choose one")
    chosen = shared.scenario(options)
    session = Session(target_system=options.target_system, target_component=options.target_component, passive=True)
    with ExitStack() as stack:
        try:
            log = stack.enter_context(closing(read_tlog(options.log)))
        except LinkError as error:
            raise UsageError(error) from None
        out = stack.enter_context(closing(_out(options, stack)))
        first = next(log, None)
        if first is None:
            raise UsageError(f"{options.log}: no MAVLink packet in its {log.size} bytes: is it a telemetry log?")
        surroundings = shared.Run(
            options,
            chosen,
            first.time_us,
            patient=True,
            lines=not (options.port or options.out or options.record),
        )
        if isinstance(out, StdoutLink):
            out.give_up = surroundings.stopped
        port: Port
        if chosen.output_format in MAVLINK_FORMATS:
            port = MavlinkPort(out, session, chosen.output_format)
        else:
            port = WirePort(out, chosen.output_format)
        emulator = Emulator(
            chosen,
            session,
            None,
            port,
            start=0.0,
            max_age_s=options.max_age,
            observers=surroundings.observers,
        )
        speed = options.speed or (1.0 if options.port else math.inf)
        clock = None if speed == math.inf else RealClock(speed)
        records = _progress(log, first)
        code = surroundings.drive(
            emulator, lambda: replay(emulator, records, clock=clock, stopped=surroundings.stopped)
        )
        if log.skipped or log.torn:
            tell(f"{options.log}: {log.skipped} bytes of garbage and {log.torn} of a torn tail")
        return code


def _out(options: argparse.Namespace, stack: ExitStack) -> Link:
    """Where frames go: a port, a file, stdout, or nowhere but into the record or the lines on stdout."""
    if options.port or options.out == "-":
        return shared.open_or_fail(options.port or "-", RealClock())
    path = options.out or os.devnull
    if os.path.exists(path) and os.path.samefile(path, options.log):
        raise UsageError(f"--out {path}: is the log itself: name another file")
    try:
        return StdoutLink(stack.enter_context(open(path, "wb", buffering=0)), path)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror}") from None


def _progress(log: TlogReader, first: Record) -> Iterator[Record]:
    """The log's records, with a progress bar on a terminal."""
    if not sys.stderr.isatty():
        yield from itertools.chain([first], log)
        return
    from tqdm import tqdm  # slow to import

    with tqdm(total=log.size, unit="B", unit_scale=True, leave=False) as bar:
        shown = 0
        for record in itertools.chain([first], log):
            if log.consumed - shown > _BAR_STEP_BYTES:
                bar.update(log.consumed - shown)
                shown = log.consumed
            yield record
