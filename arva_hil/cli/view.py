"""`arva-hil view`: serves a record as the page until it is stopped."""

from __future__ import annotations

import argparse
import math
import os
import tempfile
from collections.abc import Mapping
from contextlib import ExitStack

from arva_hil.cli import replay
from arva_hil.cli.arguments import parser_of
from arva_hil.cli.arguments.shared import OFF
from arva_hil.cli.outcome import INTERRUPTED, OK, SignalGuard, UsageError, interrupting
from arva_hil.cli.recorded import loaded, output
from arva_hil.cli.terminal import tell
from arva_hil.cli.watchers import background_of, said_of_page
from arva_hil.clock import RealClock
from arva_hil.observers.web.address import HostPort
from arva_hil.observers.web.offline import offline_page
from arva_hil.observers.web.server import Server
from arva_hil.observers.web.viewer import RecordedState
from arva_hil.records.reading import Recording


def main(options: argparse.Namespace) -> int:
    _check(options)
    guard, clock = SignalGuard(), RealClock()
    with guard, ExitStack() as stack:
        if (recording := _recording(options, stack)) is None:
            return INTERRUPTED
        state = RecordedState(recording, background_of(options.map, recording.scenario))
        if options.out:
            with output(options.out, recording) as out:
                page = offline_page(state)
                out.write(page)
            tell(f"{options.out}: {len(page) / 1e6:.1f} MB, needs neither arva-hil nor a network")
            return OK
        wanted = options.web if isinstance(options.web, HostPort) else HostPort()
        server = serve(wanted, state)
        stack.callback(server.close)
        tell(*said_of_page(server.address, wanted))
        first, last = recording.span_s
        tell(f"{recording.title}: {last - first:.0f} s; Ctrl-C ends")
        while not (guard.caught or guard.error) and clock.now() < options.duration:
            clock.wait(min(clock.now() + 0.1, options.duration))
    return INTERRUPTED if guard.caught else OK


def _check(options: argparse.Namespace) -> None:
    """Refuse options that do not fit together. A typed page is stronger than a file in the environment."""
    if options.out and any(name in options.typed and getattr(options, name) != OFF for name in ("web", "duration")):
        if "out" in options.typed:
            raise UsageError("--out: the command writes the file and ends: leave out --web and --duration")
        options.out = None
    if options.web == OFF and "web" in options.typed and not options.out:
        raise UsageError("--web off: this command serves the page: leave it out, or name a file with --out FILE")


def _recording(options: argparse.Namespace, stack: ExitStack) -> Recording | None:
    """Return the record in a folder, or of a log that is replayed first; None after a signal."""
    name: str = options.record_or_log
    if os.path.isfile(name):
        replay.refuse_log(options.out or "", name)
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="arva-view-"))
        name = os.path.join(folder, os.path.basename(options.record_or_log))
        chosen = ["--scenario", options.scenario] if options.scenario else []
        code = replay.main(parser_of("replay").parse([options.record_or_log, "--record", name, *chosen], {}))
        if code == INTERRUPTED:
            return None
        if code != OK:
            raise UsageError(f"{options.record_or_log}: cannot be replayed")
    elif options.scenario:
        raise UsageError("--scenario: a record has its own: it is for a log, LOG.tlog")
    with interrupting():  # it may be long
        return loaded(name)


def serve(address: HostPort, state: RecordedState) -> Server:
    """Return the page of a record; every request has its time. Raises WebError."""

    def state_json(query: Mapping[str, str], client: int) -> bytes:
        since = query.get("since", "")
        state.show(_seconds(query.get("at", "")))
        return state.document(int(since) if since.isdecimal() and len(since) < 16 else 0)

    return Server(
        address,
        {
            "/state.json": state_json,
            "/field.json": lambda query, client: state.field(),
            "/timeline.json": lambda query, client: state.time_line(),
            "/background.png": lambda query, client: state.background(),
        },
    )


def _seconds(text: str) -> float:
    """Return the time in a request; the end of the record for an invalid one."""
    try:
        return float(text)
    except ValueError:
        return math.inf
