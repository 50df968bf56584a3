"""Flight modes and the commands that differ between ArduPilot and PX4.

ArduCopter's custom modes are COPTER_MODE; PX4's are a main mode in bits 16–23 and a sub-mode in bits 24–31.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from arva_hil.autopilot.following.discovery import Vehicle
from arva_hil.mavlink.codec import command, dialect

_MULTIROTORS: Final = {
    dialect.MAV_TYPE_QUADROTOR,
    dialect.MAV_TYPE_COAXIAL,
    dialect.MAV_TYPE_HELICOPTER,
    dialect.MAV_TYPE_HEXAROTOR,
    dialect.MAV_TYPE_OCTOROTOR,
    dialect.MAV_TYPE_TRICOPTER,
    dialect.MAV_TYPE_DODECAROTOR,
    dialect.MAV_TYPE_DECAROTOR,
}
_SUB: Final = {2: "takeoff", 3: "hold", 4: "mission", 5: "return", 6: "land", 8: "follow", 9: "precision land"}
_MAIN: Final = {1: "manual", 2: "altitude", 3: "position", 5: "acro", 6: "offboard", 7: "stabilized", 8: "rattitude"}
_AUTO: Final = 4 << 16  # the main mode of all its sub-modes
_SPARE_M: Final = 2.5


@dataclass(frozen=True)
class Modes:
    """One autopilot's custom modes, and the form of its commands.

    `hold`: it hovers, and can be armed; `take_off`: during the climb; `steer`: it follows velocities; `yields`: it
    hovers until the sticks move; `hovers`: it hovers, and no stick steers it. `px4`: modes are main and sub-modes,
    heights are above mean sea level.
    """

    hold: int
    take_off: int
    steer: int
    land: int
    yields: int
    hovers: frozenset[int]
    px4: bool

    def name(self, mode: int) -> str:
        if not self.px4:
            entry = dialect.enums["COPTER_MODE"].get(mode)
            return entry.name.removeprefix("COPTER_MODE_") if entry else f"mode {mode}"
        main, sub = mode >> 16 & 0xFF, mode >> 24
        return (_SUB.get(sub) if main == 4 else _MAIN.get(main)) or f"mode {main}/{sub}"

    def to_set(self, vehicle: Vehicle, mode: int) -> Any:
        """Return a DO_SET_MODE. Only a heartbeat confirms the mode, not the acknowledgement."""
        main, sub = (mode >> 16 & 0xFF, mode >> 24) if self.px4 else (mode, 0)
        custom = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        return command(vehicle.system, vehicle.component, dialect.MAV_CMD_DO_SET_MODE, custom, main, sub)

    def to_take_off(self, vehicle: Vehicle, height: float, ground_amsl: float) -> Any:
        """Return a NAV_TAKEOFF to a height above the ground, straight up, heading kept.

        PX4 ends a take-off within 0.8 m of its height, and then changes to hold, as if the pilot had ordered it. So a
        larger height is ordered, and the mode that follows set-points before the vehicle reaches it.
        """
        here = float("nan") if self.px4 else 0.0  # PX4 takes a number for a place, ArduPilot ignores it
        level = ground_amsl + height + _SPARE_M if self.px4 else height
        return command(vehicle.system, vehicle.component, dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, here, here, here, level)


_GUIDED: Final = dialect.COPTER_MODE_GUIDED
_HOLD: Final = _AUTO | 3 << 24
_LAND, _LOITER = dialect.COPTER_MODE_LAND, dialect.COPTER_MODE_LOITER
ARDUCOPTER: Final = Modes(
    hold=_GUIDED,
    take_off=_GUIDED,
    steer=_GUIDED,
    land=_LAND,
    yields=_LOITER,
    hovers=frozenset((dialect.COPTER_MODE_AUTO, _GUIDED, _LOITER, dialect.COPTER_MODE_BRAKE)),
    px4=False,
)
PX4: Final = Modes(
    hold=_HOLD,
    take_off=_AUTO | 2 << 24,
    steer=6 << 16,
    land=_AUTO | 6 << 24,
    yields=_HOLD,
    hovers=frozenset((_HOLD, _AUTO | 4 << 24)),  # hold, mission
    px4=True,
)


def modes_of(vehicle: Vehicle) -> Modes:
    """Return the modes of a vehicle. Raises ValueError if it cannot be flown by velocities here."""
    modes = {dialect.MAV_AUTOPILOT_ARDUPILOTMEGA: ARDUCOPTER, dialect.MAV_AUTOPILOT_PX4: PX4}.get(vehicle.autopilot)
    if modes is None:
        raise ValueError(f"{vehicle} is neither ArduPilot nor PX4")
    if vehicle.kind not in _MULTIROTORS:
        raise ValueError(f"{vehicle} is not a multirotor")
    return modes
