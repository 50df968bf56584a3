"""The emulator live over pseudo-terminals, compared with a program that only reads."""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from typing import Final

from arva_hil.links.pty import PtyLink
from tools.bench.stream import playing
from tools.bench.table import Row, ratio
from tools.bench.timing import COMMAND

_TURNS: Final = 4  # ours and the peer's in turn, so that both have the same load of the machine
_WARM_S: Final = 3.0  # the time of a start is another row

_READ = """
import sys
from pymavlink import mavutil
link = mavutil.mavlink_connection(sys.argv[1])
while True:
    link.recv_match(blocking=True, timeout=0.5)
"""


def rows(options: argparse.Namespace) -> Iterator[Row]:
    ours, peer = list[float](), list[float]()
    with closing(PtyLink()) as port:
        run = [*COMMAND, "run", "--port", port.path, "--rate", "10", "--autopilot"]
        for _ in range(_TURNS):
            ours.append(_cpu_of_process(run, options.seconds))
            peer.append(_cpu_of_process([sys.executable, "-c", _READ], options.seconds))
    work = "live, 50 Hz pose in, 10 Hz frames out: its CPU"
    yield ratio(work, "pymavlink, only reading", min(ours), min(peer), "s", 1.3)


def _cpu_of_process(command: list[str], seconds: float) -> float:
    """Return the CPU time [s] of a process that follows the flight, without its start."""
    with playing(_WARM_S + seconds + 5) as device:
        process = subprocess.Popen([*command, device], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        clock = ~process.pid << 3 | 2  # clock_getcpuclockid of Linux
        time.sleep(_WARM_S)
        before = time.clock_gettime(clock)
        time.sleep(seconds)
        taken = time.clock_gettime(clock) - before
        process.kill()
        process.wait()
    return taken
