"""The phases of a flight, and how long each may take."""

from __future__ import annotations

from enum import Enum, auto
from typing import Final


class Phase(Enum):
    """ENDED: landed, disarmed or left hovering, as ordered. LOST: we do not control the vehicle any more.

    YIELDING: ArduPilot is stopped, and given to the pilot in LOITER.
    """

    IDLE = auto()
    ARMING = auto()
    CLIMBING = auto()
    FLYING = auto()
    LANDING = auto()
    DISARMING = auto()
    HOLDING = auto()
    YIELDING = auto()
    ENDED = auto()
    LOST = auto()

    @property
    def active(self) -> bool:
        """Whether messages may be sent."""
        return self not in (Phase.IDLE, Phase.ENDED, Phase.LOST)

    @property
    def to_do(self) -> str:
        """What the vehicle does in this phase, as a verb."""
        return _TO_DO[self]

    def limit_s(self, metres: float) -> float:
        """The longest duration of the phase [s], with this many metres to climb or to descend."""
        fixed, each_metre = _LIMITS[self]
        return fixed + each_metre * max(metres, 0.0)


_TO_DO: Final = {
    Phase.ARMING: "arm",
    Phase.CLIMBING: "take off",
    Phase.FLYING: "follow velocities",
    Phase.LANDING: "land",
    Phase.DISARMING: "disarm",
    Phase.HOLDING: "hover",
    Phase.YIELDING: "go to LOITER",
}
_LIMITS: Final = {  # s, and s per metre
    Phase.CLIMBING: (30.0, 1.0),
    Phase.FLYING: (10.0, 0.0),  # until it follows velocities
    Phase.LANDING: (90.0, 2.0),
    Phase.DISARMING: (10.0, 0.0),
    Phase.HOLDING: (5.0, 0.0),
    Phase.YIELDING: (60.0, 0.0),
}
