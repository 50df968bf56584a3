"""The pose track: the pose at any instant, from samples of different messages at different rates; and the clock map.

The limits of extrapolation are from two recorded square flights. Half a second ahead, constant body rates double the
error of the tilt compared with rates that stop after 0.15 s. A held heading doubles the error compared with a constant
turn.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from arva_hil.model.field import quaternion
from arva_hil.model.field.geodesy import LocalFrame
from arva_hil.model.field.quaternion import Quaternion, multiply

_WINDOW_S: Final = 1.0
_STALL_S: Final = 0.5  # count a longer silence as this long in the window
_LONGEST_STALL_S: Final = 5.0  # after a silence of this length the clocks may have drifted apart
_LEARN_S: Final = 2.0  # for measuring the rate of a clock
_FASTEST: Final = 20.0


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

_KEEP_S: Final = 10.0
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
    def frame(self) -> LocalFrame:
        """The NED frame with its origin there."""
        return LocalFrame(self.lat, self.lon, self.alt)


class AttitudeSample(NamedTuple):
    """One attitude as it was received, because most samples are never used.

    Roll, pitch, yaw in radians or a quaternion (w, x, y, z), body FRD → NED; body rates in rad/s; boot time in seconds.
    """

    boot: float
    angles: tuple[float, ...]
    rates: tuple[float, float, float]

    @property
    def quaternion(self) -> quaternion.Quaternion:
        """Of length 1."""
        return quaternion.from_euler(*self.angles) if len(self.angles) == 3 else quaternion.unit(*self.angles)


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


class PoseTrack:
    """Remembers the last seconds of position and attitude.

    Between two samples the pose is interpolated (position: cubic Hermite with the velocities of both; attitude: slerp).
    After the newest sample it is extrapolated: the position with its velocity, the attitude for some time with its body
    rates (`attitude_ahead`). Before the first sample there is no pose.
    """

    def __init__(self) -> None:
        self._positions: deque[PositionSample] = deque(maxlen=_KEEP_SAMPLES)
        self._attitudes: deque[AttitudeSample] = deque(maxlen=_KEEP_SAMPLES)

    def add_position(self, sample: PositionSample) -> None:
        _append(self._positions, sample)

    def add_attitude(self, sample: AttitudeSample) -> None:
        _append(self._attitudes, sample)

    def forget_positions(self) -> None:
        """Forget all positions: the next ones do not follow from them."""
        self._positions.clear()

    @property
    def newest(self) -> float | None:
        """The boot time [s] up to which both position and attitude are known."""
        if not self._positions or not self._attitudes:
            return None
        return min(self._positions[-1].boot, self._attitudes[-1].boot)

    @property
    def first_position(self) -> PositionSample | None:
        """The oldest position that is remembered."""
        return self._positions[0] if self._positions else None

    @property
    def last_position(self) -> PositionSample | None:
        """The newest position."""
        return self._positions[-1] if self._positions else None

    def is_known(self, boot: float | None) -> bool:
        """Return True if no later sample can change the pose at boot time `boot` [s]; true before the first sample."""
        newest = self.newest
        return boot is None or newest is None or newest >= boot

    def at(self, boot: float | None, frame: LocalFrame) -> VehicleState | None:
        """Return the pose at boot time `boot` [s] in the NED frame `frame`; None if it is not known."""
        if boot is None:
            return None
        position = _around(self._positions, boot)
        attitude = _around(self._attitudes, boot)
        if position is None or attitude is None:
            return None
        where, velocity = _position_at(boot, *position, frame)
        age = boot - min(position[0].boot, attitude[0].boot)
        a, b = attitude
        if b is not None:
            there = quaternion.slerp(a.quaternion, b.quaternion, (boot - a.boot) / (b.boot - a.boot))
        else:
            there = attitude_ahead(a, boot - a.boot)
        return VehicleState(boot, where, velocity, there, age)


def _append(samples: deque[S], sample: S) -> None:
    """Append a sample. One that comes late or twice is dropped."""
    boot = sample[0]
    if samples and boot <= samples[-1][0]:
        return
    samples.append(sample)
    oldest = boot - _KEEP_S
    while samples[0][0] < oldest:
        samples.popleft()


def _around(samples: deque[S], boot: float) -> tuple[S, S | None] | None:
    """Return the last sample at or before `boot`, and the next one if it is near enough to interpolate."""
    after: S | None = None
    for sample in reversed(samples):
        if sample.boot <= boot:
            near = after is not None and after.boot - sample.boot <= _WIDEST_GAP_S
            return sample, after if near else None
        after = sample
    return None


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
