"""The emulator live over pseudo-terminals, beside programs that do nothing but read, wait or echo on the same."""

from __future__ import annotations

import gc
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Final

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
from tools.measure import Motion, Samples, bare, playing

_TURNS: Final = 4  # ours and the peer's, one after the other: both meet the same minutes of the machine
_LEAST: Final = 100  # frames: of fewer, p99 is the worst one

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
    motion, ours, peer = Motion(flight), list[float](), list[float]()
    for _ in range(_TURNS):
        with playing(motion, seconds + 5) as (device, _):
            ours.append(_fly(device, 10.0, seconds)[0])
        with playing(motion, seconds + 5) as (device, _):
            peer.append(figure_of(_READ, device, str(seconds)))
    work = "live, 50 Hz pose in, 10 Hz frames out: its CPU"
    yield ratio(work, "pymavlink, only reading", min(ours), min(peer), "s", 1.0)
    for busy in (False, True):
        for hz in (1.0, 10.0, 50.0):
            yield _lateness(motion, hz, seconds, busy=busy)


def _lateness(motion: Motion, hz: float, seconds: float, *, busy: bool) -> Row:
    """p99 of our lateness, beside that of a loop that does nothing, and 0.3 ms. The first frame of a turn, in which
    much runs for the first time, does not count.
    """
    turn_s, late, idle = max(seconds, _LEAST / hz) / _TURNS + 1 / hz, list[float](), list[float]()
    other = subprocess.Popen(_BUSY) if busy else None
    try:
        for _ in range(_TURNS):
            with playing(motion, turn_s + 5) as (device, _):
                late += _fly(device, hz, turn_s)[1][1:]
            idle += bare(hz, turn_s)[1:]
    finally:
        if other:
            other.kill()
            other.wait()
    ours, peer = float(np.percentile(late, 99)), float(np.percentile(idle, 99))
    work = f"p99 lateness at {hz:g} Hz, {'one core busy' if busy else 'idle'}"
    return Row(work, f"a bare loop, {len(late)} frames", ours, peer, "ms", ours - peer, 0.3)


def _fly(device: str, hz: float, seconds: float) -> tuple[float, list[float]]:
    """The loop's CPU time, s, and how late each frame was, ms."""
    scenario = parse(f"transmitters: [{{id: 1, ned: [20, 5, 0]}}]\nreceiver: {{rate_hz: {hz}}}", "bench")
    clock, samples = RealClock(), Samples()
    with closing(PtyLink()) as port, closing(open_link(device, clock=clock)) as link, _consumer(port.path):
        begin = clock.now() + 0.2
        emulator = Emulator([one_vehicle(scenario, Session())], start=begin)
        live = Live(emulator, {"autopilot": link}, {"port": port}, Audience([samples]))
        gc.freeze()  # as the commands do
        start = time.process_time()
        run([live], clock, until=begin + seconds)
        return time.process_time() - start, [1e3 * frame.late_s for frame in samples.frames]


@contextmanager
def _consumer(path: str) -> Iterator[None]:
    """A process of its own reads a port."""
    consumer = multiprocessing.Process(target=_drain, args=(path,), daemon=True)
    consumer.start()
    yield
    consumer.terminate()
    consumer.join()


def _drain(path: str) -> None:
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
    while os.read(fd, 4096):
        pass
