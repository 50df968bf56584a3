"""The emulator live over pseudo-terminals, beside programs that do nothing but read, wait or echo on the same."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np

from arva_hil.config import parse
from arva_hil.emulator.emulated_vehicle import one_vehicle
from arva_hil.emulator.engine import Emulator
from arva_hil.links import open_link
from arva_hil.links.pty import PtyLink
from arva_hil.observers.audience import Audience
from arva_hil.runtime.clock import RealClock
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.loop import run
from arva_hil.vehicle.session import Session
from tools.bench.table import Row, ratio
from tools.bench.timing import figure_of
from tools.measure import Drained, Motion, Samples, bare, playing

_READ = """
import sys, time
from pymavlink import mavutil
link = mavutil.mavlink_connection(sys.argv[1])
start, until = time.process_time(), time.monotonic() + float(sys.argv[2])
while time.monotonic() < until:
    link.recv_match(blocking=True, timeout=0.5)
print(time.process_time() - start)
"""
_BUSY = [sys.executable, "-c", "while True: pass"]


def rows(flight: Path, seconds: float) -> Iterator[Row]:
    motion = Motion(flight)
    with playing(motion, seconds + 5) as (device, _):
        ours, _ = _fly(device, 10.0, seconds)
    with playing(motion, seconds + 5) as (device, _):
        peer = figure_of(_READ, device, str(seconds))
    yield ratio("live, 50 Hz pose in, 10 Hz frames out: its CPU", "pymavlink, only reading", ours, peer, "s", 1.0)
    for busy in (False, True):
        for hz in (1.0, 10.0, 50.0):
            yield _lateness(motion, hz, seconds, busy=busy)


def _lateness(motion: Motion, hz: float, seconds: float, *, busy: bool) -> Row:
    """p99 of our lateness, beside that of a loop that does nothing, and 0.3 ms."""
    other = subprocess.Popen(_BUSY) if busy else None
    try:
        with playing(motion, seconds + 5) as (device, _):
            _, late = _fly(device, hz, seconds)
        idle = bare(hz, seconds)
    finally:
        if other:
            other.kill()
            other.wait()
    ours, peer = float(np.percentile(late, 99)), float(np.percentile(idle, 99))
    work = f"p99 lateness at {hz:g} Hz, {'one core busy' if busy else 'idle'}"
    return Row(work, "a bare loop", ours, peer, "ms", ours - peer, 0.3)


def _fly(device: str, hz: float, seconds: float) -> tuple[float, list[float]]:
    """The loop's CPU time, s, and how late each frame was, ms."""
    scenario = parse(f"transmitters: [{{id: 1, ned: [20, 5, 0]}}]\nreceiver: {{rate_hz: {hz}}}", "bench")
    clock, samples = RealClock(), Samples()
    with closing(PtyLink()) as port, closing(open_link(device, clock=clock)) as link, closing(Drained(port)) as out:
        emulator = Emulator([one_vehicle(scenario, Session())], start=clock.now())
        live = Live(emulator, {"autopilot": link}, {"port": out}, Audience([samples]))
        start = time.process_time()
        run([live], clock, until=clock.now() + seconds)
        return time.process_time() - start, [1e3 * frame.late_s for frame in samples.frames]
