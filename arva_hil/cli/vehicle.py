"""`arva-hil vehicle`: serves the built-in vehicle on links until it is stopped."""

from __future__ import annotations

import argparse
from contextlib import ExitStack, closing
from typing import TYPE_CHECKING, Final

from arva_hil.cli.arguments.shared import add_duration, add_gps_noise
from arva_hil.cli.options import CommandParser, link, number, numbers, whole
from arva_hil.cli.outcome import INTERRUPTED, OK, UsageError
from arva_hil.cli.terminal import tell
from arva_hil.clock import Clock, RealClock
from arva_hil.simulated import HOME

if TYPE_CHECKING:
    from arva_hil.runtime.loop import Task
    from arva_hil.simulated.vehicle import SimulatedVehicle

FAILSAFES: Final = ("geofence", "battery", "ekf", "radio")

_APART_M = 5.0


def options(parser: CommandParser) -> None:
    """Run the built-in vehicle alone: a simulated multirotor that answers as ArduCopter does, on one or more links.

    A ground station and a search can use it together: `arva-hil vehicle --link udpout:127.0.0.1:14550 --link
    tcpin:127.0.0.1:5760`.
    """
    parser.option("--link URL", "MAVLink link; may be repeated", link, action="append")
    parser.option("--home LAT,LON,ALT", "home in degrees, m AMSL; default: in the Alps", home, HOME)
    parser.option("--wind N,E,D", "velocity of the air, m/s; default 0,0,0", wind, (0.0, 0.0, 0.0))
    add_gps_noise(parser)
    parser.option("--fix-after S", "time until the first GPS fix", number(0, 3600), 0.0)
    parser.option("--count N", "number of vehicles, 5 m apart, with consecutive ids", whole(1, 64), 1)
    parser.option("--system N", "system id of the first vehicle", whole(1, 250), 1)
    parser.option("--seed N", "seed of the GPS drift", whole(0, 2**31), 0)
    names = f"trigger a failsafe S seconds after the first take-off: {', '.join(FAILSAFES)}; may be repeated"
    parser.option("--failsafe NAME@S", names, failsafe, action="append")
    add_duration(parser)


def main(options: argparse.Namespace) -> int:
    from arva_hil.cli import common  # slow, as those below
    from arva_hil.links.reconnecting import open_reconnecting
    from arva_hil.model.field import LocalFrame
    from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator

    if not options.link:
        raise UsageError("the following arguments are required: --link URL", "e.g. --link udpout:127.0.0.1:14550")
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
        logs: list[Task] = []
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
            logs.append(_Log(vehicle, options.failsafe or []))
            tell(f"vehicle {vehicle.system} at {lat:.7f}, {lon:.7f}, {alt:.1f} m")
        for link in links:
            tell(f"link: {link.name}")
        tasks: list[Task] = [Simulator(vehicles, links, relays=len(vehicles) > 1 and len(links) > 1), *logs]
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
        from arva_hil.simulated import arducopter  # slow to import

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


home = numbers(
    "LAT,LON,ALT in degrees and m, e.g. --home=46.0,7.7,1650",
    (-90, 90),
    (-180, 180),
    (-500, 9000),
    names=("latitude", "longitude", "altitude"),
)
wind = numbers("N,E,D in m/s, at most 50 each, e.g. --wind=3,-1,0", *[(-50, 50)] * 3)


def failsafe(text: str) -> tuple[str, float]:
    """Convert NAME@SECONDS."""
    name, _, seconds = text.partition("@")
    try:
        return FAILSAFES[FAILSAFES.index(name)], number(0, 86_400)(seconds or "0")
    except ValueError:
        expected = f"expected NAME@SECONDS, where NAME is one of {', '.join(FAILSAFES)}"
        raise ValueError(f"{text!r}: {expected}, e.g. battery@30") from None
