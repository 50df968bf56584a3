"""`arva-hil run`: opens the links, makes the engine, and runs it until the end."""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from typing import NamedTuple

from arva_hil.cli import common
from arva_hil.cli.outcome import UsageError
from arva_hil.cli.run_links import check_sides, choose_autopilot, chosen_sides, signing
from arva_hil.cli.summary import LinkCounters
from arva_hil.cli.terminal import tell
from arva_hil.config import Scenario, VehicleConfig
from arva_hil.emulator.emulated_vehicle import VehicleSetup, one_vehicle
from arva_hil.emulator.engine import Emulator, vehicle_setups
from arva_hil.links import Link, parse
from arva_hil.links.reconnecting import open_reconnecting
from arva_hil.links.stdout import StdoutLink
from arva_hil.mavlink.packet_reader import PacketReader
from arva_hil.observers.systemd import Watchdog
from arva_hil.registry import MAVLINK_FORMATS
from arva_hil.runtime.clock import Clock, RealClock
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.loop import run
from arva_hil.vehicle.session import Session


def main(options: argparse.Namespace) -> int:
    chosen = common.scenario(options, fleet=True)
    clock = RealClock()
    with ExitStack() as stack:
        sides = (_fleet if chosen.vehicles else _one)(options, chosen, clock, stack)
        surroundings = stack.enter_context(
            common.Run(options, chosen, clock.epoch_us, record_links=list(sides.autopilots))
        )
        if surroundings.page:
            for name, link in (*sides.autopilots.items(), *sides.ports.items()):
                surroundings.page.state.health.add_link(name, link.name)
        watchdog = Watchdog(os.environ)
        surroundings.observers.append(watchdog)
        start = clock.now()
        emulator = Emulator(
            sides.vehicles,
            start=start,
            timeout_s=min(options.timeout, options.duration),
            max_age_s=options.max_age,
            tell_packets=bool(options.record),
        )
        live = Live(emulator, sides.autopilots, sides.ports, surroundings.audience)
        until = start + options.duration

        def loop() -> None:
            with closing(watchdog):
                run([live, watchdog], clock, until=until, stopped=surroundings.stopped)

        return surroundings.drive(emulator, loop, LinkCounters(live))


class _Sides(NamedTuple):
    """The vehicles, and the links by the engine's names for them."""

    vehicles: Sequence[VehicleSetup]
    autopilots: Mapping[str, Link]
    ports: Mapping[str, Link]


def _one(options: argparse.Namespace, chosen: Scenario, clock: RealClock, stack: ExitStack) -> _Sides:
    """One vehicle with one receiver, on the command line's links."""
    over_mavlink = chosen.output_format in MAVLINK_FORMATS
    _check(options, chosen.output_format, over_mavlink)
    address = options.autopilot or choose_autopilot(options.port)
    session = Session(
        target_system=options.target_system,
        target_component=options.target_component,
        rate_hz=options.stream_rate,
        signing=signing(options.signing_key, clock.epoch_us, stack),
    )
    tell(f"autopilot: {address}")
    autopilots = {"autopilot": stack.enter_context(closing(_open(address, clock, answered=True)))}
    ports = {} if over_mavlink else {"port": _open_port(options.port, clock, stack)}
    return _Sides([one_vehicle(chosen, session)], autopilots, ports)


def _fleet(options: argparse.Namespace, chosen: Scenario, clock: RealClock, stack: ExitStack) -> _Sides:
    """The scenario's vehicles, each link opened once."""
    sides = chosen_sides(options, chosen)
    readers = {
        name: PacketReader(signing(options.signing_key, clock.epoch_us, stack, number))
        for number, name in enumerate(sides.autopilots)
    }

    def session(vehicle: VehicleConfig) -> Session:
        return Session(
            target_system=vehicle.system,
            target_component=options.target_component,
            rate_hz=options.stream_rate,
            reader=readers[sides.of_vehicle[vehicle.name]],
        )

    autopilots, ports = {}, {}
    for name, address in sides.autopilots.items():
        tell(f"autopilot of {', '.join(v for v, of in sides.of_vehicle.items() if of == name)}: {address}")
        autopilots[name] = stack.enter_context(closing(_open(address, clock, answered=True)))
    for name, address in sides.ports.items():
        ports[name] = _open_port(address, clock, stack, of=f" of {name}")
    setups = vehicle_setups(chosen, lambda vehicle: sides.of_vehicle[vehicle.name], session)
    return _Sides(setups, autopilots, ports)


def _open_port(address: str, clock: Clock, stack: ExitStack, of: str = "") -> Link:
    out = stack.enter_context(closing(_open(address, clock)))
    if isinstance(out, StdoutLink):
        out.give_up = lambda: True  # drop a frame rather than delay the next one
    tell(f"frames{of} to: {out.name}")
    return out


def _open(address: str, clock: Clock, *, answered: bool = False) -> Link:
    """A link that is opened again after a loss. Waits for a TCP server; other links must be there at the start."""
    patient = parse(address).kind == "tcp"
    return common.open_or_fail(address, clock, open_reconnecting, answered=answered, patient=patient)


def _check(options: argparse.Namespace, format: str, over_mavlink: bool) -> None:
    if not over_mavlink and not options.port:
        raise UsageError(
            "--port is missing: name the port for the frames, e.g. --port /dev/ttyUSB0, --port pty, "
            "or --format tunnel to send them inside MAVLink"
        )
    if options.json and options.port == "-":
        raise UsageError("--json and --port - both want stdout: choose one")
    check_sides(options.autopilot, options.port, format)
