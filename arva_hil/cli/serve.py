"""`arva-hil serve`: a bench for programs in any language."""

from __future__ import annotations

import argparse
from contextlib import closing

from arva_hil.cli.options import CommandParser


def options(parser: CommandParser) -> None:
    """Run an emulated receiver and its vehicle for your tests, controlled by JSON lines.

    Prints one line {"control": …, "port": …}: the addresses of the control port and of the frames.
    Each request is a line, e.g. {"do": "advance", "seconds": 30}; so is each answer.
    """
    parser.option(
        "--control ADDRESS",
        "tcp:127.0.0.1:PORT, with 0 for a free port, or unix:PATH",
        default="tcp:127.0.0.1:0",
    )
    parser.option("--scenario FILE", "scenario (YAML), or builtin:NAME; default: one transmitter 20 m N, 5 m E of home")
    parser.option("--port URL", "port for the frames: pty, tcp, udp or a connection string", default="pty")
    parser.option("--real-time", "frames come in real time; without it time passes in `advance` alone")


def main(options: argparse.Namespace) -> int:
    from arva_hil.bench.bench import Bench
    from arva_hil.bench.control import ControlServer
    from arva_hil.cli import common
    from arva_hil.cli.outcome import INTERRUPTED, OK
    from arva_hil.cli.terminal import show_json
    from arva_hil.clock import RealClock

    with (
        Bench(options.scenario, port=options.port, clock="real" if options.real_time else "virtual") as bench,
        closing(ControlServer(bench, options.control)) as server,
    ):
        show_json({"control": server.address, "port": bench.port})
        interrupted = common.attend([server], RealClock(), over=lambda: server.stopped)
    return INTERRUPTED if interrupted else OK
