"""The emulator live over pseudo-terminals, compared with programs that only read, wait or echo."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from tools.bench.alone import WARM_S
from tools.bench.flight import Motion, bare, playing
from tools.bench.table import Row, ratio
from tools.bench.timing import figures_of

_TURNS: Final = 4  # ours and the peer's in turn, so that both have the same load of the machine
_LEAST: Final = 100  # least number of frames; with fewer the p99 is the worst one

_READ = """
import sys, time
from pymavlink import mavutil
link = mavutil.mavlink_connection(sys.argv[1])
def read(seconds):
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        link.recv_match(blocking=True, timeout=0.5)
read(float(sys.argv[2]))
start = time.process_time()
read(float(sys.argv[3]))
print(time.process_time() - start)
"""
_BUSY = [sys.executable, "-c", "while True: pass"]


def rows(flight: Path, seconds: float) -> Iterator[Row]:
    motion, ours, peer = Motion(flight), list[float](), list[float]()
    for _ in range(_TURNS):
        with playing(motion, seconds + 9) as (device, _):
            ours.append(_fly(device, 10.0, seconds)[0])
        with playing(motion, seconds + 9) as (device, _):
            peer.append(figures_of("-c", _READ, device, str(WARM_S), str(seconds))[0])
    work = "live, 50 Hz pose in, 10 Hz frames out: its CPU"
    yield ratio(work, "pymavlink, only reading", min(ours), min(peer), "s", 1.3)
    for busy in (False, True):
        for hz in (1.0, 10.0, 50.0):
            yield _lateness(motion, hz, seconds, busy=busy)


def _lateness(motion: Motion, hz: float, seconds: float, *, busy: bool) -> Row:
    """Return the row of our p99 lateness, beside that of an idle loop and 0.3 ms."""
    turn_s, late, idle = max(seconds, _LEAST / hz) / _TURNS, list[float](), list[float]()
    other = subprocess.Popen(_BUSY) if busy else None
    try:
        for _ in range(_TURNS):
            with playing(motion, turn_s + 9) as (device, _):
                late += _fly(device, hz, turn_s)[1]
            idle += bare(hz, turn_s)[1:]
    finally:
        if other:
            other.kill()
            other.wait()
    ours, peer = float(np.percentile(late, 99)), float(np.percentile(idle, 99))
    work = f"p99 lateness at {hz:g} Hz, {'one core busy' if busy else 'idle'}"
    return Row(work, f"a bare loop, {len(late)} frames", ours, peer, "ms", ours - peer, 0.3)


def _fly(device: str, hz: float, seconds: float) -> tuple[float, list[float]]:
    """Return the loop's CPU time [s] and the lateness of each frame [ms], in a process of its own like the peer."""
    cpu_s, *late_ms = figures_of("-m", "tools.bench.alone", device, str(hz), str(seconds))
    return cpu_s, late_ms
