"""The autopilot of the simulated multirotor: modes, arming, take-off, set-points, landing. Without MAVLink.

Names, speeds and delays are ArduCopter's defaults (https://ardupilot.org/copter/docs/flight-modes.html).
"""

from __future__ import annotations

import math
from enum import IntEnum
from math import remainder, tau
from typing import Final, NamedTuple

from arva_hil.simulated.multirotor import CONTACT_M, STEP_US, Multirotor, Vector

_TIMEOUT: Final = 3_000_000 // STEP_US  # GUID_TIMEOUT, in steps
_RESTED: Final = 1_000_000 // STEP_US  # on the ground for this long: landed
_IDLE: Final = 10_000_000 // STEP_US  # DISARM_DELAY
_APPROACH_SPEED: Final = 5.0  # m/s, towards a position
_APPROACH_GAIN: Final = 0.8  # 1/s
_BRAKE: Final = 1.5  # m/s², in an approach
_LAND_SPEED: Final = 0.5  # m/s, below `_LAND_SLOW_HEIGHT`
_LAND_SLOW_HEIGHT: Final = 10.0  # m
_RTL_HEIGHT: Final = 15.0  # m
_STILL: Final = (0.0, 0.0, 0.0)


class Mode(IntEnum):
    """The values of HEARTBEAT.custom_mode. The sticks never move, so STABILIZE and LOITER hold the position."""

    STABILIZE = 0
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9


class SetPoint(NamedTuple):
    """A set-point in GUIDED: NED from home [m, m/s, rad, rad/s]. A yaw rate is ignored if there is a yaw."""

    position: Vector | None = None
    velocity: Vector = _STILL  # added if there is a position
    yaw: float | None = None  # None: keep the heading
    yaw_rate: float = 0.0


class SimulatedAutopilot:
    """Remembers mode, arming, landing and the set-point. Methods for orders return False if they refuse."""

    def __init__(self, wind: Vector) -> None:
        self.motion = Multirotor(wind)
        self.mode = Mode.STABILIZE
        self.ready = False  # the position is known, so it can arm
        self.armed = False
        self.landed = True
        self.taking_off = False
        self.empty = False  # the battery is empty
        self.error = _STILL  # of the estimated position, NED [m]
        self.sticks = (1500, 1500, 1500, 1500)  # roll, pitch, throttle, yaw [µs]; reported, but not used for flying
        self._set_point = SetPoint()
        self._set_at = 0  # step
        self._rested = 0  # steps on the ground

    def arm(self) -> bool:
        if self.armed:
            return True
        if not self.ready or self.mode in (Mode.LAND, Mode.RTL):
            return False
        self.armed = True
        self._rested = 0
        return True

    def disarm(self, force: bool = False) -> bool:
        """Stop the motors. In the air this needs `force`, and the vehicle falls."""
        if self.armed and not self.landed and not force:
            return False
        self.armed = self.taking_off = False
        return True

    def set_mode(self, mode: int) -> bool:
        if mode not in Mode._value2member_map_:
            return False
        if mode != self.mode:
            self.mode = Mode(mode)
            self.steer(SetPoint())
        return True

    def take_off(self, height: float) -> bool:
        """Climb to a height [m] above the present position."""
        if self.mode != Mode.GUIDED or not self.armed or not self.landed or not 0 < height < math.inf:
            return False
        north, east, down = self._estimated
        self.steer(SetPoint((north, east, down - height)))
        self.taking_off = True
        return True

    @property
    def target(self) -> Vector | None:
        """The place to which a set-point sends it, NED from home [m]; None without one."""
        return self._set_point.position if self.mode == Mode.GUIDED and not self.taking_off else None

    def steer(self, set_point: SetPoint) -> None:
        """Follow a set-point: a velocity for 3 s, a position without limit. As in ArduCopter this ends a take-off."""
        self._set_point = set_point
        self._set_at = self.motion.steps
        self.taking_off = False

    def step(self) -> None:
        """Fly for 10 ms."""
        motion = self.motion
        flies = self.armed and (self.taking_off or not self.landed)
        velocity, yaw_rate = self._wanted(motion) if flies else (_STILL, 0.0)
        motion.step(velocity, yaw_rate, flies)
        down = motion.down
        if down < -0.1:
            self._rested, self.landed = 0, False
        elif down <= -CONTACT_M or (flies and velocity[2] < 0):
            self._rested = 0
        else:
            self._rest()
        if self.taking_off and self._set_point.position and self._estimated[2] < self._set_point.position[2] + 0.1:
            self.taking_off = False

    def _rest(self) -> None:
        self._rested += 1
        if self._rested < _RESTED:
            return
        self.landed = True
        if self.armed and (self._rested >= _IDLE or self.mode in (Mode.LAND, Mode.RTL)):
            self.disarm()

    def _wanted(self, motion: Multirotor) -> tuple[Vector, float]:
        """Return velocity (NED) and yaw rate."""
        mode = self.mode
        if mode is Mode.GUIDED:
            position, velocity, yaw, yaw_rate = self._set_point
            if motion.steps - self._set_at > _TIMEOUT:
                velocity, yaw_rate = _STILL, 0.0
            if position is not None:
                velocity = self._towards(position, velocity)
            if yaw is not None:
                yaw_rate = 2.0 * remainder(yaw - motion.yaw, tau)
            return velocity, yaw_rate
        if mode is Mode.LAND:
            return self._sink(), 0.0
        if mode is Mode.RTL:
            return self._home(), 0.0
        return _STILL, 0.0

    def _sink(self) -> Vector:
        return (0.0, 0.0, _LAND_SPEED if -self.motion.down < _LAND_SLOW_HEIGHT else math.inf)

    def _home(self) -> Vector:
        """Return the velocity that climbs, flies home, then lands."""
        here = self._estimated
        if math.hypot(here[0], here[1]) < 1:
            return self._sink()
        down = min(here[2], -_RTL_HEIGHT)
        north, east, climb = self._towards((0.0, 0.0, down), _STILL)
        return (0.0, 0.0, climb) if here[2] > down + 0.5 else (north, east, climb)

    @property
    def _estimated(self) -> Vector:
        """The position estimated by the autopilot."""
        motion, (north, east, down) = self.motion, self.error
        return motion.north + north, motion.east + east, motion.down + down

    def _towards(self, position: Vector, along: Vector) -> Vector:
        here = self._estimated
        north, east = position[0] - here[0], position[1] - here[1]
        distance = math.hypot(north, east)
        speed = min(_APPROACH_GAIN * distance, math.sqrt(2 * _BRAKE * distance), _APPROACH_SPEED)
        share = speed / distance if distance > 0 else 0.0
        down = _APPROACH_GAIN * (position[2] - here[2])
        return north * share + along[0], east * share + along[1], down + along[2]
