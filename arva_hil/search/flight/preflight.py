"""A search on the ground. It arms nothing before the vehicle has a pose and the receiver sends frames.

A simulator is armed at once, any other vehicle only after a person has said yes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum, auto
from typing import Any, Final, NamedTuple, Protocol

from arva_hil.autopilot.commanding.commander import Commander
from arva_hil.autopilot.commanding.vehicle_checks import Failsafes, SimulatorCheck, fence_of
from arva_hil.autopilot.following.modes import ARDUCOPTER, PX4, modes_of
from arva_hil.autopilot.following.navigation import offset_m
from arva_hil.autopilot.following.session import Received, Session
from arva_hil.events import Event
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.events.searches import (
    ArmingAllowed,
    AutopilotKind,
    ConsentNeeded,
    CountDown,
    FailsafesKnown,
    FenceInArea,
    Lacking,
    ParameterDoubted,
    SimulatorRecognized,
    WaitingFor,
)
from arva_hil.links import Link
from arva_hil.links.processes import other_readers
from arva_hil.mavlink.codec import dialect
from arva_hil.runtime.link_monitor import LinkMonitor
from arva_hil.search.flight.airborne import OLD_S
from arva_hil.search.flight.links import QUIET_S, ReceiverLink
from arva_hil.search.mission.ground import LAND_M, Ground
from arva_hil.search.mission.outcome import Kind, Refusal
from arva_hil.search.strategies.plan import SearchPlan

_ANSWER_S: Final = 3.0  # for the answer of a simulator, once everything else is ready
_THINK_S: Final = 60.0  # for the answer of a person


class Question(Protocol):
    """A question to a person while the loop goes on."""

    def ask(self, label: str) -> None:
        """Ask if this vehicle, which is not known to be a simulator, may fly. Earlier input is no answer."""

    def answer(self) -> str | None:
        """Return the line typed since the question, None before that. Never waits."""


class Consent(Enum):
    """The state of a permission. `CONSENTS` has the transitions."""

    UNCHECKED = auto()
    CHECKING = auto()
    ASKING = auto()
    GIVEN = auto()


class ConsentRule(NamedTuple):
    """One row of the table of states."""

    meaning: str
    then: tuple[Consent, ...]
    """The states that may follow; instead, CHECKING and ASKING may end the search."""


CONSENTS: Final = {
    Consent.UNCHECKED: ConsentRule("the vehicle was not checked yet", (Consent.CHECKING,)),
    Consent.CHECKING: ConsentRule(
        "it may be a simulator: the search waits for its answer", (Consent.GIVEN, Consent.ASKING, Consent.UNCHECKED)
    ),
    Consent.ASKING: ConsentRule("a person is asked", (Consent.GIVEN, Consent.UNCHECKED)),
    Consent.GIVEN: ConsentRule("it may be armed, until it may be another vehicle", (Consent.UNCHECKED,)),
}


class Permission:
    """Remembers whether the vehicle is a simulator, and the person's answer.

    `yes`: a person has allowed it beforehand. `question`: None without a terminal. `dry_run`: nothing is armed, so the
    question is only reported.
    """

    def __init__(
        self, session: Session, *, yes: bool = False, question: Question | None = None, dry_run: bool = False
    ) -> None:
        self.consent = Consent.UNCHECKED
        self._session = session
        self._check = SimulatorCheck(session)
        self._yes = yes
        self._question = question
        self._dry_run = dry_run
        self._since_s = 0.0  # of CHECKING and of ASKING

    def on_packets(self, received: Received) -> None:
        """Use what the session received."""
        self._check.on_packets(received)

    def poll(self, now: float) -> bytes:
        """Return the messages to send to the vehicle."""
        return b"" if self.consent is Consent.GIVEN else self._check.poll(now)

    def forget(self) -> None:
        """Forget everything: it may be another vehicle now."""
        self._check.forget()
        self.consent = Consent.UNCHECKED

    def check(self, now: float, emit: Callable[[Event], None]) -> Refusal | bool:
        """Return True if the vehicle may be flown, False while that is unknown, or a refusal. Call it last.

        `emit` gets the event of the permission.
        """
        if self.consent is Consent.UNCHECKED:
            self.consent, self._since_s = Consent.CHECKING, now
        if self.consent is Consent.GIVEN:
            return True
        label = str(self._session.vehicle)
        if self._check.answer:
            self.consent = Consent.GIVEN
            emit(SimulatorRecognized(now, label, self._check.answer))
        elif self.consent is Consent.ASKING:
            return self._answered(now, label)
        elif now - self._since_s > _ANSWER_S:
            return self._ask(now, label, emit)
        return self.consent is Consent.GIVEN

    def _ask(self, now: float, label: str, emit: Callable[[Event], None]) -> Refusal | bool:
        if self._yes:
            emit(ArmingAllowed(now, label))
        elif self._dry_run:
            emit(ConsentNeeded(now, label, self._question is not None))
        elif self._question is None:
            return Refusal("refused", because(Why.NOBODY_ASKED, label=label))
        else:
            self.consent, self._since_s = Consent.ASKING, now
            self._question.ask(label)
            return False
        self.consent = Consent.GIVEN
        return True

    def _answered(self, now: float, label: str) -> Refusal | bool:
        assert self._question is not None
        answer = self._question.answer()
        if answer is None:
            late = now - self._since_s > _THINK_S
            return Refusal("refused", because(Why.ANSWER_LATE, label=label, seconds=_THINK_S)) if late else False
        if answer.strip().lower() != "yes":
            return Refusal("refused", because(Why.ANSWER_NO, label=label))
        self.consent = Consent.GIVEN
        return True


_HEARTBEAT: Final = dialect.MAVLINK_MSG_ID_HEARTBEAT
_PARAMETER: Final = dialect.MAVLINK_MSG_ID_PARAM_VALUE
_STILL_M_S: Final = 0.5
_STILL_S: Final = 1.0
_LOWEST_M: Final = 1.0  # above home
_LOWER_M: Final = 1.5  # the ground may be this much lower than home, plus the distance from there


class Hover:
    """The check before a search takes over a vehicle in the air: it hovers, in a mode that no pilot steers.

    Remembers since when it hovers. `ground`: has the rangefinder's value, which the height above home must allow.
    """

    def __init__(self, session: Session, ground: Ground) -> None:
        self._session = session
        self._ground = ground
        self._since = math.inf

    def why_not(self, now: float, mode: int) -> Reason | None:
        """Return the reason why it cannot be taken over now, None if it can. Call it a few times a second."""
        why = self._why_not(now, mode)
        self._since = math.inf if why else min(self._since, now)
        if not why and now - self._since < _STILL_S:
            return because(Why.JUST_STOPPED)
        return why

    def _why_not(self, now: float, mode: int) -> Reason | None:
        vehicle, place, home = (
            self._session.vehicle,
            self._session.navigation.track.last_position,
            self._session.navigation.home,
        )
        if vehicle is None or place is None or home is None:
            return because(Why.HOME_UNKNOWN)
        if not vehicle.armed:
            return because(Why.NOT_ARMED)
        try:
            modes = modes_of(vehicle)
        except ValueError as error:
            return because(Why.ERROR, text=str(error))
        if mode not in modes.hovers:
            return because(Why.IN_MODE, mode=modes.name(mode))
        height, speed = place.alt - home[2], math.hypot(*place.velocity)
        if height < _LOWEST_M:
            return because(Why.NEAR_HOME, height_m=height, least_m=_LOWEST_M)
        north, east, _ = offset_m(home, place.place)
        measured = self._ground.measured(now) or 0.0
        if measured > height + _LOWER_M + math.hypot(north, east):
            return because(Why.RANGEFINDER_HIGH, measured_m=measured, height_m=height)
        return because(Why.MOVES, speed=speed) if speed >= _STILL_M_S else None


class ModeWatch:
    """Remembers the mode of the last heartbeat; None if none came since the link was opened, or since a gap.

    `armed_since`: the first check that found the vehicle armed [s].
    `taken`: another program has set the mode that follows set-points. The mode that the commander's authority remembers
    is not used: it may come from a CURRENT_MODE before the first heartbeat, which says whose mode it is.
    """

    def __init__(self) -> None:
        self.mode: int | None = None
        self.taken = False
        self.armed_since = math.inf
        self._vehicle: tuple[int, ...] = ()

    def is_another(self, session: Session) -> bool:
        """Return True if the vehicle is another one than at the last call, or has rebooted since."""
        vehicle, before = session.vehicle, self._vehicle
        if vehicle is not None:
            reboots = session.navigation.reboots
            self._vehicle = vehicle.system, vehicle.component, vehicle.autopilot, vehicle.kind, reboots
        return before not in ((), self._vehicle)

    def on_heartbeat(self, message: Any) -> None:
        """Use a heartbeat of the vehicle."""
        mode, px4 = message.custom_mode, message.autopilot == dialect.MAV_AUTOPILOT_PX4
        self.taken |= self.mode not in (None, mode) and mode == (PX4 if px4 else ARDUCOPTER).steer
        self.mode = mode


class Wait:
    """The wait until all is ready, at most `limit_s`, then the count-down before propellers turn.

    Remembers since when a search waits, and what for. The time in which a person is asked does not count. Remembers the
    end of the count-down, and the number to report next.
    """

    def __init__(self, start: float, limit_s: float, countdown_s: float, emit: Callable[[Event], None]) -> None:
        self._since = self._checked_s = start
        self._limit_s = limit_s
        self._countdown_s = countdown_s
        self._emit = emit
        self._what: Lacking | None = None
        self._end_s = math.inf
        self._next_report = 0

    def check(self, now: float, *, asking: bool) -> None:
        """Continue until now."""
        if asking:
            self._since += now - self._checked_s
        self._checked_s = now

    def lack(self, what: Lacking, now: float, kind: Kind, why: Reason) -> Refusal | bool:
        """Wait for what is not ready. Returns False, or a refusal after the limit."""
        self.restart()
        if what != self._what:
            self._what = what
            self._emit(WaitingFor(now, what))
        return Refusal(kind, why) if now - self._since > self._limit_s else False

    def restart(self) -> None:
        """Count down from the beginning at the next call of `is_over`."""
        self._end_s = math.inf

    def is_over(self, now: float, *, taken_over: bool) -> bool:
        """Count down. Returns True at the end. `taken_over`: the vehicle flies already."""
        if self._end_s == math.inf:
            self._end_s = now + self._countdown_s
            self._next_report = math.ceil(self._countdown_s)
        left = self._end_s - now
        if 0 < left <= self._next_report:
            self._emit(CountDown(now, self._next_report, taken_over))
            self._next_report = math.ceil(left) - 1
        return left <= 0


class Preflight:
    """The checks before a launch.

    `permission`: to fly this vehicle; None if every vehicle may be flown. `commander`: has the vehicle's battery and
    sticks. `failsafes`: of the vehicle. `emit` gets the events.
    """

    def __init__(
        self,
        plan: SearchPlan,
        session: Session,
        autopilot: Link,
        receiver: ReceiverLink,
        commander: Commander,
        permission: Permission | None,
        ground: Ground,
        *,
        start: float,
        emit: Callable[[Event], None],
    ) -> None:
        self.failsafes = Failsafes()
        self._emit = emit
        self._session = session
        self._monitor = LinkMonitor("autopilot", autopilot, self._lost, session.resume)
        self._receiver = receiver
        self._commander = commander
        self._wait = Wait(start, plan.timeout_s, 0.0 if plan.dry_run else plan.countdown_s, emit)
        self._plan = plan
        self._permission = permission
        self._hover = Hover(session, ground) if plan.take_over else None
        self._alone = False  # True if no other program read the receiver at the first check
        self._watch = ModeWatch()

    def on_packets(self, received: Received) -> None:
        """Use what the session received."""
        if self._watch.is_another(self._session):
            self.restart()
        for msgid, message in received.messages((_HEARTBEAT, _PARAMETER)):
            if msgid == _HEARTBEAT:
                self._watch.on_heartbeat(message)
            else:
                self.failsafes.on_parameter(message)
        if self._permission:
            self._permission.on_packets(received)

    def poll(self, now: float) -> bytes:
        """Return the requests to send now."""
        session = self._session
        out = self._permission.poll(now) if self._permission else b""
        if session.vehicle and self._watch.mode is not None and not session.lost:
            out += b"".join(map(session.encoder.pack, self.failsafes.poll(now, session.vehicle)))
        return out

    def restart(self) -> None:
        """Wait for a heartbeat after a gap, a loss of the link or a reboot, and check everything again.

        The vehicle may be another one, or have other parameters.
        """
        self._watch.mode = None
        self._wait.restart()
        self.failsafes = Failsafes()
        if self._permission:
            self._permission.forget()

    def watch_link(self, now: float) -> None:
        """Check for a loss of the link: after one the vehicle may have rebooted."""
        for event in self._monitor.poll(now):
            self._emit(event)

    def _lost(self, why: str, now: float) -> None:
        self._session.interrupt(why)
        self.restart()

    def check(self, now: float) -> Refusal | bool:
        """Return True if all is ready for the flight, False while it is not, a refusal if it cannot become ready."""
        self._wait.check(now, asking=self._permission is not None and self._permission.consent is Consent.ASKING)
        session, mode, lack = self._session, self._watch.mode, self._wait.lack
        if self._monitor.link.away:
            return lack("link", now, "no link", because(Why.ERROR, text=self._monitor.link.why))
        if session.vehicle is None or mode is None:
            return lack("autopilot", now, "no link", because(Why.NO_AUTOPILOT, heard=session.why_no_vehicle()))
        if self._watch.taken and not self._hover:
            return Refusal("failed", because(Why.MODE_SET_BY_PROGRAM))
        if session.vehicle.armed and not self._hover:
            self._watch.armed_since = min(self._watch.armed_since, now)
            if now - self._watch.armed_since < QUIET_S:  # another search that flies the vehicle announces itself
                self._wait.restart()
                return False
            return Refusal("failed", because(Why.ARMED_ALREADY))
        if self._receiver.silent(now):
            return lack("frame", now, "no link", self._receiver.why_silent(now))
        if no_pose := self.why_no_pose(now):
            return lack("pose", now, "failed", no_pose)
        newest = self._commander.authority.mode  # PX4 sends a heartbeat once a second, and each new mode at once
        if self._hover and (moving := self._hover.why_not(now, newest)):
            return lack("hover", now, "failed", because(Why.CANNOT_TAKE_OVER, because=moving))
        battery = self._commander.battery.why(now)
        if battery is Why.BATTERY_LOW:
            return Refusal("failed", because(Why.BATTERY_LOW_BEFORE))
        if battery is not None:
            return lack("battery", now, "failed", because(Why.BATTERY_UNKNOWN_BEFORE))
        if not self.failsafes.done:
            return False
        permitted = self._permitted(now)
        ready = self._wait.is_over(now, taken_over=self._hover is not None) if permitted is True else permitted
        if ready is True or not self._alone:  # again after a person was asked, because it may have changed
            self._alone = True
            if others := other_readers(self._receiver.name):
                return Refusal("no link", because(Why.PORT_SHARED, port=self._receiver.name, readers=others))
        return ready

    def _permitted(self, now: float) -> Refusal | bool:
        """Return True if the vehicle may be armed, False while that is unknown, or a refusal."""
        if not self.failsafes.reported:
            self.failsafes.reported = True
            parameters = tuple(self.failsafes.values.items())
            autopilot: AutopilotKind = "px4" if self.failsafes.px4 else "ardupilot"
            self._emit(FailsafesKnown(now, autopilot, parameters, self._commander.sticks.remote))
            for doubt in self.failsafes.doubts():
                self._emit(ParameterDoubted(now, *doubt))
            if beyond := self._compare_fence(now):
                return Refusal("failed", beyond)
        return self._permission.check(now, self._emit) if self._permission else True

    def _compare_fence(self, now: float) -> Reason | None:
        """Report a fence inside the area. Return the reason against any flight, or None."""
        fence, plan = fence_of(self.failsafes.values, px4=self.failsafes.px4), self._plan
        place, home = self._session.navigation.track.last_position, self._session.navigation.home
        start = offset_m(home, place.place) if self._hover and place and home else (0.0, 0.0)  # home: where it arms
        south, west, north, east = (edge + start[n % 2] for n, edge in enumerate(plan.area))
        farthest = math.hypot(max(-south, north), max(-west, east))
        nearest = math.hypot(max(south, -north, 0.0), max(west, -east, 0.0))
        highest = plan.height if self._hover else max(plan.height, plan.take_off)
        for limit, needed_m in (fence.radius, nearest), (fence.height, highest):
            if limit and needed_m > limit.metres:
                return because(Why.BEYOND_FENCE, area=limit is fence.radius, **limit._asdict(), needed_m=needed_m)
        lowest = min(LAND_M) if plan.land else plan.height
        if fence.lowest and lowest < fence.lowest.metres:
            return because(Why.BEYOND_FENCE, area=False, **fence.lowest._asdict(), needed_m=lowest)
        if fence.radius and farthest > fence.radius.metres:
            self._emit(FenceInArea(now, *fence.radius, farthest))
        if fence.points:
            self._emit(FenceInArea(now, "FENCE_TOTAL", fence.points, 0.0))
        return None

    def why_no_pose(self, now: float) -> Reason | None:
        """Return the reason if the pose is not known or too old, otherwise None."""
        place = self._session.navigation.track.last_position
        state = self._session.navigation.state_at(now, place.frame) if place else None
        known = state is not None and state.age_s < OLD_S and not self._session.lost
        return None if known else because(Why.NO_POSE, lacking=self._session.why_no_pose())
