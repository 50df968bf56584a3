"""Flies a vehicle by orders: arm, take off, follow velocities, land. Messages in, messages out.

Autopilots lose commands, acknowledge commands that they do not carry out, and refuse without an answer. So an order is
repeated until the heartbeat or the height confirms it. The pilot always wins: `authority.py` decides when
an order may be sent; the sticks (`sticks.py`) and the battery (`complaints.py`) end the control too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from functools import partial
from typing import Any, Final, NamedTuple

from arva_hil.autopilot.commanding import authority
from arva_hil.autopilot.commanding.authority import MODE_WANTED, Authority, Holder
from arva_hil.autopilot.commanding.complaints import BATTERY_WANTED, Battery, Complaints
from arva_hil.autopilot.commanding.sticks import STICKS_WANTED, Sticks
from arva_hil.autopilot.following.discovery import Vehicle
from arva_hil.autopilot.following.modes import ARDUCOPTER, modes_of
from arva_hil.autopilot.following.navigation import PositionSample
from arva_hil.autopilot.following.session import Received, Session
from arva_hil.events import Event
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.events.vehicles import ArmingTried, AutopilotText, ThrottleAwaited
from arva_hil.mavlink.codec import command, dialect
from arva_hil.mavlink.dialect import MAVLINK_MSG_ID_CURRENT_MODE
from arva_hil.model.field.rotation import heading


class Phase(Enum):
    """The phases of a flight. `PHASES` has their meaning, limits and transitions."""

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
        """True if orders may be sent."""
        return self not in _SILENT


class PhaseRule(NamedTuple):
    """One row of the table of phases."""

    meaning: str
    then: tuple[Phase, ...]
    """The phases that may follow."""
    limit_s: float = math.inf
    """The longest duration [s], without the part for the height."""
    each_metre_s: float = 0.0
    """The part of the limit for each metre of height [s]."""


_SILENT: Final = (Phase.IDLE, Phase.ENDED, Phase.LOST)
_ENDS: Final = (Phase.LANDING, Phase.HOLDING, Phase.YIELDING, Phase.LOST)  # of a vehicle in the air
PHASES: Final = {
    Phase.IDLE: PhaseRule("only questions are sent", (Phase.ARMING, Phase.FLYING, Phase.LOST)),
    Phase.ARMING: PhaseRule("the vehicle is armed on the ground", (Phase.CLIMBING, Phase.DISARMING, Phase.LOST)),
    Phase.CLIMBING: PhaseRule("it takes off", (Phase.FLYING, *_ENDS), 30.0, 1.0),
    Phase.FLYING: PhaseRule("it follows velocities", _ENDS, 10.0),
    Phase.LANDING: PhaseRule("it lands", (Phase.ENDED, Phase.YIELDING, Phase.LOST), 90.0, 2.0),
    Phase.DISARMING: PhaseRule("it is disarmed before the take-off", (Phase.ENDED, Phase.LOST), 10.0),
    Phase.HOLDING: PhaseRule("it is stopped, to be left hovering", (Phase.ENDED, Phase.YIELDING, Phase.LOST), 5.0),
    Phase.YIELDING: PhaseRule("it is stopped, and given to the pilot: LOITER, PX4: Hold", (Phase.LOST,), 60.0),
    Phase.ENDED: PhaseRule("it has landed, is disarmed or hovers, as ordered; nothing is sent", ()),
    Phase.LOST: PhaseRule("the pilot or a failsafe has it; nothing is sent", ()),
}
"""The limit of FLYING holds until the vehicle is in the mode that follows set-points."""


_STILL: Final = (0.0, 0.0, 0.0)
EVERY_S: Final = 0.2  # PX4 leaves OFFBOARD below 2 Hz, ArduPilot stops after 3 s
_VELOCITY_AND_YAW: Final = 0b100111000111  # what the type mask ignores: position, acceleration, yaw rate
_LONG_S: Final = 0.8  # PX4's COM_OF_LOSS_T is 1 s
_OF_LATE_S: Final = 5.0


class SetPoints:
    """Remembers the velocity and the heading to order, the last set-point and the longest recent gap.

    `velocity`: NED [m/s]; `yaw` [rad]. Times are seconds on the caller's clock.
    """

    def __init__(self) -> None:
        self.velocity = _STILL
        self.yaw = 0.0
        self.next_s = -math.inf  # when one is due
        self._last = -math.inf
        self._longest = (0.0, -math.inf)  # the gap [s], and when it ended

    def message(self, vehicle: Vehicle, *, still: bool) -> Any:
        """Return a set-point: velocity (0 if `still`) and heading. It has an effect in the mode `steer` only."""
        to = 0, vehicle.system, vehicle.component, dialect.MAV_FRAME_LOCAL_NED, _VELOCITY_AND_YAW
        velocity = _STILL if still else self.velocity
        return dialect.MAVLink_set_position_target_local_ned_message(*to, *_STILL, *velocity, *_STILL, self.yaw, 0.0)

    def left(self, now: float) -> None:
        """Count a set-point as sent."""
        gap = now - self._last
        if self._last > -math.inf and (gap > self._longest[0] or now - self._longest[1] > _OF_LATE_S):
            self._longest = gap, now
        self._last, self.next_s = now, max(self.next_s + EVERY_S, now)

    def rest(self) -> None:
        """Expect no set-points from now on."""
        self._last = -math.inf

    def stalled_s(self, now: float) -> float:
        """Return the longest recent gap [s]; 0 if they were sent often enough."""
        gap, until = self._longest
        worst = max(gap if now - until <= _OF_LATE_S else 0.0, now - self._last if self._last > -math.inf else 0.0)
        return worst if worst > _LONG_S else 0.0


_LEAD_S: Final = 0.5  # from an order to its effect
_STEERED: Final = (Phase.FLYING, Phase.HOLDING, Phase.YIELDING)
RISEN_M: Final = 0.5  # more than the drift of an altitude: it has taken off


@dataclass
class PhaseTimes:
    """The times of one phase: seconds on the caller's clock."""

    since: float = 0.0
    """Its start."""
    limit_s: float = math.inf
    """Its longest duration."""
    next_order: float = -math.inf
    """The time of its next order."""
    ordered_s: float = math.inf
    """The time at which its first order was sent."""
    target_s: float = -math.inf
    """The last report of a place to which the vehicle flies."""


class FlightState:
    """Remembers the phase of a flight, its start, and the vehicle's reports in it.

    `why`: the reasons if the flight is LOST, or had to land. Once it is LOST nothing is sent: the pilot controls the
    vehicle if it was `handed_over`, otherwise the autopilot's own failsafe does. `origin`: the place of the arming;
    `take_off_m`: the height of the take-off.
    """

    def __init__(self, session: Session, take_off_m: float) -> None:
        self.phase = Phase.IDLE
        self.why: tuple[Reason, ...] = ()
        self.handed_over = False
        self.origin: PositionSample | None = None
        self.authority = Authority()
        self._session = session
        self._take_off_m = take_off_m
        self._modes = ARDUCOPTER  # until the launch
        self._taken: float | None = None  # seconds without set-points before another mode was reported
        self._times = PhaseTimes()
        self._set_points = SetPoints()
        self._complaints = Complaints()
        session.streams.want(MODE_WANTED | STICKS_WANTED | BATTERY_WANTED)

    def let_go(self) -> None:
        """Stop sending."""
        if self.phase is not Phase.ENDED:
            self.phase = Phase.LOST

    @property
    def lands_by_itself(self) -> bool:
        """True if the vehicle is in the mode that lands."""
        return self.authority.wanted == self._modes.land and self.authority.in_mode

    @property
    def height(self) -> float:
        """The height above the take-off point [m]; 0 while it is not known."""
        last = self._session.navigation.track.last_position
        return last.alt - self.origin.alt if last and self.origin else 0.0

    @property
    def _climbed(self) -> bool:
        """True if the vehicle is high enough, or will be when the next order reaches it: PX4 climbs until then."""
        enough = 0.9 * self._take_off_m - 0.1
        if not self._modes.px4:
            return self.height > enough
        last = self._session.navigation.track.last_position
        return self.height > RISEN_M and self.height - (last.velocity[2] if last else 0.0) * _LEAD_S > enough

    @property
    def _steered(self) -> bool:
        """True while set-points are sent. During a take-off none are sent to ArduPilot, which would follow them."""
        landing = self.phase is Phase.LANDING and not self.lands_by_itself
        return landing or self.phase in _STEERED or (self.phase is Phase.CLIMBING and self._modes.px4)

    def _reasons(self) -> list[Reason]:
        return self._complaints.why(status=self.phase is Phase.ARMING)

    def _enter(self, phase: Phase, now: float, wanted: int, limit_s: float | None = None) -> None:
        metres = self._take_off_m if phase is Phase.CLIMBING else self.height
        rule = PHASES[phase]
        self.phase = phase
        if limit_s is None:
            limit_s = rule.limit_s + rule.each_metre_s * max(metres, 0.0)
        self._times = PhaseTimes(now, limit_s)
        self._complaints.begin(keep_texts=phase is Phase.ARMING)
        self.authority.want(wanted, ours=phase not in (Phase.ARMING, Phase.DISARMING))

    def _leave_alone(self, now: float, *why: Reason) -> bool:
        """End a take-over before the vehicle follows set-points: no order has to be undone.

        Just after an order, which may take effect yet, this waits. Returns False once the vehicle follows.
        """
        last_s = self._times.next_order - _REPEAT_S
        under_way = self._times.ordered_s < math.inf and now < last_s + _STOPPED_S
        if self.authority.borrowed and self.phase.active and not under_way:
            self._lose(*why, because(Why.NOT_TAKEN_OVER), handed_over=True)
        return self.authority.borrowed

    def _lose(self, *why: Reason, handed_over: bool = False) -> None:
        self.phase, self.handed_over = Phase.LOST, handed_over
        self.why += why

    def _stand(self, armed: bool, now: float) -> None:
        """Remember place and heading. An autopilot still corrects them until it arms."""
        place = self._session.navigation.track.last_position
        if place is not None and self._turn(now, place):
            self.origin = place
        if armed and self.origin is not None:
            self._enter(Phase.CLIMBING, now, self._modes.take_off)

    def _turn(self, now: float, place: PositionSample) -> bool:
        """Keep the present heading. Returns False if it is not known."""
        state = self._session.navigation.state_at(now, place.frame)
        if state is not None:
            self._set_points.yaw = heading(state.attitude)
        return state is not None

    def _watch_mode(self, now: float) -> None:
        """Detect a mode that this program did not request: the pilot or a failsafe has set it.

        PX4 arms in hold, and may stay in hold until it has risen. It does not return to hold by itself: it is ordered
        to follow set-points below the height of its take-off. After a gap the present mode is named, because PX4 may
        have left OFFBOARD by itself, and the pilot may have chosen another mode after that.
        """
        in_mode = self.authority.in_mode
        risen = self.phase is Phase.CLIMBING and self.height > RISEN_M
        if self._taken is None and (self.authority.usurped or (risen and not in_mode)):
            self._taken = self._set_points.stalled_s(now) if self._modes.px4 else 0.0
        if self.authority.settled and self._lose_to_other():
            return
        if self.phase is Phase.YIELDING and in_mode:
            self._lose(because(Why.PILOT_HAS_IT, mode=self._mode), handed_over=True)

    def _lose_to_other(self) -> bool:
        """End if a mode was reported that this program did not request. Returns False if none was."""
        if self._taken is not None:
            self._lose(because(Why.MODE_TAKEN, mode=self._mode, stalled_s=self._taken), handed_over=True)
        return self._taken is not None

    @property
    def _mode(self) -> str:
        """The name of the present mode."""
        return self._modes.name(self.authority.mode)


_REPEAT_S: Final = 1.0
_ARM_AGAIN_S: Final = 3.0  # each refused attempt is a message on every ground station
_TAKE_OFF_AGAIN_S: Final = 5.0  # repeat an acknowledged take-off if the vehicle is still on the ground
_FLOWING_S: Final = 1.0  # send set-points this long before PX4 gets the order to follow them
_STOPPED_S: Final = 0.5  # send set-points with velocity 0 this long before the last one
_OWN_MODE_S: Final = 0.3  # after a stick: ArduPilot reads a mode switch after 0.2 s, and reports its mode at 10 Hz
_TARGET_WANTED: Final = {dialect.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: 10.0}
_NEW_TARGET_S: Final = 1.0
_PX4_YIELDS_S: Final = 5.0  # limit for the change to Hold, which waits for no throttle
_ARM: Final = dialect.MAV_CMD_COMPONENT_ARM_DISARM


class Commander(FlightState):
    """The last command to one vehicle.

    `take_off_m`: height of the take-off. `held_back`: the reason not to arm it now, or None. `emit` gets
    the events.
    """

    def __init__(
        self, session: Session, emit: Callable[[Event], None], *, take_off_m: float, arm_timeout_s: float = 60.0
    ) -> None:
        super().__init__(session, take_off_m)
        self.sticks = Sticks()
        self.battery = Battery()
        self._emit = emit
        self.held_back: Reason | None = None
        self._arm_timeout_s = arm_timeout_s
        self._tries = 0  # to arm
        self._read_since = 0.0  # the messages read now came after this time
        self._offered: list[Callable[[float], None]] = []  # called after the present messages were sent

    @property
    def _vehicle(self) -> Vehicle:
        assert self._session.vehicle is not None
        return self._session.vehicle

    def launch(self, now: float) -> None:
        """Arm, take off, then follow velocities with the heading kept.

        There must be a vehicle with a pose. Raises ValueError if it cannot be flown by velocities.
        """
        self._modes = modes_of(self._vehicle)
        self._begin(now)
        self._enter(Phase.ARMING, now, self._modes.hold, self._arm_timeout_s)

    def take_over(self, now: float) -> None:
        """Follow velocities from the place where it hovers, armed, in a mode that this program did not request.

        The heading is kept. The origin is below that place, at the height of home. If the vehicle does not follow, it
        is left in that mode. Raises ValueError for a vehicle that cannot be flown by velocities.
        """
        self._modes = modes_of(self._vehicle)
        place, home = self._session.navigation.track.last_position, self._session.navigation.home
        if place is None or home is None or self.authority.mode == -1 or not self._turn(now, place):
            raise ValueError("its pose, its home or its mode is not known")
        self.origin = place._replace(alt=home[2])
        self._begin(now)
        self.authority.borrow()
        self._enter(Phase.FLYING, now, self._modes.steer)
        self._times.next_order = now + _FLOWING_S

    def _begin(self, now: float) -> None:
        self.sticks.mark()
        self.authority.begin(now)
        if not self._modes.px4:  # it changes its mode when it is sent to a place
            self._session.streams.want(_TARGET_WANTED)

    def steer(self, velocity: tuple[float, float, float]) -> None:
        """Fly with this velocity [m/s, NED] until the next call."""
        self._set_points.velocity = velocity

    def land(self, now: float, *why: Reason) -> None:
        """Land here; before the take-off: disarm. `why`: the reasons, if it is not the normal end."""
        self._stop(now, why, Phase.LANDING, self._modes.land)

    def hold(self, now: float, *why: Reason) -> None:
        """Hover here for the pilot; before the take-off: disarm. A landing continues."""
        self._stop(now, why, Phase.HOLDING, self._modes.hold)

    def _stop(self, now: float, why: tuple[Reason, ...], phase: Phase, mode: int) -> None:
        if self._leave_alone(now, *why) or self.phase not in (Phase.ARMING, Phase.CLIMBING, Phase.FLYING):
            return
        self.why = why
        if self.phase is Phase.ARMING:
            phase, mode = Phase.DISARMING, self._modes.hold
        self._enter(phase, now, mode)

    def poll(self, now: float) -> bytes:
        """Return the messages to send now; the same until `sent`. The link must have been read until it was empty."""
        self._offered = []
        if self.phase.active:
            self._advance(now)
        if self.phase in (Phase.ENDED, Phase.LOST):
            return b""
        messages, question = [], self.authority.question(now)
        if question and self._session.reachable:
            messages.append(question)
            self._offered.append(self.authority.asked)
        if self.phase.active and self.authority.holder is Holder.SEARCH and not self._session.doubtful:
            messages += self._due(now)
        return b"".join(map(self._session.encoder.pack, messages))

    def sent(self, now: float) -> float:
        """Count the messages of the last `poll` as sent. Returns when a set-point is due; infinite if none is."""
        for remember in self._offered:
            remember(now)
        self._offered = []
        due = self._set_points.next_s
        return due if due > now else math.inf

    def _advance(self, now: float) -> None:
        """Change to the next phase if this one has ended, or has taken too long."""
        late, in_mode = now - self._times.since, self.authority.in_mode
        if self.authority.silent(now) and not (self.authority.slow(now) and self.lands_by_itself):
            late_s = 0.0 if self.authority.settled else authority.ANSWER_S
            why = because(Why.MODE_UNKNOWN, seconds=authority.SILENT_S, late_s=late_s)
            if self.authority.slow(now):
                why = because(Why.ANSWERS_LATE, seconds=authority.ANSWER_S)
            if not self._leave_alone(now, why) and not self._lose_to_other():
                self._lose(why)
        elif not self.authority.settled:
            pass  # find out first who controls the vehicle
        elif self.phase is Phase.CLIMBING and self._climbed:
            self._enter(Phase.FLYING, now, self._modes.steer)
            self._times.next_order = now + max(0.0, _FLOWING_S - late)
        elif self.phase is Phase.HOLDING and in_mode and late > _STOPPED_S:
            self.phase = Phase.ENDED
        elif self.phase is Phase.YIELDING and late > _STOPPED_S and not (self._modes.px4 or self.sticks.known(now)):
            self._lose(because(Why.NO_RADIO))
        elif late > self._times.limit_s and not (self.phase is Phase.FLYING and in_mode):
            reasons = self._reasons() or [because(Why.NO_EXPLANATION)]
            if self.phase is Phase.ARMING and self.held_back:
                reasons = [self.held_back]
            why = because(Why.NOT_DONE, phase=self.phase.name.lower(), because=reasons)
            if self.phase in (Phase.CLIMBING, Phase.FLYING):
                self.land(now, why)
            else:
                self._lose(why)

    def _due(self, now: float) -> list[Any]:
        """Return the set-points, which have an effect in one mode only, and the orders, which may change the mode."""
        messages, vehicle = [], self._vehicle
        if not self._steered:
            self._set_points.rest()
        elif now >= self._set_points.next_s:
            self._offered.append(self._set_points.left)
            still = self.phase is not Phase.FLYING or self.authority.borrowed
            messages.append(self._set_points.message(vehicle, still=still))
        if now >= self._times.next_order:
            order, again = self._order(vehicle, now)
            if order is None:
                self._times.next_order = now + again
            elif self.authority.fresh(now):
                self._offered.append(partial(self._ordered, order, again))
                messages.append(order)
        return messages

    def _ordered(self, order: Any, again: float, now: float) -> None:
        self._times.next_order = now + again
        self._times.ordered_s = min(self._times.ordered_s, now)
        if self.phase is Phase.ARMING and order.command == _ARM:
            self._tries += 1
            refused = self._complaints.refused_order, self._complaints.refused_result
            self._emit(ArmingTried(now, self._session.name, self._tries, _ARM_AGAIN_S, *refused))

    def _order(self, vehicle: Vehicle, now: float) -> tuple[Any | None, float]:
        """Return the pending order, None if there is none, and the time [s] until it is repeated."""
        modes = self._modes
        to = vehicle.system, vehicle.component
        if self.phase is Phase.CLIMBING:
            assert self.origin is not None
            risen = self.height > RISEN_M
            return None if risen else modes.to_take_off(vehicle, self._take_off_m, self.origin.alt), _REPEAT_S
        if self.phase is Phase.DISARMING:
            return command(*to, _ARM, 0), _REPEAT_S
        if self.phase is Phase.ARMING and self.authority.in_mode:
            return (command(*to, _ARM, 1), _ARM_AGAIN_S) if not self.held_back else (None, 0.0)
        waits = self.phase is Phase.YIELDING and not (modes.px4 or self.sticks.throttle_in_middle(now))
        if self.authority.in_mode or waits:
            return None, 0.0
        if self.phase is Phase.LANDING:
            return command(*to, dialect.MAV_CMD_NAV_LAND), _REPEAT_S
        return modes.to_set(vehicle, self.authority.wanted), _REPEAT_S

    def on_packets(self, received: Received, now: float, since: float | None = None) -> None:
        """Use the packets that the session received.

        `since`: the time at which the link was last read until it was empty; default: now.
        """
        self._read_since = now if since is None else since
        for msgid, message in received.messages(_HANDLERS):
            _HANDLERS[msgid](self, message, now)

    def _on_heartbeat(self, message: Any, now: float) -> None:
        self.authority.on_mode(message.custom_mode, self._read_since, now)
        armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
        if not self.phase.active:
            return
        # an order to arm may be in transmission
        disarmed = self.phase is Phase.DISARMING and now - self._times.ordered_s > _STOPPED_S
        if (self.phase is Phase.LANDING or disarmed) and not armed:
            self.phase = Phase.ENDED
        elif self.phase is Phase.DISARMING:
            self._watch_mode(now)
        elif self.phase is Phase.ARMING and armed and not (self.authority.in_mode and self._tries):
            self._lose(because(Why.ARMED_BY_OTHER, mode=self._mode), handed_over=True)
        elif self.phase is not Phase.ARMING and not armed:
            self._lose(because(Why.DISARMED, mode=self._mode), *self._reasons())
        else:
            self._watch_mode(now)
            if self.phase is Phase.ARMING:
                self._stand(armed, now)

    def _on_current_mode(self, message: Any, now: float) -> None:
        """Use the present mode; the intended mode is not used.

        PX4 changes its mode when it disarms after a landing. By the heartbeat this was not the pilot.
        """
        self.authority.on_mode(message.custom_mode, self._read_since, now)
        if self.phase.active and self.phase is not Phase.LANDING:
            self._watch_mode(now)

    def _on_timesync(self, message: Any, now: float) -> None:
        self.authority.on_timesync(message, self._read_since, now)

    def _on_target(self, message: Any, now: float) -> None:
        """ArduPilot reports a target in GUIDED only while a place was ordered, not a velocity.

        One just after the beginning may be older than the first velocity.
        """
        new = now - max(self._times.target_s, self._times.since) > _NEW_TARGET_S
        self._times.target_s = now
        if new and self.phase is Phase.FLYING and self.authority.in_mode and not self._modes.px4:
            self._lose(because(Why.SENT_ELSEWHERE), handed_over=True)

    def _on_ack(self, message: Any, now: float) -> None:
        taken = self._session.answers_us(message) and self._complaints.on_ack(message)
        if taken and self.phase is Phase.CLIMBING and message.command == dialect.MAV_CMD_NAV_TAKEOFF:
            self._times.next_order = now + _TAKE_OFF_AGAIN_S

    def _on_text(self, message: Any, now: float) -> None:
        if text := self._complaints.on_text(message):
            self._emit(AutopilotText(now, self._session.name, text))

    def _on_status(self, message: Any, now: float) -> None:
        self._complaints.on_status(message)
        self.sticks.on_message(message, now)
        self._on_battery(message, now)

    def _on_battery(self, message: Any, now: float) -> None:
        self.battery.on_message(message, now)
        self._watch_pilot(now)

    def _on_sticks(self, message: Any, now: float) -> None:
        self.sticks.on_message(message, now, flown=self.phase is not Phase.ARMING)
        self._watch_pilot(now)

    def _watch_pilot(self, now: float) -> None:
        """Give the vehicle to the pilot after a stick was moved, or with a low battery.

        Set-points have velocity 0 at once. The mode is ordered a little later, because the autopilot may give the
        vehicle to the sticks by itself, or be about to report the mode of a switch. In another mode already, as PX4
        after a landing, the heartbeat decides.
        """
        moved, px4 = self.sticks.moved, self._modes.px4
        battery = self.battery.why(now)
        why = moved or (because(battery) if battery else None)
        if why is None or self.authority.usurped or self._leave_alone(now, why):
            return
        flown, steered = self.phase in (Phase.CLIMBING, Phase.FLYING), moved and self._steered
        on_the_ground = self.authority.mode == self._modes.hold  # PX4 is still in the mode in which it armed
        if self.phase is Phase.ARMING or (px4 and flown and (on_the_ground or not moved)):
            self.hold(now, why)
        elif (flown or steered) and self.authority.wanted != self._modes.yields:
            self.why = (why,)
            self._enter(Phase.YIELDING, now, self._modes.yields, _PX4_YIELDS_S if px4 else None)
            self._times.next_order = now + _OWN_MODE_S
            if not (px4 or self.sticks.throttle_in_middle(now)):
                self._emit(ThrottleAwaited(now, self._session.name, self.sticks.channel, self.sticks.by_us))


_HANDLERS: Final = {
    dialect.MAVLINK_MSG_ID_HEARTBEAT: Commander._on_heartbeat,
    MAVLINK_MSG_ID_CURRENT_MODE: Commander._on_current_mode,
    dialect.MAVLINK_MSG_ID_TIMESYNC: Commander._on_timesync,
    dialect.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: Commander._on_target,
    dialect.MAVLINK_MSG_ID_COMMAND_ACK: Commander._on_ack,
    dialect.MAVLINK_MSG_ID_STATUSTEXT: Commander._on_text,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: Commander._on_status,
    dialect.MAVLINK_MSG_ID_BATTERY_STATUS: Commander._on_battery,
    dialect.MAVLINK_MSG_ID_RC_CHANNELS: Commander._on_sticks,
    dialect.MAVLINK_MSG_ID_MANUAL_CONTROL: Commander._on_sticks,
}
