"""The clock, pose track and home of one vehicle, from messages that may be wrong, and the events about them.

The pose track has the pose at any instant, from samples of different messages at different rates. Two recorded square
flights gave the limits of extrapolation. Half a second ahead, constant body rates double the error of the tilt against
rates that stop after 0.15 s. A held heading doubles the error against a constant turn.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any, Final, Generic, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from arva_hil.events.vehicles import ClockLeapt, PositionJumped
from arva_hil.mavlink.codec import dialect
from arva_hil.model.field.geodesy import LocalFrame
from arva_hil.model.field.rotation import Quaternion, from_angles, multiply, slerp, unit

_WINDOW_S: Final = 1.0
_STALL_S: Final = 0.5  # count a longer silence as this long in the window
_LONGEST_STALL_S: Final = 5.0  # after a silence of this length the clocks may have drifted apart
_LEARN_S: Final = 2.0  # for measuring the rate of a clock
_FASTEST: Final = 20.0  # a simulator's clock may be this much faster than ours


class ClockMap:
    """Remembers the delays of the samples of the last second (`window_s`), and uses the smallest one.

    For a sample with time stamp `boot`, received at `host`: host − boot = offset + delay, with delay ≥ 0. The smallest
    difference is the offset, so a pose at a converted time is never from the future. The window is short because the
    clocks of autopilots run at other rates than the host's (a simulator's was measured 1.5 % slow, in steps of 0.15 s).
    A second with delays makes the pose older, never newer. Samples that come in a burst after a stall of the link were
    late: they are compared with the samples before the stall, otherwise they would seem new.
    """

    def __init__(self, window_s: float = _WINDOW_S) -> None:
        self._window_s = window_s
        self._first: tuple[float, float] | None = None
        self._samples: deque[tuple[float, float]] = deque()  # (host, offset), offsets ascending: a sliding minimum
        self._newest = -math.inf

    def add(self, host: float, boot: float) -> None:
        """Add a sample; both times in seconds."""
        offset, silence = host - boot, host - self._newest
        samples = self._samples
        if silence > 0:
            self._newest = host
            if self._first is None:
                self._first = host, boot
            if _STALL_S < silence <= _LONGEST_STALL_S:
                samples = self._samples = deque((at + silence - _STALL_S, least) for at, least in samples)
        while samples and samples[-1][1] >= offset:
            samples.pop()
        samples.append((host, offset))
        while len(samples) > 1 and samples[0][0] < host - self._window_s:
            samples.popleft()

    def boot(self, host: float) -> float | None:
        """Return the autopilot's boot time [s] at host time `host`; None before the first sample."""
        return host - self._samples[0][1] if self._samples else None

    @property
    def rate(self) -> float:
        """Seconds of boot time per second of host time: 1, except for a simulator that runs faster than real time."""
        if not self._samples or self._first is None:
            return 1.0
        (first, boot), (last, offset) = self._first, self._samples[-1]
        return min(max((last - offset - boot) / (last - first), 1.0), _FASTEST) if last - first > _LEARN_S else 1.0


_TILT_S: Final = 0.15
_HEADING_S: Final = 0.5
_MOST_TURN: Final = math.pi / 6  # rad, by body rates
_MOST_HEADING: Final = math.pi / 3  # rad, by the turn about the vertical


def attitude_ahead(sample: AttitudeSample, ahead_s: float) -> Quaternion:
    """Return the attitude, body FRD → NED, `ahead_s` after a sample.

    It is extrapolated with the body rates [rad/s] for 0.15 s and at most 30°, then with the turn about the vertical
    until 0.5 s and at most 60°, then it is held.
    """
    q, (p, r, y) = sample.quaternion, sample.rates
    speed = math.hypot(p, r, y)
    half = min(speed * min(ahead_s, _TILT_S), _MOST_TURN) / 2
    along = math.sin(half) / speed if speed else 0.0
    turned = multiply(q, (math.cos(half), p * along, r * along, y * along))
    if ahead_s <= _TILT_S:
        return turned
    qw, qx, qy, qz = q
    about_down = 2 * (qx * qz - qw * qy) * p + 2 * (qy * qz + qw * qx) * r + (1 - 2 * (qx * qx + qy * qy)) * y
    heading = about_down * (min(ahead_s, _HEADING_S) - _TILT_S)
    half = max(-_MOST_HEADING, min(heading, _MOST_HEADING)) / 2
    return multiply((math.cos(half), 0.0, 0.0, math.sin(half)), turned)


Vector = NDArray[np.float64]

_KEEP_S: Final = 15.0  # longer than the longest latency of a scenario
_KEEP_SAMPLES: Final = 8192  # 20 s at the fastest stream
_WIDEST_GAP_S: Final = 2.0  # no interpolation between samples that are further apart


class PositionSample(NamedTuple):
    """WGS-84 degrees, metres AMSL; velocity NED in m/s; boot time in seconds."""

    boot: float
    lat: float
    lon: float
    alt: float
    velocity: tuple[float, float, float]

    @property
    def place(self) -> Place:
        """Its degrees, degrees and metres."""
        return self.lat, self.lon, self.alt

    @property
    def frame(self) -> LocalFrame:
        """The NED frame with its origin there."""
        return LocalFrame(*self.place)


class AttitudeSample(NamedTuple):
    """One attitude as it was received, because most samples are never used.

    Roll, pitch, yaw in radians or a quaternion (w, x, y, z), body FRD → NED; body rates in rad/s; boot time in seconds.
    """

    boot: float
    angles: tuple[float, ...]
    rates: tuple[float, float, float]

    @property
    def quaternion(self) -> Quaternion:
        """Of length 1."""
        return from_angles(*self.angles) if len(self.angles) == 3 else unit(*self.angles)


class VehicleState(NamedTuple):
    """The vehicle at one instant of the autopilot's clock.

    `boot_s` [s]; `position` NED [m] from the datum; `velocity` NED [m/s]; `attitude` quaternion (w, x, y, z) body
    FRD → NED; `age_s` [s]: from the older of the samples used to `boot_s`.
    """

    boot_s: float
    position: Vector
    velocity: Vector
    attitude: Quaternion
    age_s: float


S = TypeVar("S", PositionSample, AttitudeSample)


class Samples(deque[S]):
    """The samples of the last 15 s, in the order of their boot times."""

    def __init__(self) -> None:
        super().__init__(maxlen=_KEEP_SAMPLES)

    def add(self, sample: S) -> None:
        """Add a sample. One that comes late or twice is dropped."""
        boot = sample.boot
        if self and boot <= self[-1].boot:
            return
        self.append(sample)
        oldest = boot - _KEEP_S
        while self[0].boot < oldest:
            self.popleft()

    def around(self, boot: float) -> tuple[S, S | None] | None:
        """Return the last sample at or before `boot`, and the next one if it is near enough to interpolate."""
        after: S | None = None
        for sample in reversed(self):
            if sample.boot <= boot:
                near = after is not None and after.boot - sample.boot <= _WIDEST_GAP_S
                return sample, after if near else None
            after = sample
        return None


class PoseTrack:
    """Remembers the last seconds of `positions` and `attitudes`.

    Between two samples the pose is interpolated (position: cubic Hermite with the velocities of both; attitude: slerp).
    After the newest sample it is extrapolated: the position with its velocity, the attitude for some time with its body
    rates (`attitude_ahead`). Before the first sample there is no pose.
    """

    def __init__(self) -> None:
        self.positions = Samples[PositionSample]()
        self.attitudes = Samples[AttitudeSample]()

    @property
    def newest(self) -> float | None:
        """The boot time [s] up to which both position and attitude are known."""
        if not self.positions or not self.attitudes:
            return None
        return min(self.positions[-1].boot, self.attitudes[-1].boot)

    @property
    def last_position(self) -> PositionSample | None:
        """The newest position."""
        return self.positions[-1] if self.positions else None

    def is_known(self, boot: float | None) -> bool:
        """Return True if no later sample can change the pose at boot time `boot` [s]; true before the first sample."""
        newest = self.newest
        return boot is None or newest is None or newest >= boot

    def at(self, boot: float | None, frame: LocalFrame) -> VehicleState | None:
        """Return the pose at boot time `boot` [s] in the NED frame `frame`; None if it is not known."""
        if boot is None:
            return None
        position = self.positions.around(boot)
        attitude = self.attitudes.around(boot)
        if position is None or attitude is None:
            return None
        where, velocity = _position_at(boot, *position, frame)
        age = boot - min(position[0].boot, attitude[0].boot)
        a, b = attitude
        if b is not None:
            there = slerp(a.quaternion, b.quaternion, (boot - a.boot) / (b.boot - a.boot))
        else:
            there = attitude_ahead(a, boot - a.boot)
        return VehicleState(boot, where, velocity, there, age)


def _position_at(boot: float, a: PositionSample, b: PositionSample | None, frame: LocalFrame) -> tuple[Vector, Vector]:
    there = frame.ned_of(a.lat, a.lon, a.alt)
    if b is None:
        later, (north, east, down), (vn, ve, vd) = boot - a.boot, there, a.velocity
        return np.array((north + vn * later, east + ve * later, down + vd * later)), np.array(a.velocity)
    span = b.boot - a.boot
    u = (boot - a.boot) / span
    places, velocities = [], []
    for pa, va, pb, vb in zip(there, a.velocity, frame.ned_of(b.lat, b.lon, b.alt), b.velocity, strict=True):
        # cubic Hermite from a: p(u) = pa + u·(span·va + u·(c2 + u·c3))
        c3 = span * (va + vb) - 2 * (pb - pa)
        c2 = (pb - pa) - span * va - c3
        places.append(pa + u * (span * va + u * (c2 + u * c3)))
        velocities.append(va + u * (2 * c2 + 3 * u * c3) / span)
    return np.array(places), np.array(velocities)


T = TypeVar("T")
Emit = Callable[..., None]
"""Emits an event of the vehicle: its class, the time [s], and its own values."""
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
_JUMP_M: Final = 100.0  # an estimator may correct itself by this much
_SPEED_MS: Final = 100.0
_LOWEST_M: Final = -1_000.0
_HIGHEST_M: Final = 100_000.0
_LARGEST_ANGLES: Final = 8.0  # radians, of all three together; yaw comes as 0…2π or as ±π
_LARGEST_RATES: Final = 100.0  # rad/s, likewise
_M_PER_DEG: Final = 111_320.0
_HOME: Final = dialect.MAVLINK_MSG_ID_HOME_POSITION
_POSITION: Final = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT


class Navigation:
    """Remembers the clock, the poses and the home by the vehicle's own messages. Times are host seconds.

    `emit`: emits an event of the vehicle, from its class, the time and its values.

    Counters of values that are not used: `refused` (no valid pose), `unpositioned` (positions before the first fix),
    `strays` of `times` and `places` (single values that do not fit those before). Counters of changes that are
    accepted: `reboots`, `leaps` of the vehicle's clock ahead, `jumps` of its position.
    """

    def __init__(self, emit: Emit) -> None:
        self.track = PoseTrack()
        self.clock = ClockMap()
        self.home: Place | None = None
        self.refused = 0
        self.unpositioned = 0
        self.reboots = 0
        self.leaps = 0
        self.jumps = 0
        self._emit = emit
        self.times = Plausibility(self._time_follows, best=max)
        self.places = Plausibility(_place_follows)
        self._reorder_s = _REORDER_S

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
        _STAMPED[message.id](self, message, boot, now)
        return judgement

    def state_at(self, now: float, frame: LocalFrame) -> VehicleState | None:
        """Return the vehicle's pose at host time `now` in the NED frame `frame`, None if it is unknown."""
        return self.track.at(self.clock.boot(now), frame)

    def is_known(self, now: float) -> bool:
        """Return True if no later message can change the pose at host time `now`."""
        return self.track.is_known(self.clock.boot(now))

    def restart(self) -> None:
        """Handle another vehicle in place of the last one, as after a reboot."""
        self.times.forget()
        self._on_reboot()

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
        self._emit(ClockLeapt, now, ahead_s)

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
            self.track.positions.clear()  # the vehicle was never between the two sides of the jump
            self._emit(PositionJumped, now, math.hypot(*offset_m(before.place, place)))
        self.track.positions.add(PositionSample(boot, *place, velocity))

    def _on_attitude(self, message: Any, boot: float, now: float) -> None:
        angles = message.roll, message.pitch, message.yaw
        self._add_attitude(message, boot, angles, math.hypot(*angles) < _LARGEST_ANGLES)

    def _on_quaternion(self, message: Any, boot: float, now: float) -> None:
        quaternion = message.q1, message.q2, message.q3, message.q4
        self._add_attitude(message, boot, quaternion, 0.9 < math.hypot(*quaternion) ** 2 < 1.1)

    def _add_attitude(self, message: Any, boot: float, angles: tuple[float, ...], possible: bool) -> None:
        rates = message.rollspeed, message.pitchspeed, message.yawspeed
        if possible and math.hypot(*rates) < _LARGEST_RATES:  # false for NaN
            self.track.attitudes.add(AttitudeSample(boot, angles, rates))
        else:
            self.refused += 1

    def _on_home(self, message: Any) -> None:
        home = message.latitude / 1e7, message.longitude / 1e7, message.altitude / 1e3
        if is_place(home) and home[:2] != (0, 0):
            self.home = home
        else:
            self.refused += 1


_STAMPED: Final = {
    _POSITION: Navigation._on_position,
    dialect.MAVLINK_MSG_ID_ATTITUDE: Navigation._on_attitude,
    dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: Navigation._on_quaternion,
}
HANDLED: Final = frozenset({*_STAMPED, _HOME})  # by `Navigation.on_message`


def place_of(message: Any) -> tuple[Place, tuple[float, float, float]]:
    """Return the place and the velocity [m/s, NED] of a GLOBAL_POSITION_INT."""
    velocity = message.vx / 100, message.vy / 100, message.vz / 100
    return (message.lat / 1e7, message.lon / 1e7, message.alt / 1e3), velocity


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
