"""`arva-hil serve`: a bench for programs in any language."""

from __future__ import annotations

import argparse
from contextlib import closing

from arva_hil.bench.bench import Bench
from arva_hil.bench.control import ControlServer
from arva_hil.cli import common
from arva_hil.cli.outcome import INTERRUPTED, NO_LINK, OK, Failure
from arva_hil.cli.terminal import show_json
from arva_hil.clock import RealClock
from arva_hil.links import LinkError


def main(options: argparse.Namespace) -> int:
    try:
        bench = Bench(options.scenario, port=options.port, clock="real" if options.real_time else "virtual")
    except LinkError as error:
        raise Failure(NO_LINK, error) from None
    with bench, closing(ControlServer(bench, options.control)) as server:
        show_json({"control": server.address, "port": bench.port})
        interrupted = common.attend([server], RealClock(), over=lambda: server.stopped)
    return INTERRUPTED if interrupted else OK
