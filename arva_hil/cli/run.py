"""Emulate the receiver: the autopilot's MAVLink stream in, ARVA frames out."""

from __future__ import annotations

import argparse
import math
import os
from contextlib import ExitStack, closing

from arva_hil.autopilot.session import Session
from arva_hil.cli import options as opt
from arva_hil.cli import shared
from arva_hil.cli.keyfile import signing
from arva_hil.cli.outcome import UsageError
from arva_hil.cli.sides import add_autopilot, check_sides, choose_autopilot
from arva_hil.cli.terminal import tell
from arva_hil.clock import Clock, RealClock
from arva_hil.drivers import Live
from arva_hil.engine import Emulator, one_vehicle
from arva_hil.links import Link, parse
from arva_hil.links.reopen import open_lasting
from arva_hil.links.stdout import StdoutLink
from arva_hil.loop import run
from arva_hil.output import MAVLINK_FORMATS
from arva_hil.watchdog import Watchdog


def add_options(parser: opt.Parser) -> None:
    parser.option(
        "--port",
        type=opt.address,
        metavar="URL",
        help="where frames go: /dev/ttyUSB0[,BAUD], pty[:LINK], udpout:…, tcp:…, -",
    )
    add_autopilot(parser)
    opt.add_scenario(parser)
    opt.add_target(parser)
    opt.add_signing(parser)
    opt.add_max_age(parser)
    opt.add_duration(parser)
    parser.option(
        "--timeout",
        type=opt.number(0.1, math.inf, " of s"),
        default=10.0,
        metavar="S",
        help="give up without a heartbeat for this long; default 10",
    )
    opt.add_common(parser)


def main(options: argparse.Namespace) -> int:
    chosen = shared.scenario(options)
    over_mavlink = chosen.output_format in MAVLINK_FORMATS
    _check(options, chosen.output_format, over_mavlink)
    clock = RealClock()
    address = options.autopilot or choose_autopilot(options.port)
    with ExitStack() as stack:
        session = Session(
            target_system=options.target_system,
            target_component=options.target_component,
            rate_hz=options.stream_rate,
            signing=signing(options.signing_key, clock.epoch_us, stack),
        )
        tell(f"autopilot: {address}")
        links = {"autopilot": stack.enter_context(closing(_open(address, clock, answered=True)))}
        ports: dict[str, Link] = {}
        if not over_mavlink:
            ports["port"] = out = stack.enter_context(closing(_open(options.port, clock)))
            if isinstance(out, StdoutLink):
                out.give_up = lambda: True  # rather drop a frame than be late with the next
            tell(f"frames to: {out.name}")
        surroundings = shared.Run(options, chosen, clock.epoch_us)
        watchdog = Watchdog(os.environ)
        surroundings.observers.append(watchdog)
        start = clock.now()
        emulator = Emulator(
            [one_vehicle(chosen, session)],
            start=start,
            timeout_s=min(options.timeout, options.duration),
            max_age_s=options.max_age,
            tell_packets=bool(options.record),
        )
        live = Live(emulator, links, ports, surroundings.audience)
        until = start + options.duration

        def loop() -> None:
            with closing(watchdog):
                run([live, watchdog], clock, until=until, stopped=surroundings.stopped)

        return surroundings.drive(emulator, loop, shared.LinkTally(live))


def _open(address: str, clock: Clock, *, answered: bool = False) -> Link:
    """A link that comes back when it is lost. A TCP server may be started later; a port that is not there is named."""
    patient = parse(address).kind == "tcp"
    return shared.open_or_fail(address, clock, open_lasting, answered=answered, patient=patient)


def _check(options: argparse.Namespace, format: str, over_mavlink: bool) -> None:
    if not over_mavlink and not options.port:
        raise UsageError(
            "--port is missing: where do the frames go? e.g. --port /dev/ttyUSB0, --port pty, "
            "or --format tunnel to send them inside MAVLink"
        )
    if options.json and options.port == "-":
        raise UsageError("--json and --port - both want stdout: choose one")
    check_sides(options.autopilot, options.port, format)
