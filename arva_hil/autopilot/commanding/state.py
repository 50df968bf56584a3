"""The state of a flight by orders: its phase, the pace of its set-points, and what is known of the vehicle."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum, auto
from typing import Final

from arva_hil.autopilot.commanding.authority import MODE_WANTED, Authority
from arva_hil.autopilot.commanding.complaints import BATTERY_WANTED, Battery, Complaints
from arva_hil.autopilot.commanding.sticks import STICKS_WANTED, Sticks
from arva_hil.autopilot.following.modes import ARDUCOPTER
from arva_hil.autopilot.following.pose_track import PositionSample
from arva_hil.autopilot.following.session import Session
from arva_hil.events import Event
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.model.field.quaternion import heading


class Phase(Enum):
    """ENDED: landed, disarmed or left hovering, as ordered. LOST: we do not control the vehicle any more.

    YIELDING: the vehicle is stopped, and given to the pilot: ArduPilot in LOITER, PX4 in hold.
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
        """True if messages may be sent."""
        return self not in _SILENT


_SILENT: Final = (Phase.IDLE, Phase.ENDED, Phase.LOST)
_LIMITS: Final = {  # limit of a phase: s, and s per metre
    Phase.ARMING: (math.inf, 0.0),
    Phase.CLIMBING: (30.0, 1.0),
    Phase.FLYING: (10.0, 0.0),
    Phase.LANDING: (90.0, 2.0),
    Phase.DISARMING: (10.0, 0.0),
    Phase.HOLDING: (5.0, 0.0),
    Phase.YIELDING: (60.0, 0.0),
}


EVERY_S: Final = 0.2  # PX4 leaves OFFBOARD below 2 Hz, ArduPilot stops after 3 s
_LONG_S: Final = 0.8  # PX4's COM_OF_LOSS_T is 1 s
_OF_LATE_S: Final = 5.0


class SetpointPace:
    """Remembers the last set-point and the longest recent gap. Times are seconds on the caller's clock."""

    def __init__(self) -> None:
        self._last = self._next = -math.inf
        self._longest = (0.0, -math.inf)  # the gap [s], and when it ended

    def due(self, now: float) -> bool:
        return now >= self._next

    def left(self, now: float) -> None:
        """Count a set-point as sent."""
        gap = now - self._last
        if self._last > -math.inf and (gap > self._longest[0] or now - self._longest[1] > _OF_LATE_S):
            self._longest = gap, now
        self._last, self._next = now, max(self._next + EVERY_S, now)

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


class FlightState:
    """Remembers the phase of a flight, its start, and the vehicle's reports in it.

    `why`: the reasons if the flight is LOST, or had to land. Once it is LOST nothing is sent: the pilot controls the
    vehicle if it was `handed_over`, otherwise the autopilot's own failsafe does. `origin`: the place of the arming;
    `take_off_m`: the height of the take-off.
    """

    def __init__(self, session: Session, take_off_m: float, emit: Callable[[Event], None]) -> None:
        self.phase = Phase.IDLE
        self.why: tuple[Reason, ...] = ()
        self.handed_over = False
        self.origin: PositionSample | None = None
        self.sticks = Sticks()
        self.battery = Battery()
        self.authority = Authority()
        self._session = session
        self._take_off_m = take_off_m
        self._modes = ARDUCOPTER  # until the launch
        self._yaw = 0.0
        self._taken: float | None = None  # seconds without set-points before another mode was reported
        self._borrowing = False  # still in the mode of the take-over: it does not follow set-points yet
        self._since = 0.0  # of this phase
        self._limit_s = math.inf  # of this phase
        self._next_order = -math.inf
        self._ordered_s = math.inf  # when the first order of this phase was sent
        self._pace = SetpointPace()  # of the set-points
        self._complaints = Complaints()
        self._emit = emit
        session.want(MODE_WANTED | STICKS_WANTED | BATTERY_WANTED)

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
        last = self._session.track.last_position
        return last.alt - self.origin.alt if last and self.origin else 0.0

    @property
    def _climbed(self) -> bool:
        """True if the vehicle is high enough, or will be when the next order reaches it: PX4 climbs until then."""
        enough = 0.9 * self._take_off_m - 0.1
        if not self._modes.px4:
            return self.height > enough
        last = self._session.track.last_position
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
        self.phase, self._since = phase, now
        fixed_s, each_metre_s = _LIMITS[phase]
        self._limit_s = fixed_s + each_metre_s * max(metres, 0.0) if limit_s is None else limit_s
        self._next_order, self._ordered_s = -math.inf, math.inf
        self._complaints.begin(keep_texts=phase is Phase.ARMING)
        self.authority.want(wanted, ours=phase not in (Phase.ARMING, Phase.DISARMING))

    def _leave_alone(self, *why: Reason) -> bool:
        """End a take-over before the vehicle follows set-points: no order has to be undone."""
        if self._borrowing and self.phase.active:
            self._lose(*why, because(Why.NOT_TAKEN_OVER), handed_over=True)
        return self._borrowing

    def _lose(self, *why: Reason, handed_over: bool = False) -> None:
        self.phase, self.handed_over = Phase.LOST, handed_over
        self.why += why

    def _stand(self, armed: bool, now: float) -> None:
        """Remember place and heading. An autopilot still corrects them until it arms."""
        place = self._session.track.last_position
        if place is not None and self._turn(now, place):
            self.origin = place
        if armed and self.origin is not None:
            self._enter(Phase.CLIMBING, now, self._modes.take_off)

    def _turn(self, now: float, place: PositionSample) -> bool:
        """Keep the present heading. Returns False if it is not known."""
        state = self._session.navigation.state_at(now, place.frame)
        if state is not None:
            self._yaw = heading(state.attitude)
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
            self._taken = self._pace.stalled_s(now) if self._modes.px4 else 0.0
        if self._taken is not None and self.authority.settled:
            self._lose(because(Why.MODE_TAKEN, mode=self._mode, stalled_s=self._taken), handed_over=True)
        elif self.phase is Phase.YIELDING and in_mode:
            self._lose(because(Why.PILOT_HAS_IT, mode=self._mode), handed_over=True)

    @property
    def _mode(self) -> str:
        """The name of the present mode."""
        return self._modes.name(self.authority.mode)
