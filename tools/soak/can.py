"""Sends frames through DroneCAN's serial tunnel on python-can's virtual bus, in real time, and counts them.

A frame's lateness is the time from its deadline to its bytes at the far end of the tunnel. Ends with 1 if a frame is
lost, or if the 99th percentile of the lateness is above 5 ms.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import replace

import numpy as np

from arva_hil.autopilot.following.session import Session
from arva_hil.clock import Clock, RealClock
from arva_hil.config import DEFAULT
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import one_vehicle
from arva_hil.events import Event, FrameMade
from arva_hil.links import Link, memory, open_link
from arva_hil.registry import FORMATS
from arva_hil.runtime.audience import Audience
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.loop import run
from arva_hil.simulated import HOME
from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator
from tools.options import parser

BUS = "virtual:tunnel"
P99_MS = 5.0


class Deadlines:
    """The deadline, the lateness and the number of each frame."""

    def __init__(self) -> None:
        self.frames: list[tuple[float, float, int]] = []

    def observe(self, event: Event) -> None:
        if isinstance(event, FrameMade):
            self.frames.append((event.time_s - event.late_s, event.late_s, event.number))


class Arrivals:
    """The frames at the far end of the tunnel, and their times."""

    def __init__(self, link: Link, format: str) -> None:
        self.links: Sequence[Link] = [link]
        self.decoder = FORMATS[format].decoder()
        self.times: list[float] = []

    def service(self, clock: Clock) -> float:
        now = clock.now()
        self.times += [now] * len(self.decoder.feed(self.links[0].read(), now))
        return now + 0.1


def main() -> None:
    options = parser(__doc__, seconds=(600.0, "of real time"), rate=(50.0, "frames a second")).parse_args()
    scenario = replace(DEFAULT, receiver=replace(DEFAULT.receiver, rate_hz=options.rate))
    clock = RealClock()
    with ExitStack() as stack:
        port, far = (
            stack.enter_context(closing(open_link(f"can:SERIAL0,{ids},bus={BUS}", clock=clock)))
            for ids in ("node=42", "node=10,to=42")
        )
        autopilot, vehicle_end = memory.pair()
        start = clock.now()
        vehicle = Simulator([SimulatedVehicle(HOME, boot_time=start)], [vehicle_end])
        deadlines, arrivals = Deadlines(), Arrivals(far, scenario.output_format)
        emulator = Emulator([one_vehicle(scenario, Session())], start=start)
        live = Live(emulator, {"autopilot": autopilot}, {"port": port}, Audience([deadlines]))
        run([vehicle, live, arrivals], clock, until=start + options.seconds)
        run([arrivals], clock, until=clock.now() + 0.5)
        dropped = port.dropped
    sys.exit(0 if told(deadlines, arrivals, dropped) else 1)


def told(deadlines: Deadlines, arrivals: Arrivals, dropped: int) -> bool:
    """Print the counts and the lateness. Returns True if they are as they have to be."""
    made, decoder = len(deadlines.frames), arrivals.decoder
    skipped = deadlines.frames[-1][2] + 1 - made
    print(
        f"{made} frames in {deadlines.frames[-1][0] - deadlines.frames[0][0]:.0f} s, {skipped} not made because the "
        f"process stood still for over a second; {dropped} dropped by the bus; at the far end {decoder.good}, "
        f"{decoder.bad_crc} bad checksums; {time.process_time():.0f} s of processor time"
    )
    whole = made == decoder.good and decoder.lost == skipped and not (dropped or decoder.bad_crc)
    if not whole:
        return False
    due, late_s, _ = np.array(deadlines.frames).T
    for name, each in ("made", late_s), ("at the far end", np.array(arrivals.times) - due):
        p50, p99, most = 1e3 * np.percentile(each, [50, 99, 100])
        print(f"late {name}: median {p50:.2f} ms, p99 {p99:.2f} ms, at most {most:.2f} ms")
    return bool(p99 <= P99_MS)
