"""A flight on a circle as the stream of an autopilot, also live on a pseudo-terminal."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any, Final

import numpy as np

from arva_hil.clock import RealClock
from arva_hil.links.pty import PtyLink
from arva_hil.mavlink.codec import Encoder, dialect

POSE_HZ: Final = 50


def packets(encoder: Encoder, n: int) -> bytes:
    """Return the packets of instant `n` / 50 s, on a circle."""
    t = n / POSE_HZ
    north, east = 20 * np.cos(t / 10), 20 * np.sin(t / 10)
    ms, lat, lon = round(1e3 * t) + 1000, round(460123000 + north * 90), round(77456000 + east * 129)
    vn, ve = round(-200 * np.sin(t / 10)), round(200 * np.cos(t / 10))
    position = dialect.MAVLink_global_position_int_message(ms, lat, lon, 1650000, 0, vn, ve, 0, 0)
    attitude = dialect.MAVLink_attitude_message(ms, 0.01, 0.02, t / 10 % 3.0, 0.0, 0.0, 0.1)
    data = encoder.pack(position) + encoder.pack(attitude)
    if n % POSE_HZ == 0:
        data += encoder.pack(dialect.MAVLink_heartbeat_message(2, 3, 0x81, 4, 4, 3))
        home = dialect.MAVLink_home_position_message(460123000, 77456000, 1650000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)
        data += encoder.pack(home)
    return data


@contextmanager
def playing(seconds: float) -> Iterator[str]:
    """Play the flight in real time, in a process. Yields the path of its pseudo-terminal."""
    started: Any = multiprocessing.Queue()
    player = multiprocessing.Process(target=_play, args=(seconds, started), daemon=True)
    player.start()
    yield started.get(timeout=60)
    player.terminate()
    player.join()


def _play(seconds: float, started: Any) -> None:
    encoder, clock = Encoder(1, 1), RealClock()
    data = [packets(encoder, n) for n in range(round(seconds * POSE_HZ))]
    with closing(PtyLink()) as link:
        start = clock.now()
        started.put(link.path)
        for n, chunk in enumerate(data):
            clock.wait(start + n / POSE_HZ)
            link.read()
            link.write(chunk)
