"""What a flight by orders stands on: how far it is, why, where it began, whose mode it is in."""

from __future__ import annotations

import math
from typing import Final

from arva_hil.field.quaternion import heading
from arva_hil.flight import authority, battery, sticks
from arva_hil.flight.authority import Authority
from arva_hil.flight.battery import Battery
from arva_hil.flight.complaints import Complaints
from arva_hil.flight.phase import Phase
from arva_hil.flight.set_points import Pace
from arva_hil.flight.sticks import Sticks
from arva_hil.vehicle.modes import ARDUCOPTER
from arva_hil.vehicle.pose_track import PositionSample
from arva_hil.vehicle.session import Session

_STALLED: Final = (
    " (this program was held up, and no set-point left for {:.1f} s before: PX4 leaves OFFBOARD after COM_OF_LOSS_T)"
)
_LEAD_S: Final = 0.5  # from an order to what comes of it
_STEERED: Final = (Phase.FLYING, Phase.HOLDING, Phase.YIELDING)
RISEN_M: Final = 0.5  # no drift of an altitude: it has taken off


class FlightState:
    """Remembers the phase of a flight, since when it lasts, and what the vehicle said of itself in it.

    `why` says why it was LOST, or had to land. Once it is LOST nothing is sent any more: the pilot has the vehicle, if
    it was `handed_over`, or the autopilot's own failsafe. `origin`: where it armed. `take_off_m`: how high it climbs.
    """

    def __init__(self, session: Session, take_off_m: float) -> None:
        self.phase = Phase.IDLE
        self.why = ""
        self.handed_over = False
        self.origin: PositionSample | None = None
        self.sticks = Sticks()
        self.battery = Battery()
        self._session = session
        self._take_off_m = take_off_m
        self._modes = ARDUCOPTER  # until the launch
        self._yaw = 0.0
        self._borrowing = False  # it flies in the mode of who had it, and does not follow us yet
        self._authority = Authority()
        self._since = 0.0  # in this phase
        self._limit_s = math.inf  # of it
        self._next_order = -math.inf
        self._ordered_s = math.inf  # when the first order of this phase was sent
        self._pace = Pace()  # of the set-points
        self._complaints = Complaints()
        self._news = session.news
        session.want(authority.WANTED | sticks.WANTED | battery.WANTED)

    def let_go(self) -> None:
        """Send nothing any more."""
        if self.phase is not Phase.ENDED:
            self.phase = Phase.LOST

    def doubt(self, now: float) -> None:
        """There was a gap: no order before news that comes after it shows the mode that was ordered."""
        self._authority.doubt(now)

    @property
    def mode(self) -> int:
        """Its custom mode, as last heard; -1 before."""
        return self._authority.mode

    @property
    def settled(self) -> bool:
        """There is no doubt who has the vehicle."""
        return self._authority.settled

    @property
    def lands_by_itself(self) -> bool:
        """It is in the mode that lands."""
        return self._authority.wanted == self._modes.land and self._authority.in_mode

    @property
    def height(self) -> float:
        """Above the take-off point, m; 0 while that is not known."""
        last = self._session.track.last_position
        return last.alt - self.origin.alt if last and self.origin else 0.0

    @property
    def _climbed(self) -> bool:
        """It is high enough, or will be when it has heard so: PX4 climbs on until then."""
        enough = 0.9 * self._take_off_m - 0.1
        if not self._modes.px4:
            return self.height > enough
        last = self._session.track.last_position
        return self.height > RISEN_M and self.height - (last.velocity[2] if last else 0.0) * _LEAD_S > enough

    @property
    def _steered(self) -> bool:
        """Set-points flow without a pause until another mode needs none. In a take-off ArduPilot would obey them."""
        landing = self.phase is Phase.LANDING and not self.lands_by_itself
        return landing or self.phase in _STEERED or (self.phase is Phase.CLIMBING and self._modes.px4)

    def _reasons(self) -> str:
        """What it has answered and said in this phase, for a person."""
        return self._complaints.why(status=self.phase is Phase.ARMING)

    def _enter(self, phase: Phase, now: float, wanted: int, limit_s: float | None = None) -> None:
        metres = self._take_off_m if phase is Phase.CLIMBING else self.height
        self.phase, self._since = phase, now
        self._limit_s = phase.limit_s(metres) if limit_s is None else limit_s
        self._next_order, self._ordered_s = -math.inf, math.inf
        self._complaints.begin(keep_texts=phase is Phase.ARMING)
        self._authority.want(wanted, ours=phase not in (Phase.ARMING, Phase.DISARMING))

    def _leave_alone(self, why: str) -> bool:
        """Before it follows us, whatever speaks against it ends the take-over: nothing has to be undone by an order."""
        if self._borrowing and self.phase.active:
            self._lose("; ".join(filter(None, [why, "it was not taken over"])), handed_over=True)
        return self._borrowing

    def _lose(self, why: str, *, handed_over: bool = False) -> None:
        self.phase, self.handed_over = Phase.LOST, handed_over
        self.why = "; ".join(filter(None, [self.why, why]))

    def _stand(self, armed: bool, now: float) -> None:
        """Note place and heading: until it arms an autopilot still moves them while it settles."""
        place = self._session.track.last_position
        if place is not None and self._turn(now, place):
            self.origin = place
        if armed and self.origin is not None:
            self._enter(Phase.CLIMBING, now, self._modes.take_off)

    def _turn(self, now: float, place: PositionSample) -> bool:
        """Keep the heading that it has; False when that is not known."""
        state = self._session.state_at(now, place.frame)
        if state is not None:
            self._yaw = heading(state.attitude.tolist())
        return state is not None

    def _watch_mode(self, now: float) -> None:
        """A mode that does not come of an order of ours is somebody else's: the pilot's, or a failsafe's.

        PX4 arms in the mode that holds, and may be in it until it has risen. It does not come back to it by itself, for
        its take-off is ordered to more than the height at which it is told to follow set-points.
        """
        name, in_mode = self._modes.name(self._authority.mode), self._authority.in_mode
        risen = self.phase is Phase.CLIMBING and self.height > RISEN_M
        if self._authority.usurped or (risen and not in_mode):
            stalled = self._pace.stalled_s(now) if self._modes.px4 else 0.0
            why = f"the mode is {name}: the pilot or a failsafe has taken over"
            self._lose(why + (_STALLED.format(stalled) if stalled else ""), handed_over=True)
        elif self.phase is Phase.YIELDING and in_mode:
            self._lose(f"the pilot has it, in {name}", handed_over=True)
