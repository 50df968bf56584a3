"""A search in the air: passes frames and poses to the mission, and its velocities to the commander.

The horizontal velocity ordered is compared with the motion reported. A vehicle that does not follow is ordered
sideways once; then the search ends. Velocities are complex numbers, north + i·east. Over a window the motion is fitted
as a multiple of the order: 1 for a vehicle that follows, 0 for one that stands, i for one that flies 90° to the right.
"""

from __future__ import annotations

import cmath
import math
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.autopilot.commanding.commander import Commander, Phase
from arva_hil.autopilot.following.navigation import VehicleState
from arva_hil.autopilot.following.session import Received, Session
from arva_hil.events import Event
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.events.searches import (
    FrameHeard,
    SearchBegun,
    SearchEnded,
    SetPointsNotFollowed,
    TakeOffPoint,
    TeammateBack,
    TeammateLost,
)
from arva_hil.model.field.geodesy import LocalFrame
from arva_hil.model.field.rotation import heading
from arva_hil.search.mission.accuracy import PositionAccuracy
from arva_hil.search.mission.choice import NO_ID
from arva_hil.search.mission.ground import Ground
from arva_hil.search.mission.mission import Mission
from arva_hil.search.mission.outcome import SearchStep, lla
from arva_hil.search.mission.victims import ReceiverHost
from arva_hil.search.strategies.analysis import Worker
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import Position, as_position
from arva_hil.search.team.team import Teammate
from arva_hil.search.team.team_tunnel import HeardAt
from firmware_proto import Frame

OLD_S: Final = 1.0  # an older pose is no place of the vehicle, and not used for the flight


class TeamReport:
    """Remembers the last report. It also reports before the launch and after the search, while the vehicle sends."""

    def __init__(self, team: Teammate, session: Session, emit: Callable[[Event], None]) -> None:
        self._team = team
        self._session = session
        self._emit = emit
        self._lost: set[int] = set()
        self._flying = False  # as in the last report

    def report_flown(
        self,
        now: float,
        place: tuple[float, float, float],
        origin: LocalFrame,
        mission: Mission | None,
        *,
        searching: bool,
    ) -> None:
        """Report that the vehicle is in the air, at `place` (degrees, degrees, metres AMSL).

        `searching`: the search flies it; otherwise it lands, or is given to the pilot.
        """
        self._report(now, place, origin, mission, flying=True, searching=searching)
        lost = self._team.lost
        for number in lost.keys() - self._lost:
            self._emit(TeammateLost(now, number + 1, *lost[number]))
        for number in self._lost - lost.keys():
            self._emit(TeammateBack(now, number + 1))
        self._lost = set(lost)

    def report_left(self, now: float, origin: LocalFrame | None, mission: Mission | None, *, searching: bool) -> None:
        """Report a vehicle that stands on the ground before its launch, or that the search does not fly any more.

        After the search (not `searching`) a pilot may fly it. Once it has landed, it is not reported again.
        """
        vehicle, last = self._session.vehicle, self._session.navigation.track.last_position
        if vehicle is None or last is None or not (searching or vehicle.armed or self._flying):
            return
        origin = origin or last.frame
        state = self._session.navigation.state_at(now, origin)
        lost = state is None or state.age_s >= OLD_S
        place = (last.lat, last.lon, last.alt) if state is None else lla(origin, *as_position(state.position))
        self._report(now, place, origin, mission, flying=vehicle.armed, searching=searching, lost=lost)

    def _report(
        self,
        now: float,
        place: tuple[float, float, float],
        origin: LocalFrame,
        mission: Mission | None,
        *,
        flying: bool,
        searching: bool,
        lost: bool = False,
    ) -> None:
        self._flying = flying
        if mission is None:
            self._team.report(now, place, flying=flying, searching=searching, lost=lost)
            return
        target = mission.choice.target
        searching = searching and not mission.ended
        hunting = target if mission.choice.hunting and searching else None
        found = {victim.id for victim in mission.victims.places if victim.sure} - {NO_ID}
        if mission.found_surely and target is not None:  # not before the last check of its place
            found.add(target)
        heard = {id_: one for id_, one in mission.choice.heard.items() if id_ != NO_ID}
        self._team.report(
            now,
            place,
            flying=flying,
            hunting=hunting,
            hunting_m=math.inf if hunting is None else mission.choice.heard[hunting].nearest_m,
            found=tuple(found),
            heard=[HeardAt(id_, one.nearest_m, *lla(origin, *one.nearest_at, 0.0)[:2]) for id_, one in heard.items()],
            searching=searching,
            lost=lost,
        )


_ASIDE_S: Final = 6.0  # longer than the check needs
_WINDOW_S: Final = 5.0  # of an order that the vehicle has had time to follow
_LEAST: Final = 2.5  # m²/s, the sum of squared orders: a slower order needs a longer window
_OLDEST_S: Final = 30.0
_GAP_S: Final = 1.0  # between two observations: the check begins again
_ACCELERATION: Final = 1.0  # m/s², of the slowest vehicle to be expected
_SETTLED: Final = 0.5  # share of the order: the slowest vehicle deviates by less
_SLOW: Final = 0.2  # share of the order, and m/s: by its velocity, a slower vehicle does not follow
_DRIFT: Final = 0.5  # the same by its position, which drifts
_ASTRAY: Final = 0.5  # share of the order, and m/s: a vehicle that does not follow and is faster flies elsewhere


class Deviation(NamedTuple):
    """A vehicle that does not follow: what it was ordered to fly in the window [s, m], and what it flew [m].

    `off_deg`: the direction flown, to the right of the one ordered; None if the vehicle hardly moves.
    """

    seconds: float
    ordered_m: float
    flown_m: float
    off_deg: float | None


class _Sample(NamedTuple):
    """One step of the comparison of commanded and flown velocity.

    The fields are its end and length [s], the integral of the squared command [m²/s], and the integrals of the
    conjugate command times the motion: by the reported velocity, and by the position.
    """

    time_s: float
    seconds: float
    squared: float
    products: tuple[complex, complex]


class SetPointCheck:
    """Remembers the window, the last order, and the velocity of the slowest vehicle to be expected."""

    def __init__(self) -> None:
        self._window: deque[_Sample] = deque()
        self._last: tuple[float, complex, complex] | None = None  # time, order and place at the last observation
        self._slowest = 0j  # the velocity of a vehicle that accelerates by no more than `_ACCELERATION`

    def restart(self) -> None:
        """Forget everything: the vehicle was not steered, or the deviation was reported."""
        self._window.clear()
        self._last = None

    def observe(self, time_s: float, order: Position, position: Position, velocity: Position) -> Deviation | None:
        """Use the `order` sent now, and the position and velocity reported now.

        Returns the deviation if the vehicle does not follow.
        """
        place, moving = complex(*position[:2]), complex(*velocity[:2])
        last, self._last = self._last, (time_s, complex(*order[:2]), place)
        if last is None or time_s - last[0] > _GAP_S:
            self._window.clear()
            self._slowest = moving
            return None
        before_s, ordered, there = last
        seconds = time_s - before_s
        lag = ordered - self._slowest
        self._slowest += lag * min(1.0, _ACCELERATION * seconds / max(abs(lag), 1e-9))
        if abs(lag) <= _SETTLED * abs(ordered):
            along = ordered.conjugate()
            products = along * moving * seconds, along * (place - there)
            self._window.append(_Sample(time_s, seconds, abs(ordered) ** 2 * seconds, products))
        return self._judge(time_s)

    def _judge(self, time_s: float) -> Deviation | None:
        window = self._window
        while window and (time_s - window[0].time_s > _OLDEST_S or _is_enough(list(window)[1:])):
            window.popleft()
        if not _is_enough(window):
            return None
        seconds, squared = sum([sample.seconds for sample in window]), sum([sample.squared for sample in window])
        by_velocity, by_position = (sum([s.products[n] for s in window]) / squared for n in (0, 1))
        speed = math.sqrt(squared / seconds)
        scale = min(1.0, 1.0 / speed)
        if by_velocity.real >= _SLOW * scale or by_position.real >= _DRIFT * scale:
            return None
        astray = min(abs(by_velocity), abs(by_position)) > _ASTRAY * scale
        off_deg = math.degrees(cmath.phase(by_velocity)) if astray else None
        return Deviation(seconds, speed * seconds, abs(by_velocity) * speed * seconds, off_deg)


def _is_enough(window: Collection[_Sample]) -> bool:
    """Return True if a window is long enough, and the sum of its squared commands large enough."""
    long = sum([sample.seconds for sample in window]) >= _WINDOW_S - 1e-6
    return long and sum([sample.squared for sample in window]) >= _LEAST


class Detour:
    """Remembers the detour and its end."""

    def __init__(self, emit: Callable[[Event], None]) -> None:
        self._emit = emit
        self._check = SetPointCheck()
        self._aside: tuple[float, float] | None = None  # north, east, m/s
        self._until_s = -math.inf

    def restart(self) -> None:
        """Forget the motion so far: the vehicle was not steered."""
        self._check.restart()

    def around(self, time_s: float, wanted: Position) -> Position:
        """Return the velocity to order instead of the one `wanted` by the search."""
        if self._aside is None or time_s >= self._until_s or not any(wanted[:2]):
            return wanted
        return *self._aside, wanted[2]

    def observe(self, time_s: float, order: Position, position: Position, velocity: Position) -> Reason | None:
        """Use the `order` sent now, and the motion reported now. Return the reason to end the search, or None."""
        deviation = self._check.observe(time_s, order, position, velocity)
        if deviation is None:
            return None
        if deviation.off_deg is not None or self._aside:
            return because(Why.NOT_FOLLOWED, **deviation._asdict())
        self._emit(SetPointsNotFollowed(time_s, deviation.seconds, deviation.ordered_m, deviation.flown_m))
        self._check.restart()
        self._aside, self._until_s = _sideways(order, position), time_s + _ASIDE_S
        return None


def _sideways(order: Position, position: Position) -> tuple[float, float]:
    """Return the velocity perpendicular to the order, to the side of the take-off point."""
    north, east, _ = order
    side = 1.0 if east * position[0] - north * position[1] >= 0 else -1.0
    return -side * east, side * north


STAY: Final = (0.0, 0.0, 0.0)
_REPORT_S: Final = 0.1  # between frames that are reported


@dataclass(frozen=True)
class FlightSetup:
    """The parts of a flight, or of a dry run."""

    plan: SearchPlan
    session: Session
    ground: Ground
    start: float
    """Time from which the rows of the log count [s]."""
    emit: Callable[[Event], None]
    """Gets the events."""
    log: Callable[[SearchStep], None] | None = None
    """Gets a row for each step; None: none is made."""
    team: Teammate | None = None
    """The other searches."""
    host: ReceiverHost | None = None
    """Commands to the receiver."""
    worker: Worker | None = None
    """Computes; None: in this loop."""


class FlownPose(NamedTuple):
    """The pose of the vehicle and of its receiver at one step. Positions are NED metres from the take-off point."""

    state: VehicleState
    position: Position
    """Of the vehicle."""
    receiver: Position
    rotation: NDArray[np.float64]
    """Of the receiver, FRD → NED."""


class MissionRun:
    """A mission, flown or not: its frames with the receiver's pose, its take-off point, and a row for each step."""

    def __init__(self, setup: FlightSetup) -> None:
        self.mission: Mission | None = None
        self.origin: LocalFrame | None = None  # the take-off point
        self._setup = setup
        self._new_frame: Frame | None = None  # since the last row of the log
        self._report_s = -math.inf  # when a frame may be reported next
        self._skipped_s = 0.0  # in gaps, which do not count for the mission

    def on_frame(self, frame: Frame, pose: FlownPose | None, now: float) -> None:
        """Use a new frame."""
        self._new_frame = frame
        position = heading_deg = None
        if pose is not None:
            position, rotation = pose.receiver, pose.rotation
            heading_deg = math.degrees(math.atan2(rotation[1, 0], rotation[0, 0]))
            if self.mission is not None:
                self.mission.on_frame(frame, now - self._skipped_s, position, rotation)
        if now >= self._report_s:
            self._report_s = now + _REPORT_S
            self._setup.emit(FrameHeard(now, frame, position, heading_deg))

    def _begin_at(self, now: float, origin: LocalFrame) -> None:
        self.origin = origin
        self._setup.emit(TakeOffPoint(now, *lla(origin, 0.0, 0.0, 0.0)))

    def pose(self, now: float) -> FlownPose | None:
        """Return the pose for the flight, None if there is none that is new enough."""
        state = self._setup.session.navigation.state_at(now, self.origin) if self.origin else None
        if state is None or state.age_s >= OLD_S:
            return None
        receiver, rotation = self._setup.plan.mount.pose(state.position, state.attitude)
        return FlownPose(state, as_position(state.position), as_position(receiver), rotation)

    def _log_step(
        self, log: Callable[[SearchStep], None], now: float, phase: str, pose: FlownPose, velocity: Position
    ) -> None:
        frame, self._new_frame = self._new_frame, None
        reading: tuple[int | None, ...] = (None, None, None, None)
        if frame is not None:
            reading = reading_of(frame, self.mission.choice.target if self.mission else None)
        north_deg = math.degrees(heading(pose.state.attitude))
        log(SearchStep(now - self._setup.start, phase, *pose.position, north_deg, *velocity, *reading))


class Flight(MissionRun):
    """One flight from its take-off point on. `mission` begins at the end of the take-off."""

    def __init__(self, setup: FlightSetup, commander: Commander) -> None:
        super().__init__(setup)
        self.plan = setup.plan
        self._commander = commander
        self._team = setup.team
        self._report = TeamReport(setup.team, setup.session, setup.emit) if setup.team else None
        self._last_pose_s = setup.start
        self._down = 0.0  # the last command, m/s
        self._detour = Detour(setup.emit)
        self._accuracy = PositionAccuracy(setup.session)

    def on_packets(self, received: Received, now: float) -> None:
        """Use what the session received."""
        self._setup.ground.on_packets(received, now)
        self._accuracy.on_packets(received)
        if self.mission:
            self.mission.reports.accuracy = self._accuracy.worst

    def skip(self, now: float, seconds: float) -> None:
        """Skip a gap until now, in which the mission's clock did not run."""
        self._skipped_s += seconds
        self._last_pose_s += seconds
        self._commander.steer(STAY)
        self._detour.restart()
        if self._team:
            self._team.others.skip(now, seconds)

    def wait(self, now: float) -> bool:
        """Wait on the ground. Return True if the vehicle must stay there because another one is above it."""
        self._last_pose_s = now
        self.report_place(now, searching=True)
        return self._team is not None and self._team.under_another

    def fly(self, now: float, pose: FlownPose | None) -> None:
        """Fly one step."""
        if self.origin is None and (origin := self._commander.origin):
            self._begin_at(now, origin.frame)
            pose = self.pose(now)
        phase, velocity = self._commander.phase, STAY
        if not self._commander.authority.settled:
            return
        if pose is None:
            self._fly_blind(now)
            return
        self._last_pose_s = now
        if self._report is not None and self.origin is not None:
            place, searching = lla(self.origin, *pose.position), phase in (Phase.CLIMBING, Phase.FLYING)
            self._report.report_flown(now, place, self.origin, self.mission, searching=searching)
        if phase is Phase.FLYING:
            velocity = self._steer(now, pose, self.mission or self._begin(now, pose.position))
        if log := self._setup.log:
            self._log_step(log, now, phase.name.lower(), pose, velocity)

    def _begin(self, now: float, position: Position) -> Mission:
        setup = self._setup
        plan = self._team.plan(setup.plan, self.origin) if self._team and self.origin else setup.plan
        self.mission = Mission(
            plan,
            now - self._skipped_s,
            position,
            emit=self._emit_in_time,
            team=self._team,
            host=setup.host,
            worker=setup.worker,
        )
        about = plan.area, plan.strip_width, plan.limit_s
        setup.emit(SearchBegun(now, -position[2], plan.victims, *about))
        return self.mission

    def _steer(self, now: float, pose: FlownPose, mission: Mission) -> Position:
        """Order the velocity of the mission, and end it. Returns the velocity."""
        plan, position, authority = self._setup.plan, pose.position, self._commander.authority
        late = authority.late(now)
        followed = authority.in_mode and not late
        height = self._setup.ground.height(now, pose.state, self._down if followed else 0.0)
        velocity = mission.fly(now - self._skipped_s, position, receiver=pose.receiver, height=height)
        if mission.ended or not followed:
            self._detour.restart()
        else:
            velocity = self._detour.around(now, velocity)
        if self._team:
            velocity = self._team.apart(position, velocity, plan.speed * mission.pace)
        if late:
            velocity = STAY
        self._commander.steer(velocity)
        self._down = velocity[2]
        if why := self._detour.observe(now, velocity, position, as_position(pose.state.velocity)):
            self._commander.land(now, why)
        if mission.ended and mission.over:
            lands = height.landed or (plan.land and not mission.blocked)
            self._setup.emit(SearchEnded(now, (mission.ended,), lands))
            blocked = [because(Why.BLOCKED_BELOW)] if mission.blocked else []
            (self._commander.land if lands else self._commander.hold)(now, *blocked)
        return velocity

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
        self._down = 0.0
        patience_s = self._setup.plan.patience_s
        if now - self._last_pose_s > patience_s:
            lacking = self._setup.session.why_no_pose()
            self._commander.land(now, because(Why.POSE_LOST, seconds=patience_s, lacking=lacking))

    def _emit_in_time(self, event: Event) -> None:
        """Emit an event of the mission, whose clock does not run in gaps."""
        self._setup.emit(replace(event, time_s=event.time_s + self._skipped_s))


def reading_of(frame: Frame, target: int | None) -> tuple[int | None, int, int, int]:
    """Return id, d, δ and zone of the transmitter searched for, otherwise of the first channel."""
    channel = next((c for c in frame.channels if c.valid and c.id == target), frame.channels[0])
    return channel.id, channel.d, channel.delta, channel.zone
