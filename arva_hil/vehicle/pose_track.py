"""The pose track: computes the pose at any instant from samples of different messages at different rates."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from arva_hil.field import quaternion
from arva_hil.field.geodesy import LocalFrame
from arva_hil.vehicle.extrapolation import attitude_ahead

Vector = NDArray[np.float64]

_KEEP_S: Final = 10.0
_KEEP_SAMPLES: Final = 8192  # 10 s at the fastest stream there is, twice over
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
    """Roll, pitch, yaw in radians or a quaternion (w, x, y, z), body FRD → NED; body rates in rad/s; boot time in
    seconds. Most samples are never looked at, so they are kept as they came.
    """

    boot: float
    angles: tuple[float, ...]
    rates: tuple[float, float, float]

    @property
    def quaternion(self) -> quaternion.Quaternion:
        """Of length 1."""
        return quaternion.from_euler(*self.angles) if len(self.angles) == 3 else quaternion.unit(*self.angles)


@dataclass(frozen=True, slots=True)
class VehicleState:
    """The vehicle at one instant of the autopilot's clock.

    `boot_s` [s]; `position` NED [m] from the datum; `velocity` NED [m/s]; `attitude` quaternion (w, x, y, z) body
    FRD → NED; `age_s` [s]: from the older of the samples used to `boot_s`.
    """

    boot_s: float
    position: Vector
    velocity: Vector
    attitude: Vector
    age_s: float


class _Stamped(Protocol):
    @property
    def boot(self) -> float: ...


S = TypeVar("S", bound=_Stamped)


class PoseTrack:
    """Remembers the last seconds of position and attitude.

    Between two samples the pose is interpolated (position: cubic Hermite with the velocities of both; attitude: slerp).
    After the newest sample it is extrapolated: the position with its velocity, the attitude for some time with its body
    rates (`extrapolation.py`). Before the first sample there is no pose.
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

    def at(self, boot: float, frame: LocalFrame) -> VehicleState | None:
        """The pose at boot time `boot` [s] in the NED frame `frame`; None if position or attitude is unknown."""
        position = _around(self._positions, boot)
        attitude = _around(self._attitudes, boot)
        if position is None or attitude is None:
            return None
        where, velocity = _position_at(boot, *position, frame)
        age = boot - min(position[0].boot, attitude[0].boot)
        return VehicleState(boot, where, velocity, _attitude_at(boot, *attitude), age)


def _append(samples: deque[S], sample: S) -> None:
    """Append a sample. One that comes late or twice is dropped."""
    boot = sample.boot
    if samples and boot <= samples[-1].boot:
        return
    samples.append(sample)
    oldest = boot - _KEEP_S
    while samples[0].boot < oldest:
        samples.popleft()


def _around(samples: deque[S], boot: float) -> tuple[S, S | None] | None:
    """The last sample at or before `boot`, and the next one if it is near enough to interpolate."""
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
        later = boot - a.boot
        return np.array([p + v * later for p, v in zip(there, a.velocity, strict=True)]), np.array(a.velocity)
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


def _attitude_at(boot: float, a: AttitudeSample, b: AttitudeSample | None) -> Vector:
    if b is not None:
        return np.array(quaternion.slerp(a.quaternion, b.quaternion, (boot - a.boot) / (b.boot - a.boot)))
    return np.array(attitude_ahead(a.angles, a.rates, boot - a.boot))
