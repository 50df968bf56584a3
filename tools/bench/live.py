"""The emulator live over pseudo-terminals, compared with a program that only reads."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Final

from tools.bench.alone import WARM_S
from tools.bench.flight import Motion, playing
from tools.bench.table import Row, ratio
from tools.bench.timing import figure_of

_TURNS: Final = 4  # ours and the peer's in turn, so that both have the same load of the machine

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


def rows(options: argparse.Namespace) -> Iterator[Row]:
    seconds, motion = options.seconds, Motion(options.flight)
    ours, peer = list[float](), list[float]()
    for _ in range(_TURNS):
        with playing(motion, seconds + 9) as device:
            ours.append(figure_of("-m", "tools.bench.alone", device, "10", str(seconds)))
        with playing(motion, seconds + 9) as device:
            peer.append(figure_of("-c", _READ, device, str(WARM_S), str(seconds)))
    work = "live, 50 Hz pose in, 10 Hz frames out: its CPU"
    yield ratio(work, "pymavlink, only reading", min(ours), min(peer), "s", 1.3)
