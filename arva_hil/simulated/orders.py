"""The commands of the built-in vehicle for flying. Each returns a MAV_RESULT."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from arva_hil.mavlink.codec import dialect
from arva_hil.simulated.autopilot import Mode, SimulatedAutopilot

Params = tuple[float, ...]  # of a command, seven

ACCEPTED: Final[int] = dialect.MAV_RESULT_ACCEPTED
DENIED: Final[int] = dialect.MAV_RESULT_DENIED
UNSUPPORTED: Final[int] = dialect.MAV_RESULT_UNSUPPORTED
FAILED: Final[int] = dialect.MAV_RESULT_FAILED
_BY_FORCE: Final = 21196  # MAV_CMD_COMPONENT_ARM_DISARM, param 2


def integer(value: float) -> int:
    """A parameter as an integer; -2, which is never valid, for NaN and infinity."""
    return int(value) if math.isfinite(value) else -2


def set_mode(pilot: SimulatedAutopilot, params: Params, _: int) -> int:
    """The first two parameters are `base_mode` and `custom_mode`."""
    if not integer(params[0]) & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        return DENIED
    return ACCEPTED if pilot.set_mode(integer(params[1])) else FAILED


def _arm(pilot: SimulatedAutopilot, params: Params, _: int) -> int:
    if (wanted := integer(params[0])) not in (0, 1):
        return DENIED
    by_force = integer(params[1]) == _BY_FORCE
    return ACCEPTED if (pilot.arm() if wanted else pilot.disarm(by_force)) else FAILED


def _take_off(pilot: SimulatedAutopilot, params: Params, frame: int) -> int:
    if frame not in (dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT):
        return DENIED
    return ACCEPTED if pilot.take_off(params[6]) else FAILED


def _land(pilot: SimulatedAutopilot, _: Params, __: int) -> int:
    return ACCEPTED if pilot.set_mode(Mode.LAND) else FAILED


# MAV_CMD → (pilot, its parameters, the MAV_FRAME of its place) → MAV_RESULT
ORDERS: Final[dict[int, Callable[[SimulatedAutopilot, Params, int], int]]] = {
    dialect.MAV_CMD_COMPONENT_ARM_DISARM: _arm,
    dialect.MAV_CMD_DO_SET_MODE: set_mode,
    dialect.MAV_CMD_NAV_TAKEOFF: _take_off,
    dialect.MAV_CMD_NAV_LAND: _land,
}
