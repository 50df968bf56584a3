"""`arva-hil run`: opens the links, makes the engine, and runs it until the end."""

from __future__ import annotations

import argparse
import os
from contextlib import ExitStack, closing, suppress

from arva_hil.cli import common
from arva_hil.cli.run_links import chosen_sides, signing
from arva_hil.cli.summary import lost_links
from arva_hil.cli.terminal import tell
from arva_hil.clock import Clock, RealClock
from arva_hil.emulator.engine import Emulator
from arva_hil.links import Link
from arva_hil.links.stdout import StdoutLink
from arva_hil.mavlink.packet_reader import PacketReader
from arva_hil.observers.systemd import Watchdog
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.fleet_links import FleetSides, live_vehicles
from arva_hil.runtime.loop import Task, run


def main(options: argparse.Namespace) -> int:
    chosen = common.scenario(options)
    sides = chosen_sides(options, chosen)
    _allow_files()
    clock = RealClock()
    with ExitStack() as stack:
        readers = {
            name: PacketReader(signing(options.signing_key, clock.epoch_us, stack, number))
            for number, name in enumerate(sides.autopilots)
        }
        vehicles = live_vehicles(
            chosen, sides, readers, options.target_system, options.target_component, options.stream_rate
        )
        autopilots, ports = _opened(sides, clock, stack, named=bool(chosen.vehicles))
        surroundings = stack.enter_context(
            common.Run(options, chosen, clock.epoch_us, record_links=list(sides.autopilots))
        )
        if surroundings.page:
            for name, link in (*autopilots.items(), *ports.items()):
                surroundings.page.state.health.add_link(name, link.name)
        watchdog = Watchdog(os.environ)
        surroundings.observers.append(watchdog)
        start = clock.now()
        emulator = Emulator(
            vehicles,
            start=start,
            timeout_s=min(options.timeout, options.duration),
            max_age_s=options.max_age,
            tell_packets=bool(options.record or surroundings.page),
            spread=True,
        )
        live = Live(emulator, autopilots, ports, surroundings.audience)
        until = start + options.duration

        def loop() -> None:
            with closing(watchdog):
                tasks: list[Task] = [live, watchdog] if watchdog.is_wanted else [live]
                run(tasks, clock, until=until, stopped=surroundings.stopped)
                live.finish(clock)

        return surroundings.drive(emulator, loop, live.counts, lambda: lost_links(live))


def _opened(
    sides: FleetSides, clock: Clock, stack: ExitStack, *, named: bool
) -> tuple[dict[str, Link], dict[str, Link]]:
    """Open the links of the autopilots, and those for frames, by the engine's names. Lost links are opened again."""
    autopilots, ports = dict[str, Link](), dict[str, Link]()
    for name, address in sides.autopilots.items():
        of = ", ".join(vehicle for vehicle, link in sides.of_vehicle.items() if link == name)
        tell(f"autopilot{of and f' of {of}'}: {address}")
        autopilots[name] = common.open_reopened(address, clock, stack, answered=True)
    for name, address in sides.ports.items():
        ports[name] = out = common.open_reopened(address, clock, stack)
        if isinstance(out, StdoutLink):
            out.give_up = lambda: True  # drop a frame rather than delay the next one
        tell(f"frames{f' of {name}' if named else ''} to: {out.name}")
    return autopilots, ports


def _allow_files() -> None:
    """Let this process open as many files as the system allows: a recorded fleet needs more than the usual 1024."""
    with suppress(ImportError, OSError, ValueError):
        import resource  # Windows has none, and no such limit

        most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
