"""A vehicle at a place or on a path that a test sets. It reports its pose in MAVLink."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.model.field import rotation
from arva_hil.simulated.multirotor import Vector
from arva_hil.simulated.position import Home
from arva_hil.simulated.vehicle import Truth

_HEARTBEAT_S: Final = 1.0
_SAMPLE_HZ: Final = 1.0  # the lowest rate; a pose is too old after 2 s
_FLIES: Final = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | dialect.MAV_MODE_FLAG_SAFETY_ARMED
_KIND: Final = dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, _FLIES, 4, dialect.MAV_STATE_ACTIVE, 3
_STILL: Final = (0.0, 0.0, 0.0)


class PathPoint(NamedTuple):
    """A point of a path. `time_s`: on the caller's clock; NED from home in metres; `yaw` in radians."""

    time_s: float
    ned: Vector
    yaw: float


class PathVehicle:
    """A vehicle on a path, and the time of its next sample.

    Between two points the vehicle flies straight on, and turns in the direction of the smaller angle. Before the first
    and after the last point it hovers.

    - `home`: degrees, degrees, metres above mean sea level.
    - `boot_time`: the vehicle is switched on then, and sends its home.
    - `start`, `rate_hz`: samples are due at `start` + n / `rate_hz`, as the frames of a receiver with this rate are.
    """

    def __init__(self, home: tuple[float, float, float], *, boot_time: float, start: float, rate_hz: float) -> None:
        self._home = Home(*home)
        self._encoder = Encoder(1, dialect.MAV_COMP_ID_AUTOPILOT1)
        self._boot_time = boot_time
        self._start = start
        self._rate_hz = max(rate_hz, _SAMPLE_HZ)
        self._samples = 0  # of the grid
        self._next_heartbeat = boot_time
        self._path = [PathPoint(boot_time, (0.0, 0.0, 0.0), 0.0)]
        self.next_due = boot_time

    def follow(self, points: Sequence[PathPoint], now: float) -> None:
        """Follow a path from `now` on. Raises ValueError if its times do not increase."""
        if not points or any(one.time_s >= two.time_s for one, two in pairwise(points)):
            raise ValueError("a path needs points, each with a later time than the point before it")
        self._path = list(points)
        self.next_due = min(self.next_due, now)

    def poll(self, now: float) -> bytes:
        """Return the messages that are due until `now`, with the values of `now`."""
        if now < self.next_due:
            return b""
        boot_ms, messages = round((now - self._boot_time) * 1e3), []
        ned, velocity, yaw = self._at(now)
        lat, lon, alt = self._home.lla_fast(ned)
        place = round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), round(-ned[2] * 1e3)
        speeds = (max(-32767, min(round(v * 100), 32767)) for v in velocity)
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + _HEARTBEAT_S
            messages.append(dialect.MAVLink_heartbeat_message(*_KIND))
        if now < self._start:
            home = self._home.lla(_STILL)
            where = round(home[0] * 1e7), round(home[1] * 1e7), round(home[2] * 1e3)
            messages.append(
                dialect.MAVLink_home_position_message(*where, 0.0, 0.0, 0.0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0)
            )
        messages += [
            dialect.MAVLink_global_position_int_message(
                boot_ms, *place, *speeds, round(math.degrees(yaw) * 100) % 36000
            ),
            dialect.MAVLink_attitude_message(boot_ms, 0.0, 0.0, yaw, *_STILL),
        ]
        self._plan(now)
        return b"".join(map(self._encoder.pack, messages))

    def truth(self, now: float) -> Truth:
        """Return the exact motion at `now`."""
        ned, velocity, yaw = self._at(now)
        return Truth(ned, velocity, rotation.from_angles(0.0, 0.0, yaw), _STILL, self._home.lla_fast(ned))

    def _at(self, now: float) -> tuple[Vector, Vector, float]:
        """Return position, velocity and yaw."""
        after = bisect_right(self._path, now, key=lambda point: point.time_s)
        if after in (0, len(self._path)):
            there = self._path[min(after, len(self._path) - 1)]
            return there.ned, _STILL, there.yaw
        a, b = self._path[after - 1], self._path[after]
        span = b.time_s - a.time_s
        share = (now - a.time_s) / span
        (an, ae, ad), (bn, be, bd) = a.ned, b.ned
        n, e, d = bn - an, be - ae, bd - ad
        yaw = a.yaw + share * math.remainder(b.yaw - a.yaw, math.tau)
        return (an + n * share, ae + e * share, ad + d * share), (n / span, e / span, d / span), yaw

    def _plan(self, now: float) -> None:
        """Set the time of the next sample: at the next instant of the grid or the next point of the path."""
        while (due := self._start + self._samples / self._rate_hz) <= now:
            self._samples += 1
        self.next_due = min([due, *(point.time_s for point in self._path if now < point.time_s < due)])
