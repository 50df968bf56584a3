"""Extrapolates an attitude after the newest sample, in plain floats because a search does it five times a second.

In two recorded square flights, half a second ahead, the tilt is wrong by 5.4° (root mean square) with constant body
rates, by 2.9° if they stop after 0.15 s, and by 2.6° if it is held; the heading is wrong by 4.7° with a constant turn
for 0.5 s, and by 9.6° if it is held (tools/measure_extrapolation.py).
"""

from __future__ import annotations

import math
from typing import Final

from arva_hil.field.quaternion import Quaternion, from_euler, multiply, unit

_TILT_S: Final = 0.15
_HEADING_S: Final = 0.5
_MOST_TURN: Final = math.pi / 6  # rad, by body rates
_MOST_HEADING: Final = math.pi / 3  # rad, by the turn about the vertical


def attitude_ahead(angles: tuple[float, ...], rates: tuple[float, float, float], ahead_s: float) -> Quaternion:
    """The attitude, body FRD → NED, `ahead_s` after it was `angles`: roll, pitch, yaw, or a quaternion near length 1.

    It is extrapolated with the body `rates` [rad/s] for 0.15 s and at most 30°, then with the turn about the vertical
    until 0.5 s and at most 60°, then it is held.
    """
    q = from_euler(*angles) if len(angles) == 3 else unit(*angles)
    p, r, y = rates
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
