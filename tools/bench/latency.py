"""From a frame's instant, right after the bytes of a new pose, to the frame's first byte; beside an echo."""

from __future__ import annotations

import multiprocessing
import os
import select
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, Final

import numpy as np

from arva_hil.autopilot.following.session import Session
from arva_hil.clock import RealClock
from arva_hil.config import parse
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import one_vehicle
from arva_hil.links import open_link
from arva_hil.links.pty import PtyLink
from arva_hil.runtime.audience import Audience
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.loop import run
from tools.bench.flight import Motion, origin
from tools.bench.table import Row

_HZ: Final = 10.0
_BEFORE_S: Final = 0.0002  # a pose's bytes, before the frame's instant
_LEAST: Final = 10  # frames
_REACH_MS: Final = {50: 0.3, 99: 1.0}


def rows(flight: Path, seconds: float) -> Iterator[Row]:
    ours, echo = _frames(Motion(flight), seconds), _echoes(round(seconds * 50))
    if len(ours) < _LEAST:
        sys.exit(
            f"{len(ours)} frames came right after a pose, {_LEAST} are needed: more --seconds, a machine less busy"
        )
    for share, reach in _REACH_MS.items():
        mine, peer = float(np.percentile(ours, share)), float(np.percentile(echo, share))
        work = f"newest pose in → frame's first byte out, p{share}"
        yield Row(work, "pty round trip", mine, peer, "ms", mine - peer, reach)


def _emulate(device: str, port: str, seconds: float, started: Any) -> None:
    scenario = parse(f"transmitters: [{{id: 1, ned: [20, 5, 0]}}]\nreceiver: {{rate_hz: {_HZ}}}", "bench")
    clock = RealClock()
    with closing(open_link(device, clock=clock)) as link, closing(open_link(port, clock=clock)) as out:
        start = clock.now() + 0.5
        started.put(start + origin(clock))
        emulator = Emulator([one_vehicle(scenario, Session())], start=start)
        run([Live(emulator, {"autopilot": link}, {"port": out}, Audience([]))], clock, until=start + seconds)


def _frames(motion: Motion, seconds: float) -> list[float]:
    """Return the latency [ms] of each frame directly after a pose."""
    late = []
    with closing(PtyLink()) as far, closing(PtyLink()) as port:
        started: Any = multiprocessing.Queue()
        child = multiprocessing.Process(target=_emulate, args=(far.path, port.path, seconds, started), daemon=True)
        child.start()
        start = started.get(timeout=60)
        fd: Any = port.fileno()
        for n in range(round((seconds - 1) * _HZ)):
            instant = start + n / _HZ
            packets = (motion.beat() if n % _HZ == 0 else b"") + motion.packets(round(n / _HZ, 3))
            _until(instant - _BEFORE_S)
            far.read()
            port.read()  # discard a frame that came during a delay of this program
            far.write(packets)
            sent = time.monotonic()
            if sent > instant:  # delayed again
                continue
            if select.select([fd], [], [], 1.0)[0]:
                late.append(1e3 * (time.monotonic() - instant))
                port.read()
        child.terminate()
        child.join()
    return late[round(2 * _HZ) :]  # without the start


def _until(instant: float) -> None:
    time.sleep(max(0.0, instant - 0.0005 - time.monotonic()))
    while time.monotonic() < instant:
        pass


def _echo(path: str) -> None:
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
    while data := os.read(fd, 4096):
        os.write(fd, data)


def _echoes(times: int) -> list[float]:
    """Return the times [ms] there and back through an echo process."""
    taken = []
    with closing(PtyLink()) as link:
        child = multiprocessing.Process(target=_echo, args=(link.path,), daemon=True)
        child.start()
        time.sleep(0.5)
        fd: Any = link.fileno()
        for _ in range(times):
            time.sleep(0.02)
            sent = time.monotonic()
            link.write(b"pose")
            if select.select([fd], [], [], 1.0)[0]:
                taken.append(1e3 * (time.monotonic() - sent))
                link.read()
        child.terminate()
        child.join()
    return taken
