"""The motion of a small multirotor in steps of 10 ms, in plain floats.

A velocity loop gives a limited acceleration, which passes two equal first-order lags. The attitude is the one whose
thrust gives that acceleration against gravity and drag; yaw is independent (differential flatness: Mellinger and Kumar,
"Minimum snap trajectory generation and control for quadrotors", ICRA 2011). Between two steps acceleration and body
rates are constant. So at any instant the velocity is exactly the derivative of the position, and the rates are exactly
those of the quaternion.
"""

from __future__ import annotations

import math
from collections import deque
from functools import partial
from math import hypot
from typing import Final, NamedTuple

from arva_hil.model.field.rotation import Quaternion, from_angles

Vector = tuple[float, float, float]

STEP_US: Final = 10_000
_STEP: Final = STEP_US * 1e-6
_HALF: Final = _STEP / 2
_HISTORY: Final = 1000  # steps that `at` can go back

_GRAVITY: Final = 9.80665
_SPEED: Final = 10.0  # horizontal, m/s
_CLIMB: Final = 2.5
_SINK: Final = 1.5
_FLARE: Final = 0.2  # m/s, the largest sink rate at the ground; 1 m/s more for each metre of height
_ACCELERATION: Final = 3.0  # horizontal, m/s²
_LIFT: Final = 2.5  # vertical, m/s²
_GAIN: Final = 2.0  # 1/s, of the velocity loop
_LAG: Final = 1 - math.exp(-_STEP / 0.12)  # of each of the two
_DRAG: Final = 0.2  # 1/s: acceleration per air speed
_YAW_RATE: Final = math.radians(90)
_YAW_LAG: Final = 1 - math.exp(-_STEP / 0.2)
_LEAN_LAG: Final = 1 - math.exp(-_STEP / 0.15)  # of each of two lags: how fast it can tilt after the take-off
_LEGS: Final = 20.0  # 1/s: largest sink rate per metre of height, because of the landing gear
_LEGS_STEP: Final = 1 + _LEGS * _HALF
CONTACT_M: Final = 0.02  # below this it is on the ground
_SETTLE: Final = 1.0  # m/s², down, at rest

# The result of one step: position, velocity, acceleration, tilt (0: upright on the ground … 1: flying), yaw.
_Node = tuple[float, float, float, float, float, float, float, float, float, float, float]


class Motion(NamedTuple):
    """Position and motion of a vehicle at one instant."""

    position: Vector  # NED from home, m
    velocity: Vector  # NED, m/s
    quaternion: Quaternion  # (w, x, y, z), body FRD to NED
    rates: Vector  # about the body axes, rad/s


_motion: Final = partial(tuple.__new__, Motion)  # three times faster than the class


class Multirotor:
    """Remembers the vehicle's motion. The ground is flat, at down = 0; the vehicle is never below it.

    `wind`: velocity of the air, NED, m/s. The powered vehicle tilts against it and does not drift.
    """

    def __init__(self, wind: Vector) -> None:
        self.north = self.east = self.down = 0.0
        self.yaw = 0.0  # radians, never wrapped
        self.steps = 0
        self._wind = wind
        # velocity, acceleration between the two lags, acceleration, yaw rate; tilt between its two lags, tilt
        self._moving = (0.0,) * 12
        self._nodes: deque[_Node] = deque([(0.0,) * 11], maxlen=_HISTORY + 1)

    def step(self, velocity: Vector, yaw_rate: float, powered: bool) -> None:
        """Fly for 10 ms towards a velocity (NED, m/s) and yaw rate (rad/s); unpowered: fall or stay on the ground.

        For speed it uses comparisons instead of min, max and small functions.
        """
        vn, ve, vd, ln, le, ld, fn, fe, fd, turning, lagged, lean = self._moving
        down = self.down
        if powered:
            an, ae, cd = velocity
            if (length := hypot(an, ae)) > _SPEED:
                an, ae = an * (_SPEED / length), ae * (_SPEED / length)
            an, ae = _GAIN * (an - vn), _GAIN * (ae - ve)
            if (length := hypot(an, ae)) > _ACCELERATION:
                an, ae = an * (_ACCELERATION / length), ae * (_ACCELERATION / length)
            most = _FLARE - down
            most = most if most < _SINK else _SINK
            cd = most if cd > most else cd
            ad = _GAIN * ((cd if cd > -_CLIMB else -_CLIMB) - vd)
            ad = -_LIFT if ad < -_LIFT else ad
            ad = _LIFT if ad > _LIFT else ad
            yaw_rate = -_YAW_RATE if yaw_rate < -_YAW_RATE else yaw_rate
            yaw_rate = _YAW_RATE if yaw_rate > _YAW_RATE else yaw_rate
        elif down > -CONTACT_M:
            an, ae, ad, yaw_rate = -_GAIN * vn, -_GAIN * ve, _SETTLE, 0.0
        else:
            wind_n, wind_e, wind_d = self._wind
            an, ae, yaw_rate = _DRAG * (wind_n - vn), _DRAG * (wind_e - ve), 0.0
            ad = _GRAVITY + _DRAG * (wind_d - vd)
        ln, le, ld = ln + (an - ln) * _LAG, le + (ae - le) * _LAG, ld + (ad - ld) * _LAG
        fn, fe, fd = fn + (ln - fn) * _LAG, fe + (le - fe) * _LAG, fd + (ld - fd) * _LAG

        new_n, new_e, new_d = vn + fn * _STEP, ve + fe * _STEP, vd + fd * _STEP
        # On the ground sink rate ≤ _LEGS · height, at both ends of the trapezoid.
        allowed = _LEGS * (-down - vd * _HALF) / _LEGS_STEP
        if new_d > allowed:
            new_d = allowed
        self.north = north = self.north + (vn + new_n) * _HALF
        self.east = east = self.east + (ve + new_e) * _HALF
        down += (vd + new_d) * _HALF
        self.down = down = down if down < 0.0 else 0.0

        turning = turning + (yaw_rate - turning) * _YAW_LAG
        self.yaw = yaw = self.yaw + turning * _STEP
        lagged = lagged + ((powered and down <= -CONTACT_M) - lagged) * _LEAN_LAG
        lean = lean + (lagged - lean) * _LEAN_LAG
        self._moving = new_n, new_e, new_d, ln, le, ld, fn, fe, fd, turning, lagged, lean
        self._nodes.append((north, east, down, new_n, new_e, new_d, fn, fe, fd, lean, yaw))
        self.steps += 1

    def at(self, time_us: int) -> Motion:
        """Return the motion at an instant before the newest step, µs since the start.

        Raises ValueError if it is not remembered, or in the future.
        """
        index, rest = divmod(time_us, STEP_US)
        back = index - self.steps - 1
        if not -len(self._nodes) <= back <= -2:
            raise ValueError(f"the motion at {time_us * 1e-6:.3f} s is not known")
        a, b = self._nodes[back], self._nodes[back + 1]
        q, rates = _turn(self._quaternion(a), self._quaternion(b), rest / STEP_US)
        if not rest:  # the usual case
            return _motion((a[:3], a[3:6], q, rates))
        s = rest * 1e-6
        half, moving = s * s / (2 * _STEP), list(zip(a[:3], a[3:6], b[3:6], strict=True))
        north, east, down = (place + v * s + (w - v) * half for place, v, w in moving)
        velocity = tuple(v + (w - v) * s / _STEP for _, v, w in moving)
        return _motion(((north, east, down), velocity, q, rates))

    def _quaternion(self, node: _Node) -> Quaternion:
        """Return the attitude at a node's yaw with the body z axis against the thrust."""
        _, _, _, vn, ve, vd, fn, fe, fd, lean, yaw = node
        wind_n, wind_e, wind_d = self._wind
        down_n = lean * (_DRAG * (wind_n - vn) - fn)
        down_e = lean * (_DRAG * (wind_e - ve) - fe)
        down_d = _GRAVITY + lean * (_DRAG * (wind_d - vd) - fd)
        sin, cos = math.sin(yaw), math.cos(yaw)
        x, y = down_n * cos + down_e * sin, down_e * cos - down_n * sin
        pitch = math.atan2(x, down_d)
        roll = math.atan2(-y, math.hypot(x, down_d))
        return from_angles(roll, pitch, yaw)


def _turn(a: Quaternion, b: Quaternion, share: float) -> tuple[Quaternion, Vector]:
    """Return the attitude between a and b at `share` of the step, and the constant body rates of that turn."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    w = aw * bw + ax * bx + ay * by + az * bz
    x = aw * bx - ax * bw - ay * bz + az * by
    y = aw * by + ax * bz - ay * bw - az * bx
    z = aw * bz - ax * by + ay * bx - az * bw
    sin = math.sqrt(x * x + y * y + z * z)
    if sin < 1e-12:
        return a, (0.0, 0.0, 0.0)
    half = math.atan2(sin, w)
    per_rate = 2 * half / (_STEP * sin)
    rates = x * per_rate, y * per_rate, z * per_rate
    if not share:
        return a, rates
    c, k = math.cos(half * share), math.sin(half * share) / sin
    q = (
        aw * c - (ax * x + ay * y + az * z) * k,
        ax * c + (aw * x + ay * z - az * y) * k,
        ay * c + (aw * y - ax * z + az * x) * k,
        az * c + (aw * z + ax * y - ay * x) * k,
    )
    return q, rates
