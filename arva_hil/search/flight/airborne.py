"""A search in the air: passes frames and poses to the mission, and its velocities to the commander."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from arva_hil.autopilot.commanding.commander import Commander, Phase
from arva_hil.autopilot.following.navigation import VehicleState
from arva_hil.autopilot.following.session import Session
from arva_hil.events import Event
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import FrameHeard, SearchBegun, SearchEnded, TakeOffPoint
from arva_hil.model.field.geodesy import LocalFrame
from arva_hil.model.field.rotation import heading
from arva_hil.search.flight.detour import Detour
from arva_hil.search.flight.team_report import TeamReport
from arva_hil.search.mission.ground import Ground
from arva_hil.search.mission.mission import Mission
from arva_hil.search.mission.outcome import SearchStep, lla
from arva_hil.search.mission.receiver_host import ReceiverHost
from arva_hil.search.strategies.analysis import Worker
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import Position, as_position
from arva_hil.search.team.team import Teammate
from firmware_proto import Frame

OLD_S: Final = 1.0  # an older pose is not used for the flight
STAY: Final = (0.0, 0.0, 0.0)
_REPORT_S: Final = 0.1  # between frames that are reported


class MissionRun:
    """A mission, flown or not: its frames with the receiver's pose, its take-off point, and a row for each step.

    `emit` gets the events, `log` the rows; None: none is made.
    """

    def __init__(
        self,
        plan: SearchPlan,
        session: Session,
        *,
        start: float,
        emit: Callable[[Event], None],
        log: Callable[[SearchStep], None] | None,
    ) -> None:
        self.mission: Mission | None = None
        self.origin: LocalFrame | None = None  # the take-off point
        self._plan = plan
        self._session = session
        self._start = start
        self._emit = emit
        self._log = log
        self._new_frame: Frame | None = None  # since the last row of the log
        self._report_s = -math.inf  # when a frame may be reported next
        self._skipped_s = 0.0  # in gaps, which do not count for the mission

    def on_frame(self, frame: Frame, state: VehicleState | None, now: float) -> None:
        """Use a new frame. `state`: as `state` returns it."""
        self._new_frame = frame
        position = heading_deg = None
        if state is not None:
            place, rotation = self._plan.mount.pose(state.position, state.attitude)
            position, heading_deg = as_position(place), math.degrees(math.atan2(rotation[1, 0], rotation[0, 0]))
            if self.mission is not None:
                self.mission.on_frame(frame, now - self._skipped_s, position, rotation)
        if now >= self._report_s:
            self._report_s = now + _REPORT_S
            self._emit(FrameHeard(now, frame, position, heading_deg))

    def _begin_at(self, now: float, origin: LocalFrame) -> None:
        self.origin = origin
        self._emit(TakeOffPoint(now, *lla(origin, 0.0, 0.0, 0.0)))

    def state(self, now: float) -> VehicleState | None:
        """Return the pose for the flight, None if there is none that is new enough."""
        state = self._session.navigation.state_at(now, self.origin) if self.origin else None
        return state if state is not None and state.age_s < OLD_S else None

    def _log_step(self, now: float, phase: str, state: VehicleState, velocity: Position) -> None:
        if self._log is None:
            return
        frame, self._new_frame = self._new_frame, None
        reading: tuple[int | None, ...] = (None, None, None, None)
        if frame is not None:
            reading = reading_of(frame, self.mission.choice.target if self.mission else None)
        place, north_deg = as_position(state.position), math.degrees(heading(state.attitude))
        self._log(SearchStep(now - self._start, phase, *place, north_deg, *velocity, *reading))


class Flight(MissionRun):
    """One flight from its take-off point on. `mission` begins at the end of the take-off.

    `team`: the other searches. `host`: commands to the receiver. `worker`: computes; None: in this loop.
    """

    def __init__(
        self,
        plan: SearchPlan,
        session: Session,
        commander: Commander,
        ground: Ground,
        *,
        start: float,
        emit: Callable[[Event], None],
        log: Callable[[SearchStep], None] | None,
        team: Teammate | None = None,
        host: ReceiverHost | None = None,
        worker: Worker | None = None,
    ) -> None:
        super().__init__(plan, session, start=start, emit=emit, log=log)
        self._commander = commander
        self._ground = ground
        self._team = team
        self._report = TeamReport(team, session, emit) if team else None
        self._host = host
        self._worker = worker
        self._last_pose_s = start
        self._down = 0.0  # the last command, m/s
        self._detour = Detour(emit)

    def skip(self, now: float, seconds: float) -> None:
        """Skip a gap until now, in which the mission's clock did not run."""
        self._skipped_s += seconds
        self._last_pose_s += seconds
        self._commander.steer(STAY)
        self._detour.restart()
        if self._team:
            self._team.skip(now)

    def wait(self, now: float) -> bool:
        """Wait on the ground. Return True if the vehicle must stay there because another one is above it."""
        self._last_pose_s = now
        self.report_place(now, searching=True)
        return self._team is not None and self._team.under_another

    def fly(self, now: float, state: VehicleState | None) -> None:
        """Fly one step. `state`: as `state` returns it."""
        if self.origin is None and (origin := self._commander.origin):
            self._begin_at(now, origin.frame)
            state = self.state(now)
        phase, velocity = self._commander.phase, STAY
        if not self._commander.authority.settled:
            return
        if state is None:
            self._fly_blind(now)
            return
        self._last_pose_s = now
        position = as_position(state.position)
        if self._report is not None and self.origin is not None:
            self._report.report_flown(now, lla(self.origin, *position), self.origin, self.mission)
        if phase is Phase.FLYING:
            if self.mission is None:
                plan = self._team.plan(self._plan, self.origin) if self._team and self.origin else self._plan
                self.mission = Mission(
                    plan,
                    now - self._skipped_s,
                    position,
                    land=self._plan.land,
                    emit=self._emit_in_time,
                    team=self._team,
                    host=self._host,
                    worker=self._worker,
                )
                about = plan.area, plan.strip_width, plan.limit_s
                self._emit(SearchBegun(now, -position[2], plan.victims, *about))
            receiver = self._plan.mount.place(state.position, state.attitude)
            followed = self._commander.authority.in_mode
            height = self._ground.height(now, state, self._down if followed else 0.0)
            velocity = self.mission.fly(now - self._skipped_s, position, receiver=as_position(receiver), height=height)
            if self.mission.ended or not followed:
                self._detour.restart()
            else:
                velocity = self._detour.around(now, velocity)
            if self._team:
                velocity = self._team.apart(position, velocity, self._plan.speed * self.mission.pace)
            self._commander.steer(velocity)
            self._down = velocity[2]
            if why := self._detour.observe(now, velocity, position, as_position(state.velocity)):
                self._commander.land(now, why)
            if self.mission.over and self.mission.ended:
                lands = height.landed or (self._plan.land and not self.mission.blocked)
                self._emit(SearchEnded(now, (self.mission.ended,), lands))
                blocked = [because(Why.BLOCKED_BELOW)] if self.mission.blocked else []
                (self._commander.land if lands else self._commander.hold)(now, *blocked)
        self._log_step(now, phase.name.lower(), state, velocity)

    def confirm(self, now: float) -> None:
        """Confirm the result after the landing, with the newest readings."""
        if self.mission is not None:
            self.mission.confirm(now - self._skipped_s)

    def report_place(self, now: float, *, searching: bool) -> None:
        """Report the place of a vehicle that this search does not fly: before its launch, or after its end."""
        if self._report is not None:
            self._report.report_left(now, self.origin, self.mission, searching=searching)

    def _fly_blind(self, now: float) -> None:
        """Hover without a new pose, then land."""
        self._commander.steer(STAY)
        if now - self._last_pose_s > self._plan.patience_s:
            lacking = self._session.why_no_pose()
            self._commander.land(now, because(Why.POSE_LOST, seconds=self._plan.patience_s, lacking=lacking))

    def _emit_in_time(self, event: Event) -> None:
        """Emit an event of the mission, whose clock does not run in gaps."""
        self._emit(replace(event, time_s=event.time_s + self._skipped_s))


def reading_of(frame: Frame, target: int | None) -> tuple[int | None, int, int, int]:
    """Return id, d, δ and zone of the transmitter searched for, otherwise of the first channel."""
    channel = next((c for c in frame.channels if c.valid and c.id == target), frame.channels[0])
    return channel.id, channel.d, channel.delta, channel.zone
