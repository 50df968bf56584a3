"""Sensors that lie to the search: each changes one kind of message on its way from the simulator."""

from __future__ import annotations

import math
import random
import time
from collections.abc import Callable
from typing import Any, Final

from arva_hil.mavlink.codec import dialect

Wrong = Callable[[float, float], float]  # (true value, seconds since the lie began) → false value

SCALE_M: Final = 8434.0  # of the atmosphere: e-folding height of the pressure
_LIMIT_M: Final = 10.0

RANGES: Final[dict[str, Wrong]] = {  # metres
    "rangefinder +5 m": lambda m, _: m + 5,
    "rangefinder +2 m": lambda m, _: m + 2,
    "rangefinder 1.5 h + 1 m": lambda m, _: 1.5 * m + 1,
    "rangefinder 2 h": lambda m, _: 2 * m,
    "rangefinder at its limit": lambda m, _: random.gauss(_LIMIT_M - 0.1, 0.03),
    "rangefinder +0.1 m/s": lambda m, s: m + 0.1 * s,
}
CLIMBS: Final[dict[str, Wrong]] = {  # metres above home
    "altitude jumps by 5 m": lambda m, _: m + 5,
    "altitude jumps by 9 m": lambda m, _: m + 9,
    "altitude drifts 0.05 m/s": lambda m, s: m + 0.05 * s,
}
PRESSURES: Final[dict[str, Wrong]] = {  # error of the pressure, in metres of height
    "barometer drifts 0.05 m/s": lambda m, s: m + 0.05 * s,
    "barometer +5 m": lambda m, _: m + 5,
}
LIES: Final = (*RANGES, *CLIMBS, *PRESSURES)


class Lie:
    """One lie of LIES, from its creation on. It changes messages in place."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._began_s = time.monotonic()

    def __call__(self, message: Any) -> None:
        """Change `message` if the lie concerns it."""
        age_s, kind = time.monotonic() - self._began_s, type(message).id
        if wrong := RANGES.get(self.name):
            if kind == dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR:
                message.current_distance = min(max(0, round(100 * wrong(message.current_distance / 100, age_s))), 65535)
            elif kind == dialect.MAVLINK_MSG_ID_RANGEFINDER:
                message.distance = wrong(message.distance, age_s)
        elif wrong := CLIMBS.get(self.name):
            if kind == dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT:
                off = round(1e3 * wrong(0.0, age_s))
                message.alt += off
                message.relative_alt += off
            elif kind == dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
                message.z -= wrong(0.0, age_s)
        elif (wrong := PRESSURES.get(self.name)) and kind == dialect.MAVLINK_MSG_ID_SCALED_PRESSURE:
            message.press_abs *= math.exp(-wrong(0.0, age_s) / SCALE_M)
