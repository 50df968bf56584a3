"""The clock, pose track and home of one vehicle, from messages that may be wrong, and the events about them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, Generic, Literal, TypeVar

from arva_hil.autopilot.following.pose_track import AttitudeSample, ClockMap, PoseTrack, PositionSample, VehicleState
from arva_hil.events import Event
from arva_hil.events.vehicles import ClockLeapt, PositionJumped
from arva_hil.mavlink.codec import dialect
from arva_hil.model.field.geodesy import LocalFrame

T = TypeVar("T")
Judgement = Literal["follows", "stray", "anew"]

_SETTLE_S: Final = 0.5


class Plausibility(Generic[T]):
    """Remembers the last value that was accepted, and the last one that was not.

    A value that cannot follow the last accepted one is an outlier. Two outliers in a row that fit each other replace an
    accepted value that is at least 0.5 s old: a new start. So a single outlier changes nothing, and of two sources at
    the same time the first one is used.

    - `follows(old, new, gap_s)`: returns True if `new` can come `gap_s` after `old`.
    - `best(old, new)`: returns the one of two accepted values to remember; by default the new one.
    """

    def __init__(self, follows: Callable[[T, T, float], bool], best: Callable[[T, T], T] | None = None) -> None:
        self.strays = 0
        self.replaced: T | None = None  # the value before the last new start
        self._follows = follows
        self._best = best
        self._believed: T | None = None
        self._believed_at = -math.inf
        self._doubted: tuple[T, float] | None = None

    def judge(self, value: T, now: float) -> Judgement:
        """Judge a value received at `now` [s]."""
        believed, since_s, doubted = self._believed, now - self._believed_at, self._doubted
        if believed is None or self._follows(believed, value, since_s):
            if self._best and believed is not None:
                value = self._best(believed, value)
            self._believed, self._believed_at, self._doubted = value, now, None
            return "follows"
        if doubted and since_s >= _SETTLE_S and self._follows(doubted[0], value, now - doubted[1]):
            self.replaced = believed
            self._believed, self._believed_at, self._doubted = value, now, None
            return "anew"
        self._doubted = value, now
        self.strays += 1
        return "stray"

    def forget(self) -> None:
        """Accept the next value, whatever it is."""
        self._believed = self._doubted = None


Place = tuple[float, float, float]  # degrees, degrees, metres AMSL

_REORDER_S: Final = 0.5  # a boot time further back than this is a reboot, not a late packet
_AHEAD_S: Final = 10.0  # boot time may be this far ahead of the expected one
_FASTEST: Final = 20.0  # a simulator's clock may be this many times faster than ours
_JUMP_M: Final = 100.0  # an estimator may correct itself by this much
_SPEED_MS: Final = 100.0
_LOWEST_M: Final = -1_000.0
_HIGHEST_M: Final = 100_000.0
_LARGEST_ANGLES: Final = 8.0**2  # radians², the sum of squares; yaw comes as 0…2π or as ±π
_LARGEST_RATES: Final = 100.0**2  # rad²/s², likewise
_M_PER_DEG: Final = 111_320.0
_HOME: Final = dialect.MAVLINK_MSG_ID_HOME_POSITION
_POSITION: Final = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
_ATTITUDE: Final = dialect.MAVLINK_MSG_ID_ATTITUDE
_QUATERNION: Final = dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION
HANDLED: Final = frozenset({_POSITION, _ATTITUDE, _QUATERNION, _HOME})  # by `Navigation.on_message`


class Navigation:
    """Remembers the clock, the poses and the home by the vehicle's own messages. Times are host seconds.

    `vehicle`: its name in events, which go to `emit`.

    Counters of values that are not used: `refused` (no valid pose), `unpositioned` (positions before the first fix),
    `strays` of `times` and `places` (single values that do not fit those before). Counters of changes that are
    accepted: `reboots`, `leaps` of the vehicle's clock ahead, `jumps` of its position.
    """

    def __init__(self, vehicle: str, emit: Callable[[Event], None]) -> None:
        self.track = PoseTrack()
        self.clock = ClockMap()
        self.home: Place | None = None
        self.refused = 0
        self.unpositioned = 0
        self.reboots = 0
        self.leaps = 0
        self.jumps = 0
        self._vehicle = vehicle
        self._emit = emit
        self.times = Plausibility(self._time_follows, best=max)
        self.places = Plausibility(_place_follows)
        self._reorder_s = _REORDER_S
        self._stamped: dict[int, Callable[[Any, float, float], None]] = {
            _POSITION: self._on_position,
            _ATTITUDE: self._on_attitude,
            _QUATERNION: self._on_quaternion,
        }

    def on_message(self, message: Any, now: float) -> Judgement:
        """Use a `HANDLED` message. Returns "anew" if the vehicle has rebooted: its boot time has gone back."""
        if message.id == _HOME:
            self._on_home(message)
            return "follows"
        boot = message.time_boot_ms / 1e3
        judgement = self.times.judge(boot, now)
        if judgement == "stray":
            self.unpositioned += is_zero(message)  # without a fix some autopilots send no time either
            return judgement
        if judgement == "anew":
            before = self.times.replaced
            if before is None or boot < before:
                self._on_reboot()
            else:
                self._on_leap(boot - before, now)
                judgement = "follows"
        self._reorder_s = _REORDER_S
        self.clock.add(now, boot)
        self._stamped[message.id](message, boot, now)
        return judgement

    def state_at(self, now: float, frame: LocalFrame) -> VehicleState | None:
        """Return the vehicle's pose at host time `now` in the NED frame `frame`, None if it is unknown."""
        return self.track.at(self.clock.boot(now), frame)

    def is_known(self, now: float) -> bool:
        """Return True if no later message can change the pose at host time `now`."""
        return self.track.is_known(self.clock.boot(now))

    def renew(self) -> None:
        """Handle a new link: no late packets of the old link can come."""
        self._reorder_s = 0.0
        self.home = None

    def _time_follows(self, old: float, new: float, gap_s: float) -> bool:
        return -self._reorder_s <= new - old <= _AHEAD_S + _FASTEST * gap_s

    def _on_reboot(self) -> None:
        self.reboots += 1
        self.track = PoseTrack()
        self.clock = ClockMap()
        self.home = None
        self.places.forget()

    def _on_leap(self, ahead_s: float, now: float) -> None:
        """Handle a leap: earlier packets were delayed, so the vehicle may be far from its earlier place."""
        self.leaps += 1
        self.places.forget()
        self._emit(ClockLeapt(now, self._vehicle, ahead_s))

    def _on_position(self, message: Any, boot: float, now: float) -> None:
        if message.lat == message.lon == 0:
            self.unpositioned += 1
            return
        place, velocity = place_of(message)
        if not is_place(place):
            self.refused += 1
            return
        judgement = self.places.judge(place, now)
        if judgement == "stray":
            return
        if judgement == "anew" and (before := self.track.last_position):
            self.jumps += 1
            self.track.forget_positions()  # the vehicle was never between the two sides of the jump
            self._emit(PositionJumped(now, self._vehicle, math.hypot(*offset_m(before[1:4], place))))
        self.track.add_position(PositionSample(boot, *place, velocity))

    def _on_attitude(self, message: Any, boot: float, now: float) -> None:
        roll, pitch, yaw = angles = message.roll, message.pitch, message.yaw
        self._add_attitude(message, boot, angles, _square(roll, pitch, yaw) < _LARGEST_ANGLES)

    def _on_quaternion(self, message: Any, boot: float, now: float) -> None:
        w, x, y, z = quaternion = message.q1, message.q2, message.q3, message.q4
        self._add_attitude(message, boot, quaternion, 0.9 < w * w + _square(x, y, z) < 1.1)

    def _add_attitude(self, message: Any, boot: float, angles: tuple[float, ...], possible: bool) -> None:
        p, q, r = rates = message.rollspeed, message.pitchspeed, message.yawspeed
        if possible and _square(p, q, r) < _LARGEST_RATES:
            self.track.add_attitude(AttitudeSample(boot, angles, rates))
        else:
            self.refused += 1

    def _on_home(self, message: Any) -> None:
        home = message.latitude / 1e7, message.longitude / 1e7, message.altitude / 1e3
        if is_place(home) and home[:2] != (0, 0):
            self.home = home
        else:
            self.refused += 1


def place_of(message: Any) -> tuple[Place, tuple[float, float, float]]:
    """Return the place and the velocity [m/s, NED] of a GLOBAL_POSITION_INT."""
    velocity = message.vx / 100, message.vy / 100, message.vz / 100
    return (message.lat / 1e7, message.lon / 1e7, message.alt / 1e3), velocity


def _square(x: float, y: float, z: float) -> float:
    """Return the squared length; NaN if a value is NaN, so that every comparison is false."""
    return x * x + y * y + z * z


def is_zero(message: Any) -> bool:
    """Return True if the position is 0° north, 0° east, which means that there is no position."""
    return bool(message.id == _POSITION and message.lat == message.lon == 0)


def is_place(place: Place) -> bool:
    """Return True if the values are possible. Comparisons with NaN are false."""
    lat, lon, alt = place
    return -90 <= lat <= 90 and -180 <= lon <= 180 and _LOWEST_M <= alt <= _HIGHEST_M


def _place_follows(old: Place, new: Place, gap_s: float) -> bool:
    north = (new[0] - old[0]) * _M_PER_DEG  # `offset_m` inlined: each position comes here
    east = ((new[1] - old[1] + 180) % 360 - 180) * _M_PER_DEG * math.cos(math.radians(old[0]))
    return math.hypot(north, east, new[2] - old[2]) <= _JUMP_M + _SPEED_MS * gap_s


def offset_m(a: Place, b: Place) -> tuple[float, float, float]:
    """Return the approximate offset north, east and down [m] from one place to another, on a sphere."""
    east = (b[1] - a[1] + 180) % 360 - 180
    return (b[0] - a[0]) * _M_PER_DEG, east * _M_PER_DEG * math.cos(math.radians(a[0])), a[2] - b[2]
