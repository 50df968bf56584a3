"""Recorded streams: MAVLink to a pose track, and a whole replay, beside pymavlink's own reader."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator

from arva_hil.autopilot.following.session import Session
from arva_hil.links.tlog import TlogReader
from tools.bench.table import Row, ratio
from tools.bench.timing import COMMAND, cpu_of_command, figure_of

_MAVUTIL = """
import sys, time
from pymavlink import mavutil
log = mavutil.mavlink_connection(sys.argv[1])
start = time.process_time()
while log.recv_match() is not None:
    pass
print(time.process_time() - start)
"""


def rows(options: argparse.Namespace) -> Iterator[Row]:
    flight = options.flight
    records = [record.raw for record in TlogReader(flight)]

    def track() -> float:
        session, start = Session(passive=True), time.process_time()
        for n, raw in enumerate(records):
            session.feed(raw, n * 1e-3, whole=True)
        return time.process_time() - start

    peer = min(figure_of("-c", _MAVUTIL, str(flight)) for _ in range(3))
    yield ratio(
        "MAVLink in: a recorded PX4 stream → pose track",
        "mavutil recv_match",
        min(track() for _ in range(3)),
        peer,
        "s",
        0.25,
    )
    replay = cpu_of_command([*COMMAND, "replay", str(flight), "--out", "/dev/null"])
    reading = cpu_of_command([sys.executable, "-c", _MAVUTIL, str(flight)], 3)
    yield ratio(
        "whole replay of a recorded flight, start-up included", "mavutil, only reading it", replay, reading, "s", 0.6
    )
