"""A search that only reports its orders, for a vehicle on the ground and the frames of now.

It makes no message: the commander never gets the order to launch.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from arva_hil.autopilot.commanding.commander import EVERY_S
from arva_hil.autopilot.following.modes import Modes, modes_of
from arva_hil.autopilot.following.navigation import PositionSample
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import DryRunBegun, OrderDetail, SetPointPlanned, WouldOrder
from arva_hil.model.field.rotation import heading
from arva_hil.search.flight.airborne import STAY, FlightSetup, MissionRun
from arva_hil.search.mission.ground import Height
from arva_hil.search.mission.mission import Mission
from arva_hil.search.mission.outcome import Refusal
from arva_hil.search.strategies.strategy import Position

_LAST_S: Final = 5.0  # of set-points
_SAY_S: Final = 1.0  # between set-points that are reported
_PHASE: Final = "dry run"  # in the log


class DryRun(MissionRun):
    """A mission that is computed but not flown. The vehicle is on the ground, or hovers with `take_over`.

    Readings are those of the receiver's present place. Set-points are for a vehicle at the height of the take-off above
    that place.
    """

    def __init__(self, setup: FlightSetup) -> None:
        super().__init__(setup)
        self._begun_s = math.inf
        self._say_next_s = -math.inf
        self._modes: Modes | None = None

    def step(self, now: float, mode: int) -> Refusal | None:
        """Report the orders that would be sent now, in this `mode`. Returns the outcome, None before the end."""
        place = self._setup.session.navigation.track.last_position
        if self.mission is None:
            assert self._setup.session.vehicle is not None
            assert place is not None
            try:
                self._modes = modes_of(self._setup.session.vehicle)
            except ValueError as error:
                return Refusal("failed", because(Why.ERROR, text=str(error)))
            self._begin(now, mode, self._modes, place)
        assert self.mission is not None
        self._fly(now, self.mission)
        if self.mission.broken:
            return Refusal("failed", because(Why.WOULD_END, because=self.mission.ended))
        if now - self._begun_s < _LAST_S:
            return None
        self._end(now)
        return Refusal("would fly", because(Why.WOULD_FLY))

    def _begin(self, now: float, mode: int, modes: Modes, place: PositionSample) -> None:
        plan, session, emit = self._setup.plan, self._setup.session, self._setup.emit
        home = session.navigation.home
        place = place._replace(alt=home[2]) if plan.take_over and home else place
        self._begun_s = now
        self._begin_at(now, place.frame)
        emit(DryRunBegun(now, str(session.vehicle), plan.take_over, plan.countdown_s))
        if not plan.take_over:
            if mode != modes.hold:
                emit(WouldOrder(now, "DO_SET_MODE", OrderDetail(modes.name(modes.hold))))
            emit(WouldOrder(now, "COMPONENT_ARM_DISARM", OrderDetail()))
            emit(WouldOrder(now, "NAV_TAKEOFF", OrderDetail(height_m=plan.take_off)))
        if mode != modes.steer and (plan.take_over or modes.steer != modes.take_off):
            emit(WouldOrder(now, "DO_SET_MODE", OrderDetail(modes.name(modes.steer), set_points_hz=1 / EVERY_S)))
        pose = self.pose(now)
        start = self._lifted((0.0, 0.0, pose.position[2] if pose is not None else 0.0))
        self.mission = Mission(replace(plan, land=False), now, start, emit=emit, worker=self._setup.worker)
        if self._new_frame is not None:
            self.on_frame(self._new_frame, pose, now)

    def _lifted(self, place: Position) -> Position:
        """Return the vehicle's place after its take-off."""
        return place if self._setup.plan.take_over else (place[0], place[1], min(place[2], -self._setup.plan.take_off))

    def _fly(self, now: float, mission: Mission) -> None:
        pose, plan = self.pose(now), self._setup.plan
        if pose is None:
            return
        height = self._setup.ground.height(now, pose.state)
        if not plan.take_over:
            height = Height(max(height.metres, plan.take_off), height.measured, height.margin)
        velocity = STAY
        if not mission.ended:
            velocity = mission.fly(now, self._lifted(pose.position), receiver=pose.receiver, height=height)
        if log := self._setup.log:
            self._log_step(log, now, _PHASE, pose, velocity)
        if now >= self._say_next_s and not mission.broken:
            self._say_next_s = now + _SAY_S
            heading_deg = math.degrees(heading(pose.state.attitude))
            self._setup.emit(SetPointPlanned(now, *velocity, heading_deg, 1 / EVERY_S))

    def _end(self, now: float) -> None:
        assert self._modes is not None
        emit = self._setup.emit
        if self._setup.plan.land:
            emit(WouldOrder(now, "NAV_LAND", OrderDetail(at_end=True)))
        elif self._modes.hold != self._modes.steer:
            emit(WouldOrder(now, "DO_SET_MODE", OrderDetail(self._modes.name(self._modes.hold), at_end=True)))
