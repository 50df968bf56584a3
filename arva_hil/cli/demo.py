"""The whole chain without hardware: a simulated vehicle flies past a transmitter, a receiver hears it.

At real time the vehicle and the receiver are on pseudo-terminals, as real ones are on cables.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from contextlib import ExitStack, closing
from typing import Any, Final

from arva_hil.autopilot.mavlink import Encoder, Parser, dialect
from arva_hil.autopilot.session import Session
from arva_hil.autopilot.vehicle import SimulatedVehicle
from arva_hil.cli import options as opt
from arva_hil.cli import shared
from arva_hil.cli.outcome import NO_LINK, Failure, UsageError
from arva_hil.clock import Clock, RealClock, StepClock
from arva_hil.emulator import Emulator
from arva_hil.links import Link, LinkError, memory
from arva_hil.links.pty import PtyLink
from arva_hil.loop import Task, run
from arva_hil.output import MAVLINK_FORMATS, WirePort
from arva_hil.simulator import Simulator
from firmware_proto import DECODERS, Frame, FrameDecoder

HOME: Final = (46.0123, 7.7456, 1650.0)
HEIGHT_M: Final = 2.0
SPEED_M_S: Final = 2.0
PATH: Final = ((20.0, 5.0), (30.0, -5.0), (0.0, 0.0))  # north, east: over the default transmitter, past it, home
GUIDED: Final = 4  # ArduCopter custom modes
LAND: Final = 9
_LONGEST_S: Final = 120.0


def add_options(parser: opt.Parser) -> None:
    parser.option("--speed", type=opt.speed, default=1.0, metavar="N|max", help="times real time; default 1")
    parser.option("--headless", action="store_true", help="plain lines only")
    opt.add_scenario(parser)
    opt.add_common(parser)


def main(options: argparse.Namespace) -> int:
    chosen = shared.scenario(options)
    if chosen.output_format in MAVLINK_FORMATS:
        raise UsageError(f"--format {chosen.output_format}: the demo has a port: choose binary, nmea or text")
    fast = options.speed == math.inf
    clock: RealClock | StepClock = StepClock() if fast else RealClock(options.speed)
    with ExitStack() as stack:
        autopilot, fc, port, consumer = _memory_links() if fast else _ptys(stack, clock)
        pilot_link, pilot_far = memory.pair()
        vehicle = SimulatedVehicle(HOME, boot_time=clock.now())
        surroundings = shared.Run(options, chosen, clock.epoch_us, live=not options.headless)
        emulator = Emulator(
            chosen,
            Session(),
            autopilot,
            WirePort(port, chosen.output_format),
            start=clock.now(),
            timeout_s=10.0,
            observers=surroundings.observers,
        )
        listener, pilot = Consumer(consumer, DECODERS[chosen.output_format]()), Pilot(pilot_link)
        tasks: list[Task] = [Simulator(vehicle, [fc, pilot_far]), pilot, emulator, listener]
        if not fast:
            surroundings.printer.say(f"vehicle at {autopilot.name}, frames at {consumer.name}")
        code = surroundings.drive(
            emulator,
            lambda: run(tasks, clock, until=_LONGEST_S, stopped=lambda: pilot.done or surroundings.stopped()),
        )
    print(listener.sum(), file=sys.stderr)
    return code


def _memory_links() -> tuple[Link, Link, Link, Link]:
    return *memory.pair(), *memory.pair()


def _ptys(stack: ExitStack, clock: Clock) -> tuple[Link, Link, Link, Link]:
    """The autopilot's line and the receiver's, each a pseudo-terminal and a serial port opened on it."""
    try:
        fc, port = (stack.enter_context(closing(PtyLink())) for _ in range(2))
    except LinkError as error:
        raise Failure(NO_LINK, f"{error}, or demo --speed max, which needs none") from None
    autopilot, consumer = (stack.enter_context(closing(shared.open_or_fail(p.path, clock))) for p in (fc, port))
    return autopilot, fc, port, consumer


class Consumer:
    """What an onboard computer does: reads the port. Remembers the nearest reading."""

    def __init__(self, link: Link, decoder: FrameDecoder) -> None:
        self.links: Sequence[Link] = [link]
        self._link = link
        self._decoder = decoder
        self._nearest: int | None = None

    def service(self, clock: Clock) -> float:
        now = clock.now()
        for frame in self._decoder.feed(self._link.read(), now):
            self._take(frame)
        return now + 1.0

    def sum(self) -> str:
        d = self._decoder
        nearest = "no transmitter" if self._nearest is None else f"a transmitter, at the nearest {self._nearest} cm"
        return f"the consumer read {d.good} frames ({d.lost} lost, {d.bad_crc} bad) and heard {nearest}"

    def _take(self, frame: Frame) -> None:
        for channel in frame.channels:
            if channel.valid and (self._nearest is None or channel.d < self._nearest):
                self._nearest = channel.d


class Pilot:
    """Flies `PATH`: GUIDED, arm, take off, velocity set-points twice a second, land. Remembers where it is in that."""

    def __init__(self, link: Link) -> None:
        self.links: Sequence[Link] = [link]
        self.done = False
        self._link = link
        self._parser = Parser()
        self._encoder = Encoder(255, dialect.MAV_COMP_ID_MISSIONPLANNER)
        self._next = 0.0
        self._leg = 0
        self._armed = False
        self._mode = 0
        self._landing = False
        self._ned: tuple[float, float, float] | None = None

    def service(self, clock: Clock) -> float:
        now = clock.now()
        for packet in self._parser.feed(self._link.read()):
            message = self._parser.decode(packet)
            if message is None:
                continue
            if packet.msgid == dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
                self._ned = (message.x, message.y, message.z)
            elif packet.msgid == dialect.MAVLINK_MSG_ID_HEARTBEAT:
                self._armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
                self._mode = message.custom_mode
        if now >= self._next:
            self._next = now + 0.5
            for message in self._steps():
                self._link.write(self._encoder.pack(message))
        return self._next

    def _steps(self) -> list[Any]:
        """What to say now."""
        if self._ned is None:
            interval_us = 100_000
            return [
                _command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, interval_us)
            ]
        north, east, down = self._ned
        if self._landing:
            self.done = not self._armed
            return [] if self._mode == LAND else [_command(dialect.MAV_CMD_NAV_LAND)]
        if not self._armed:
            guided = _command(dialect.MAV_CMD_DO_SET_MODE, dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, GUIDED)
            return [guided, _command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)]
        if self._leg == 0 and down > -0.8 * HEIGHT_M:
            return [_command(dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, HEIGHT_M)]
        target = PATH[self._leg]
        away = (target[0] - north, target[1] - east)
        distance = math.hypot(*away)
        if distance < 1.0:
            self._leg += 1
            self._landing = self._leg == len(PATH)
            return []
        speed = min(SPEED_M_S, distance)
        return [_velocity(speed * away[0] / distance, speed * away[1] / distance, math.atan2(away[1], away[0]))]


def _command(command: int, *params: float) -> Any:
    return dialect.MAVLink_command_long_message(1, 1, command, 0, *params, *[0.0] * (7 - len(params)))


def _velocity(north: float, east: float, yaw: float) -> Any:
    """Fly with this velocity [m/s], heading `yaw` [rad]; hold the height."""
    velocity_and_yaw = 0b100111000111
    return dialect.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, dialect.MAV_FRAME_LOCAL_NED, velocity_and_yaw, 0, 0, 0, north, east, 0, 0, 0, 0, yaw, 0
    )
