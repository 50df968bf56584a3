"""A search that only reports its orders: from the vehicle on the ground and the frames that come now.

No message is made here. The commander never gets the order to launch, so it has nothing to send.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from arva_hil.autopilot.commanding.state import EVERY_S
from arva_hil.autopilot.following.modes import Modes, modes_of
from arva_hil.autopilot.following.pose_track import PositionSample
from arva_hil.autopilot.following.session import Session
from arva_hil.events import Event
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import DryRunBegun, OrderDetail, SetPointPlanned, WouldOrder
from arva_hil.model.field.geodesy import LocalFrame
from arva_hil.model.field.quaternion import heading
from arva_hil.search.flight.airborne import STAY, reading_of
from arva_hil.search.flight.frames_told import FramesTold, as_position, take_off_point
from arva_hil.search.mission.ground import Ground, Height
from arva_hil.search.mission.mission import Mission
from arva_hil.search.mission.outcome import Refusal, SearchStep
from arva_hil.search.strategies.analysis import Worker
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import Position
from firmware_proto import Frame

_LAST_S: Final = 5.0  # of set-points
_SAY_S: Final = 1.0  # between set-points that are reported
_PHASE: Final = "dry run"  # in the log


class DryRun:
    """Remembers the mission that would be flown. The vehicle is on the ground, or hovers with `take_over`.

    Readings are used at the receiver's present place; set-points are for a vehicle at the height of the take-off above
    it. `emit` gets the events, `log` a row for each step. `worker`: computes; None: in this loop.
    """

    def __init__(
        self,
        plan: SearchPlan,
        session: Session,
        ground: Ground,
        *,
        start: float,
        emit: Callable[[Event], None],
        log: Callable[[SearchStep], None],
        worker: Worker | None = None,
    ) -> None:
        self._plan = plan
        self._session = session
        self._ground = ground
        self._start = start
        self._emit = emit
        self._log = log
        self._worker = worker
        self._begun_s = math.inf
        self._say_next_s = -math.inf
        self._mission: Mission | None = None
        self._origin: LocalFrame | None = None
        self._modes: Modes | None = None
        self._last: Frame | None = None  # since the last row of the log
        self._frames = FramesTold(plan.mount, emit)

    def hear(self, frame: Frame, now: float) -> None:
        """Use a new frame."""
        self._last = frame
        state = self._session.state_at(now, self._origin) if self._origin else None
        if self._mission is not None and state is not None:
            place, rotation = self._plan.mount.pose(state.position, state.attitude)
            self._mission.hear(frame, now, as_position(place), rotation)
        self._frames.tell(frame, now, state)

    def step(self, now: float, mode: int) -> Refusal | None:
        """Report the orders that would be sent now. Returns the outcome, None before the end. `mode`: at present."""
        place = self._session.track.last_position
        if self._mission is None:
            assert self._session.vehicle is not None
            assert place is not None
            try:
                self._modes = modes_of(self._session.vehicle)
            except ValueError as error:
                return Refusal("failed", because(Why.ERROR, text=str(error)))
            self._begin(now, mode, self._modes, place)
        assert self._mission is not None
        self._fly(now, self._mission)
        if self._mission.broken:
            return Refusal("failed", because(Why.WOULD_END, because=self._mission.ended))
        if now - self._begun_s < _LAST_S:
            return None
        self._end(now)
        return Refusal("would fly", because(Why.WOULD_FLY))

    def _begin(self, now: float, mode: int, modes: Modes, place: PositionSample) -> None:
        session, take_off = self._session, self._plan.take_off
        home = session.home
        place = place._replace(alt=home[2]) if self._plan.take_over and home else place
        self._begun_s, self._origin = now, place.frame
        emit = self._emit
        emit(take_off_point(now, place.frame))
        emit(DryRunBegun(now, str(session.vehicle), self._plan.take_over, self._plan.countdown_s))
        if not self._plan.take_over:
            if mode != modes.hold:
                emit(WouldOrder(now, "DO_SET_MODE", OrderDetail(modes.name(modes.hold))))
            emit(WouldOrder(now, "COMPONENT_ARM_DISARM", OrderDetail()))
            emit(WouldOrder(now, "NAV_TAKEOFF", OrderDetail(height_m=take_off)))
        if mode != modes.steer and (self._plan.take_over or modes.steer != modes.take_off):
            emit(WouldOrder(now, "DO_SET_MODE", OrderDetail(modes.name(modes.steer), set_points_hz=1 / EVERY_S)))
        place_ned = self._lifted((0.0, 0.0, -self._height(now)))
        self._mission = Mission(self._plan, now, place_ned, emit=emit, worker=self._worker)
        if self._last is not None:
            self.hear(self._last, now)

    def _height(self, now: float) -> float:
        state = self._session.state_at(now, self._origin) if self._origin else None
        return -float(state.position[2]) if state is not None else 0.0

    def _lifted(self, place: Position) -> Position:
        """The vehicle's place after its take-off."""
        return place if self._plan.take_over else (place[0], place[1], min(place[2], -self._plan.take_off))

    def _fly(self, now: float, mission: Mission) -> None:
        state = self._session.state_at(now, self._origin) if self._origin else None
        if state is None:
            return
        position = as_position(state.position)
        receiver, _ = self._plan.mount.pose(state.position, state.attitude)
        height = self._ground.height(now, state)
        if not self._plan.take_over:
            height = Height(max(height.metres, self._plan.take_off), height.measured, height.margin)
        velocity = STAY
        if not mission.ended:
            velocity = mission.fly(now, self._lifted(position), receiver=as_position(receiver), height=height)
        heading_deg = math.degrees(heading(state.attitude))
        frame, self._last = self._last, None
        reading = reading_of(frame, mission.target) if frame else (None, None, None, None)
        self._log(SearchStep(now - self._start, _PHASE, *position, heading_deg, *velocity, *reading))
        if now >= self._say_next_s and not mission.broken:
            self._say_next_s = now + _SAY_S
            self._emit(SetPointPlanned(now, *velocity, heading_deg, 1 / EVERY_S))

    def _end(self, now: float) -> None:
        assert self._modes is not None
        emit = self._emit
        if self._plan.land:
            emit(WouldOrder(now, "NAV_LAND", OrderDetail(at_end=True)))
        elif self._modes.hold != self._modes.steer:
            emit(WouldOrder(now, "DO_SET_MODE", OrderDetail(self._modes.name(self._modes.hold), at_end=True)))
