"""Flying a vehicle by orders: arm, take off, follow velocities, land. Messages in, messages out.

Autopilots lose commands, acknowledge what they then do not do, and refuse without a word. So an order is repeated
until heartbeat or height shows that it is carried out, and nothing else counts.
"""

from __future__ import annotations

import math
from enum import Enum, auto
from typing import Any, Final

from arva_hil.autopilot.mavlink import RESULTS, command, dialect
from arva_hil.autopilot.modes import ARDUCOPTER, modes_of
from arva_hil.autopilot.pose import PositionSample
from arva_hil.autopilot.session import Session
from arva_hil.autopilot.status_text import StatusTexts, unwell
from arva_hil.model import rotation
from arva_hil.notice import Notice

_REPEAT_S: Final = 1.0
_ARM_AGAIN_S: Final = 3.0  # each refused try costs a message on every ground station
_TAKE_OFF_AGAIN_S: Final = 5.0  # acknowledged, and still on the ground
_SET_POINT_S: Final = 0.2  # PX4 leaves OFFBOARD below 2 Hz, ArduPilot stops after 3 s
_FLOWING_S: Final = 1.0  # of set-points, before PX4 is told to follow them
_STOPPED_S: Final = 0.5  # of set-points that say stop, before it is left alone

_CLIMB_S: Final = 30.0  # and 1 s more a metre
_STEER_S: Final = 10.0
_HOLD_S: Final = 5.0
_LAND_S: Final = 90.0  # and 2 s more a metre

_RISEN_M: Final = 0.5  # no drift of an altitude: it has taken off
_NEARLY_M: Final = 1.5  # PX4 calls a take-off done within 0.8 m
_VELOCITY_AND_YAW: Final = 0b100111000111  # what the type mask ignores: position, acceleration, yaw rate
_STILL: Final = (0.0, 0.0, 0.0)


class Phase(Enum):
    """How far the flight is. ENDED: landed or left hovering, as ordered. LOST: it is no longer ours to fly."""

    IDLE = auto()
    ARMING = auto()
    CLIMBING = auto()
    FLYING = auto()
    LANDING = auto()
    HOLDING = auto()
    ENDED = auto()
    LOST = auto()


class Commander:
    """Remembers the last order to one vehicle and how far it has got. `take_off_m`: height of the take-off.

    `why` says why it was LOST, or had to land. Once it is LOST nothing is sent any more: the pilot, or the autopilot's
    own failsafe, has the vehicle.
    """

    def __init__(self, session: Session, *, take_off_m: float, arm_timeout_s: float = 60.0) -> None:
        self.phase = Phase.IDLE
        self.why = ""
        self.origin: PositionSample | None = None  # where it stood when it armed
        self._session = session
        self._take_off_m = take_off_m
        self._arm_timeout_s = arm_timeout_s
        self._modes = ARDUCOPTER  # until the launch
        self._velocity = _STILL
        self._yaw = 0.0
        self._taken_off = False
        self._mode = -1  # of the last heartbeat
        self._wanted = -1  # the mode that this phase wants
        self._ours: frozenset[int] = frozenset()  # modes that come of our orders; empty: any may still be
        self._since = 0.0  # in this phase
        self._limit_s = math.inf  # of it
        self._next_order = -math.inf
        self._next_set_point = -math.inf
        self._answer = ""  # to the last order, when it was a refusal
        self._texts = StatusTexts()
        self._unwell: list[str] = []

    # -- orders --------------------------------------------------------------------------------------------

    def launch(self, now: float) -> None:
        """Arm, take off, then follow velocities with the heading kept.

        There must be a vehicle with a pose. Raises ValueError for one that cannot be flown like this.
        """
        assert self._session.vehicle is not None
        self._modes = modes_of(self._session.vehicle)
        self._enter(Phase.ARMING, now, self._modes.hold, self._arm_timeout_s)

    def steer(self, velocity: tuple[float, float, float]) -> None:
        """Fly with this velocity, NED, m/s, until told otherwise."""
        self._velocity = velocity

    def land(self, now: float, why: str = "") -> None:
        """Land where it is; before the take-off: disarm. `why`: when that is not how it should end."""
        if self.phase in (Phase.ARMING, Phase.CLIMBING, Phase.FLYING):
            self.why, self._velocity = why, _STILL
            self._enter(Phase.LANDING, now, self._modes.land, _LAND_S + 2 * max(self.height, 0.0))

    def hold(self, now: float) -> None:
        """Stay in the air where it is, for the pilot to take; before the take-off: disarm."""
        if not self._taken_off:
            self.land(now)
        elif self.phase in (Phase.CLIMBING, Phase.FLYING, Phase.LANDING):
            self._velocity = _STILL
            self._enter(Phase.HOLDING, now, self._modes.hold, _HOLD_S)

    def let_go(self) -> None:
        """Send nothing any more."""
        if self.phase is not Phase.ENDED:
            self.phase = Phase.LOST

    @property
    def height(self) -> float:
        """Above the take-off point, m; 0 while that is not known."""
        last = self._session.track.last_position
        return last.alt - self.origin.alt if last and self.origin else 0.0

    # -- what the vehicle says -----------------------------------------------------------------------------

    def hear(self, now: float) -> None:
        """Take what the session was fed last."""
        for packet in self._session.own:
            if packet.msgid in _HEARD and (message := self._session.parser.decode(packet)) is not None:
                _HEARD[packet.msgid](self, message, now)

    def take_notices(self) -> list[Notice]:
        return [Notice("warning", f"the autopilot says: {text}") for text in self._texts.take()]

    # -- what it is told -----------------------------------------------------------------------------------

    def poll(self, now: float) -> bytes:
        """What is due to be sent."""
        if self._active:
            self._advance(now)
        if not self._active:
            return b""
        messages = []
        if now >= self._next_set_point and self._steered:
            self._next_set_point = max(self._next_set_point + _SET_POINT_S, now)
            messages.append(self._set_point())
        if now >= self._next_order:
            order, again = self._order()
            self._next_order = now + again
            messages += [order] if order else []
        return b"".join(map(self._session.encoder.pack, messages))

    @property
    def _active(self) -> bool:
        return self.phase not in (Phase.IDLE, Phase.ENDED, Phase.LOST)

    @property
    def _steered(self) -> bool:
        """Set-points flow without a pause until another mode needs none."""
        landing = self.phase is Phase.LANDING and self._taken_off and self._mode != self._wanted
        return landing or self.phase in (Phase.FLYING, Phase.HOLDING)

    def _advance(self, now: float) -> None:
        """Go on to the next phase when this one has come to its end, or to the limit of its time."""
        modes, late = self._modes, now - self._since
        in_mode = self._mode == self._wanted
        if self.phase is Phase.CLIMBING and self.height > 0.9 * self._take_off_m - 0.1:
            self._enter(Phase.FLYING, now, modes.steer, _STEER_S)
            self._next_order = now + _FLOWING_S
        elif self.phase is Phase.HOLDING and in_mode and late > _STOPPED_S:
            self.phase = Phase.ENDED
        elif late > self._limit_s and not (self.phase is Phase.FLYING and in_mode):
            why = f"the vehicle does not {_TO_DO[self.phase]}: {self._reasons() or 'it says nothing of why'}"
            if self.phase in (Phase.CLIMBING, Phase.FLYING):
                self.land(now, why)
            else:
                self._lose(why)

    def _order(self) -> tuple[Any | None, float]:
        """The order that is not carried out yet, None when all are; and when to look again, in seconds."""
        vehicle, modes = self._session.vehicle, self._modes
        assert vehicle is not None
        to = vehicle.system, vehicle.component
        if self.phase is Phase.CLIMBING:
            assert self.origin is not None
            risen = self.height > _RISEN_M
            return None if risen else modes.to_take_off(vehicle, self._take_off_m, self.origin.alt), _REPEAT_S
        if self.phase is Phase.LANDING and not self._taken_off:
            return command(*to, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0), _REPEAT_S
        if self._mode == self._wanted:
            arm = command(*to, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            return (arm, _ARM_AGAIN_S) if self.phase is Phase.ARMING else (None, _REPEAT_S)
        if self.phase is Phase.LANDING:
            return command(*to, dialect.MAV_CMD_NAV_LAND), _REPEAT_S
        return modes.to_set(vehicle, self._wanted), _REPEAT_S

    def _set_point(self) -> Any:
        vehicle = self._session.vehicle
        assert vehicle is not None
        return dialect.MAVLink_set_position_target_local_ned_message(
            0,
            vehicle.system,
            vehicle.component,
            dialect.MAV_FRAME_LOCAL_NED,
            _VELOCITY_AND_YAW,
            *_STILL,
            *self._velocity,
            *_STILL,
            self._yaw,
            0.0,
        )

    # -- what comes of it ----------------------------------------------------------------------------------

    def _on_heartbeat(self, message: Any, now: float) -> None:
        assert self._session.vehicle is not None
        if message.autopilot != self._session.vehicle.autopilot:
            return
        self._mode = message.custom_mode
        armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
        if not self._active:
            return
        if self.phase is Phase.LANDING and not armed:
            self.phase = Phase.ENDED
        elif self.phase is Phase.ARMING and armed and self._mode != self._wanted:
            self._lose(f"somebody else has armed it, in {self._mode_name}")
        elif self.phase is not Phase.ARMING and not armed:
            self._lose("; ".join(filter(None, [f"it was disarmed; the mode is {self._mode_name}", self._reasons()])))
        else:
            self._watch_mode()
            if self.phase is Phase.ARMING:
                self._stand(armed, now)

    def _watch_mode(self) -> None:
        """A mode that does not come of an order of ours is somebody else's: the pilot's, or a failsafe's."""
        nearly = self.phase is Phase.CLIMBING and self.height > self._take_off_m - _NEARLY_M
        if self._mode == self._wanted:
            self._ours = frozenset({self._mode})
        elif self._ours and self._mode not in self._ours and not (nearly and self._mode == self._modes.hold):
            self._lose(f"the mode is {self._mode_name}: the pilot or a failsafe has taken over")

    def _stand(self, armed: bool, now: float) -> None:
        """Note place and heading: until it arms an autopilot still moves them while it settles."""
        place = self._session.track.last_position
        if place is not None and (state := self._session.state_at(now, place.frame)) is not None:
            self.origin = place
            self._yaw = rotation.to_euler(rotation.to_matrix(state.attitude))[2]
        if armed and self.origin is not None:
            self._taken_off = True
            self._enter(Phase.CLIMBING, now, self._modes.take_off, _CLIMB_S + self._take_off_m)

    def _on_ack(self, message: Any, now: float) -> None:
        if message.command not in _ORDERS or not self._session.answers_us(message):
            return
        if message.result not in (dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_IN_PROGRESS):
            result = RESULTS.get(message.result, f"result {message.result}").removeprefix("MAV_RESULT_")
            self._answer = f"{_ORDERS[message.command]}: {result}"
        elif self.phase is Phase.CLIMBING and message.command == dialect.MAV_CMD_NAV_TAKEOFF:
            self._next_order = now + _TAKE_OFF_AGAIN_S

    def _on_text(self, message: Any, now: float) -> None:
        if message.severity <= dialect.MAV_SEVERITY_WARNING:
            self._texts.add(message)

    def _on_status(self, message: Any, now: float) -> None:
        self._unwell = unwell(message)

    @property
    def _mode_name(self) -> str:
        return self._modes.name(self._mode)

    def _reasons(self) -> str:
        """What it has answered and said in this phase, for a person."""
        arming = self.phase is Phase.ARMING and self._unwell
        status = f"not healthy: {', '.join(self._unwell)}" if arming else ""
        return "; ".join(filter(None, [self._answer, *self._texts.recent, status]))

    def _enter(self, phase: Phase, now: float, wanted: int, limit_s: float) -> None:
        self.phase = phase
        self._since, self._limit_s = now, limit_s
        self._wanted = wanted
        self._next_order = -math.inf
        self._answer = ""
        if phase is Phase.ARMING:  # in whatever mode it is, and refused for what was perhaps said before
            return
        self._texts.recent.clear()
        self._ours |= {wanted, self._modes.hold} if phase in (Phase.CLIMBING, Phase.FLYING) else {wanted}

    def _lose(self, why: str) -> None:
        self.phase = Phase.LOST
        self.why = "; ".join(filter(None, [self.why, why]))


_HEARD: Final = {
    dialect.MAVLINK_MSG_ID_HEARTBEAT: Commander._on_heartbeat,
    dialect.MAVLINK_MSG_ID_COMMAND_ACK: Commander._on_ack,
    dialect.MAVLINK_MSG_ID_STATUSTEXT: Commander._on_text,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: Commander._on_status,
}
_ORDERS: Final = {
    dialect.MAV_CMD_COMPONENT_ARM_DISARM: "arming",
    dialect.MAV_CMD_DO_SET_MODE: "setting the mode",
    dialect.MAV_CMD_NAV_TAKEOFF: "take-off",
    dialect.MAV_CMD_NAV_LAND: "landing",
}
_TO_DO: Final = {
    Phase.ARMING: "arm",
    Phase.CLIMBING: "take off",
    Phase.FLYING: "follow velocities",
    Phase.LANDING: "land",
    Phase.HOLDING: "hover",
}
