"""Search for the victim: reads the receiver's port, flies the autopilot, stops above the transmitter.

The vehicle arms, takes off, searches and lands by itself. The pilot takes it back with the mode switch, or by moving a
stick, at any time: the search then says nothing more to it. Ctrl-C leaves it hovering; a landing goes on.
A receiver that is unplugged is looked for while it hovers. The autopilot's link is looked for before anything is armed;
lost later, it leaves the vehicle to its own failsafe.
A simulator says what it is when asked. Any other vehicle is armed only when somebody at the terminal types yes, or on
--yes; without either the search ends with 2. On the bench: take the propellers off.
Exit codes: 0 found, 1 not sure, not found or failed, 2 usage or not allowed to arm, 3 no autopilot or no frames,
130 interrupted.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from contextlib import ExitStack, closing
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Final

from arva_hil.cli import common
from arva_hil.cli import options as opt
from arva_hil.cli.endings import Guard
from arva_hil.cli.keyfile import signing
from arva_hil.cli.outcome import FAILED, INTERRUPTED, NO_LINK, OK, USAGE, UsageError
from arva_hil.cli.search_report import as_dict, close_log, open_log, result
from arva_hil.cli.terminal import show_json
from arva_hil.field.mount import Mount
from arva_hil.field.rotation import from_euler
from arva_hil.links.reconnecting import open_lasting
from arva_hil.observers.console import Printer
from arva_hil.observers.console.notice import Notice
from arva_hil.observers.console.question import TerminalQuestion, somebody_is_there
from arva_hil.observers.record.search_log import SearchLog
from arva_hil.runtime.clock import RealClock
from arva_hil.runtime.loop import run
from arva_hil.search import STRATEGIES
from arva_hil.search.client import COMPONENT, SearchClient
from arva_hil.search.mission import Plan
from arva_hil.search.outcome import Row
from arva_hil.search.permission import Permission
from arva_hil.search.strips import Strips
from arva_hil.vehicle.session import Session
from firmware_proto import DECODERS

_EXIT: Final = {
    "found": OK,
    "not sure": FAILED,
    "not found": FAILED,
    "failed": FAILED,
    "no link": NO_LINK,
    "refused": USAGE,
}


def add_options(parser: opt.Parser) -> None:
    parser.option("--autopilot", "--master", type=opt.address, metavar="URL", help="where the autopilot is")
    parser.option("--receiver", type=opt.address, metavar="URL", help="the receiver's port")
    parser.option("--format", choices=sorted(DECODERS), default="binary", help="of the frames; default binary")
    add_plan(parser)
    parser.option("--end", choices=("land", "hover"), default="land", help="what to do at the end; default land")
    seconds = opt.number(0.1, math.inf, " of s")
    parser.option(
        "--timeout",
        type=seconds,
        default=60.0,
        metavar="S",
        help="from the start until there are both links, a heartbeat, frames and a pose; default 60",
    )
    parser.option("--arm-timeout", type=seconds, default=60.0, metavar="S", help="for the autopilot to arm; default 60")
    parser.typed(
        "--yes",
        action="store_true",
        help="arm a vehicle that is not known to be a simulator, without asking; has no ARVA_HIL_ variable",
    )
    parser.option(
        "--countdown",
        type=opt.number(0, 60, " of s"),
        default=3.0,
        metavar="S",
        help="said before it arms, when all is ready; default 3",
    )
    parser.typed(
        "--take-over",
        action="store_true",
        help="begin in the air: take a vehicle that hovers, armed, in AUTO, GUIDED, LOITER or BRAKE (PX4: mission or "
        "hold), for a second and 1 m above home at least; has no ARVA_HIL_ variable",
    )
    opt.add_target(parser)
    opt.add_signing(parser)
    parser.option(
        "--stream-rate", type=opt.number(4, 50, " of Hz"), default=10.0, metavar="HZ", help="of the pose; default 10"
    )
    parser.option("--record", metavar="DIR", help="record the flight, how it ended and a picture into DIR")
    parser.option("--json", action="store_true", help="how it ended, as a JSON object on stdout")


def add_plan(parser: opt.Parser) -> None:
    """Options that say how is searched."""
    parser.option("--strategy", choices=sorted(STRATEGIES), default="estimate", help="default estimate")
    parser.option(
        "--max-speed", type=opt.number(0.2, 10, " of m/s"), default=1.0, metavar="M/S", help="horizontal; default 1"
    )
    metres = opt.number(0.3, 100, " of m")
    parser.option("--height", type=metres, default=3.0, metavar="M", help="held above the ground; default 3")
    parser.option("--take-off", type=metres, default=3.0, metavar="M", help="height of the take-off; default 3")
    parser.option(
        "--mount",
        type=mount,
        default=Mount(),
        metavar="X,Y,Z[,R,P,Y]",
        help="where the receiver sits on the vehicle, m forward, right and down of its centre, and its roll, pitch and "
        "yaw there, degrees; default 0,0,0,0,0,0",
    )
    parser.option(
        "--area",
        type=area,
        default=(-50.0, -50.0, 50.0, 50.0),
        metavar="S,W,N,E",
        help="searched in strips before the first signal, m from the take-off point; 100 m outside it the search ends; "
        "default=-50,-50,50,50",
    )
    parser.option(
        "--strip-width", type=opt.number(1, 1000, " of m"), default=40.0, metavar="M", help="of the strips; default 40"
    )
    seconds = opt.number(1, 86400, " of s")
    parser.option(
        "--patience", type=seconds, default=10.0, metavar="S", help="hover without frames, then end; default 10"
    )
    parser.option(
        "--limit", type=seconds, default=900.0, metavar="S", help="end the search after this long; default 900"
    )


def area(text: str) -> tuple[float, float, float, float]:
    """A converter for south,west,north,east."""
    try:
        south, west, north, east = (float(part) for part in text.split(","))
    except ValueError:
        south = west = north = east = math.nan
    if not (-10_000 <= south < north <= 10_000 and -10_000 <= west < east <= 10_000):
        raise argparse.ArgumentTypeError(f"{text!r}: expected south,west,north,east in m, e.g. --area=-50,-50,50,50")
    return south, west, north, east


def mount(text: str) -> Mount:
    """A converter for x,y,z[,roll,pitch,yaw]."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    place, angles = values[:3], values[3:] or [0.0, 0.0, 0.0]
    valid = len(place) == len(angles) == 3
    valid = valid and all(abs(m) <= 10 for m in place) and all(abs(angle) <= 360 for angle in angles)
    if not valid:
        what = "expected x,y,z in m and, where it is turned, roll,pitch,yaw in degrees"
        raise argparse.ArgumentTypeError(f"{text!r}: {what}, e.g. --mount=0.3,0,0.1,0,0,90")
    return Mount(place, from_euler(*map(math.radians, angles)))


def plan_of(options: argparse.Namespace) -> Plan:
    return Plan(
        STRATEGIES[options.strategy],
        speed=options.max_speed,
        height=options.height,
        take_off=options.take_off,
        area=options.area,
        strip_width=options.strip_width,
        patience_s=options.patience,
        limit_s=options.limit,
        mount=options.mount,
    )


def main(options: argparse.Namespace) -> int:
    for name in ("autopilot", "receiver"):
        if getattr(options, name) in (None, "-"):
            example = "arva-hil search --autopilot udpin:127.0.0.1:14540 --receiver /tmp/arva0"
            raise UsageError(f"--{name} is missing, e.g. {example}")
    plan = plan_of(options)
    way = describe(plan)
    clock, guard = RealClock(), Guard()
    start = clock.now()
    client: SearchClient | None = None
    with ExitStack() as stack:
        key = signing(options.signing_key, clock.epoch_us, stack)
        on_the_ground = partial(open_lasting, wanted=lambda: not (client and client.launched))
        autopilot, receiver = (
            stack.enter_context(closing(common.open_or_fail(url, clock, opener, patient=True)))
            for url, opener in ((options.autopilot, on_the_ground), (options.receiver, open_lasting))
        )
        log = open_log(Path(options.record)) if options.record else None
        printer = Printer(sys.stderr)
        printer.say(f"autopilot: {autopilot.name}, receiver: {receiver.name}")
        printer.say(f"strategy {options.strategy}; {way}")
        session = Session(
            target_system=options.target_system,
            target_component=options.target_component,
            rate_hz=options.stream_rate,
            component=COMPONENT,
            signing=key,
        )
        question = TerminalQuestion(printer.say) if somebody_is_there() else None
        client = SearchClient(
            plan,
            session,
            autopilot,
            receiver,
            DECODERS[options.format](),
            start=start,
            land=options.end == "land",
            timeout_s=options.timeout,
            arm_timeout_s=options.arm_timeout,
            permission=Permission(session, yes=options.yes, question=question),
            take_over=options.take_over,
            countdown_s=options.countdown,
            emit=printer.observe,
            log=rows_to(printer, log),
        )

        def over() -> bool:
            if guard.caught:
                client.stop()
            return client.outcome is not None

        with guard:
            run([client], clock, stopped=over)
    assert client.outcome is not None
    code = INTERRUPTED if guard.caught else _EXIT[client.outcome.kind]
    first, *lines = result(client.outcome)
    printer.notice(Notice("info" if code in (OK, INTERRUPTED) else "error", first))
    if log is not None:
        lines += close_log(log, client.outcome, code)
        code = code or (FAILED if log.error else OK)
    for line in lines:
        printer.say(line)
    printer.close()
    if options.json:
        show_json(as_dict(client.outcome))
    return code


def describe(plan: Plan) -> str:
    """The way before the first signal, in words. Raises UsageError when it is too far for the time there is."""
    lanes = Strips(plan.area, plan.speed, (0.0, 0.0, 0.0), width=plan.strip_width).lanes
    there = math.hypot(*lanes[0])
    way = there + sum(math.dist(a, b) for a, b in pairwise(lanes))
    at = f"at {plan.speed:g} m/s"
    if there > plan.limit_s * plan.speed:
        raise UsageError(f"--area: its nearest corner is {there:.0f} m away, {at} too far for --limit {plan.limit_s:g}")
    less = f", more than the {plan.limit_s:g} s there are" if way > plan.limit_s * plan.speed else ""
    return f"strips of {way:.0f} m until the first signal, {way / plan.speed:.0f} s {at}{less}"


def rows_to(printer: Printer, log: SearchLog | None) -> Callable[[Row], None]:
    """Where the steps of a flight go: the log, and the status line."""

    def take(row: Row) -> None:
        if log is not None:
            log.row(row)
        if row.d_cm is not None:
            d = f"d {row.d_cm} cm {row.delta_deg:+d}°" if row.d_cm > 0 else "no signal"
            place = f"{row.north_m:z.1f} m N, {row.east_m:z.1f} m E, {-row.down_m:z.1f} m high"
            printer.show(row.time_s, f"{row.phase} | {place} | {d}")

    return take
