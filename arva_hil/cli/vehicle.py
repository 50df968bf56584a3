"""`arva-hil vehicle`: serves the built-in vehicle on links until it is stopped."""

from __future__ import annotations

import argparse
from contextlib import ExitStack, closing

from arva_hil.cli import common
from arva_hil.cli.outcome import INTERRUPTED, OK, UsageError
from arva_hil.cli.terminal import tell
from arva_hil.clock import Clock, RealClock
from arva_hil.links.reconnecting import open_reconnecting
from arva_hil.model.field import LocalFrame
from arva_hil.runtime.loop import Task
from arva_hil.simulated import arducopter
from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator

_APART_M = 5.0


def main(options: argparse.Namespace) -> int:
    if not options.link:
        raise UsageError("the following arguments are required: --link URL", "e.g. --link udpout:127.0.0.1:14550")
    for url in options.link:
        common.refuse_stdout("--link", url)
    if again := next((url for url in options.link if url != "pty" and options.link.count(url) > 1), None):
        raise UsageError(f"--link {again}: named twice")
    if options.system + options.count - 1 > 250:
        raise UsageError(f"--system {options.system} --count {options.count}: ids go up to 250")
    clock = RealClock()
    with ExitStack() as stack:
        links = [
            stack.enter_context(closing(common.open_or_fail(url, clock, open_reconnecting))) for url in options.link
        ]
        frame = LocalFrame(*options.home)
        vehicles: list[SimulatedVehicle] = []
        for number in range(options.count):
            lat, lon, alt = frame.lla((0.0, number * _APART_M, 0.0))
            vehicle = SimulatedVehicle(
                (float(lat), float(lon), float(alt)),
                options.system + number,
                wind=options.wind,
                gps_noise_m=options.gps_noise,
                seed=options.seed + number,
                boot_time=clock.now(),
                fix_after=options.fix_after,
            )
            vehicles.append(vehicle)
            tell(f"vehicle {vehicle.system} at {lat:.7f}, {lon:.7f}, {alt:.1f} m")
        tell(*(f"link: {link.name}" for link in links))
        tasks: list[Task] = [Simulator(vehicles, links, relays=len(vehicles) > 1 and len(links) > 1)]
        tasks += [_Log(vehicle, options.failsafe or []) for vehicle in vehicles]
        return INTERRUPTED if common.attend(tasks, clock, until=options.duration) else OK


class _Log:
    """Prints each new state of a vehicle, and triggers failsafes. Remembers the last state printed."""

    links = ()

    def __init__(self, vehicle: SimulatedVehicle, failsafes: list[tuple[str, float]]) -> None:
        self._vehicle = vehicle
        self._failsafes = sorted(failsafes, key=lambda item: item[1])
        self._taken_off_at: float | None = None
        self._told = ""

    def service(self, clock: Clock) -> float:

        now = clock.now()
        vehicle = self._vehicle
        if self._taken_off_at is None and vehicle.flying:
            self._taken_off_at = now
        while self._failsafes and self._taken_off_at is not None and now >= self._taken_off_at + self._failsafes[0][1]:
            name, _ = self._failsafes.pop(0)
            tell(f"vehicle {vehicle.system}: failsafe: {name}")
            vehicle.trigger(arducopter.FAILSAFES[name], now)
        if (state := vehicle.state) != self._told:
            self._told = state
            tell(f"vehicle {vehicle.system}: {state}")
        return now + 0.1
