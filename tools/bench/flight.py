"""A recorded flight as a live stream of an autopilot on a pseudo-terminal."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, RotationSpline

from arva_hil.clock import RealClock
from arva_hil.links.pty import PtyLink
from arva_hil.links.tlog import TlogReader
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.model.field import LocalFrame

POSES_HZ: Final = 50.0
_AUTOPILOT: Final = Encoder(1, 1)
_ATTITUDE: Final = dialect.MAVLINK_MSG_ID_ATTITUDE
_POSITION: Final = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT


class Motion:
    """The motion of a recorded flight, smooth between its samples.

    Position: cubic Hermite through GLOBAL_POSITION_INT; attitude: a spline through ATTITUDE. By scipy.
    """

    def __init__(self, flight: Path) -> None:
        self.name = flight.name
        positions, attitudes = {}, {}
        parser = Parser()
        with closing(TlogReader(flight)) as log:
            for record in log:
                for packet in parser.feed(record.raw):
                    if packet.component == 1 and packet.msgid == _POSITION:
                        m: Any = decode(packet)
                        here = (m.lat / 1e7, m.lon / 1e7, m.alt / 1e3, m.vx / 100, m.vy / 100, m.vz / 100)
                        positions[m.time_boot_ms / 1e3] = here
                    elif packet.component == 1 and packet.msgid == _ATTITUDE:
                        m = decode(packet)
                        attitudes[m.time_boot_ms / 1e3] = (m.yaw, m.pitch, m.roll)
        where = np.array(list(positions.values()))
        self.home = tuple(where[0, :3])
        ned = np.array([LocalFrame(*self.home).ned(*row[:3]) for row in where])
        start = max(min(positions), min(attitudes))
        self.seconds = min(max(positions), max(attitudes)) - start
        self._position = CubicHermiteSpline(np.array(list(positions)) - start, ned, where[:, 3:])
        self._attitude = RotationSpline(
            np.array(list(attitudes)) - start, Rotation.from_euler("ZYX", list(attitudes.values()))
        )
        self._frame = LocalFrame(*self.home)

    def packets(self, t: float) -> bytes:
        """Return the packets of position and attitude; `t` in whole milliseconds."""
        ned, velocity = self._position(t), self._position(t, 1)
        lat, lon, alt = map(float, self._frame.lla(ned))
        yaw, pitch, roll = self._attitude(t).as_euler("ZYX")
        rates = self._attitude(t, 1)
        ms = round(t * 1e3)
        position = dialect.MAVLink_global_position_int_message(
            ms, round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), 0, *(round(v * 100) for v in velocity), 0
        )
        attitude = dialect.MAVLink_attitude_message(ms, roll, pitch, yaw, *rates)
        return _AUTOPILOT.pack(position) + _AUTOPILOT.pack(attitude)

    def beat(self) -> bytes:
        """Return heartbeat and home."""
        lat, lon, alt = self.home
        heartbeat = dialect.MAVLink_heartbeat_message(2, 3, 0x81, 4, 4, 3)
        home = dialect.MAVLink_home_position_message(
            round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
        )
        return _AUTOPILOT.pack(heartbeat) + _AUTOPILOT.pack(home)


def _play(motion: Motion, seconds: float, started: Any) -> None:
    """Play the motion on a new pty in real time, in its own process. Sends the path."""
    times = np.arange(0, seconds, 1 / POSES_HZ).round(3)
    packets = [(motion.beat() if n % POSES_HZ == 0 else b"") + motion.packets(t) for n, t in enumerate(times)]
    clock = RealClock()
    with closing(PtyLink()) as link:
        start = clock.now()
        started.put(link.path)
        for t, data in zip(times, packets, strict=True):
            clock.wait(start + t)
            link.read()
            link.write(data)


@contextmanager
def playing(motion: Motion, seconds: float) -> Iterator[str]:
    """Yield the pty of the motion."""
    started: Any = multiprocessing.Queue()
    player = multiprocessing.Process(target=_play, args=(motion, seconds, started), daemon=True)
    player.start()
    yield started.get(timeout=60)
    player.terminate()
    player.join()
