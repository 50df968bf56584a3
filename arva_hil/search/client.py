"""The search as a program on an onboard computer: frames from one link, an autopilot on the other, one flight.

It never sees a scenario: what it knows is what was read from its two links.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from arva_hil.autopilot.commander import Commander, Phase
from arva_hil.autopilot.mavlink import dialect
from arva_hil.autopilot.pose import VehicleState
from arva_hil.autopilot.session import Session
from arva_hil.clock import Clock
from arva_hil.links import Link, LinkError
from arva_hil.model.geodesy import LocalFrame
from arva_hil.model.rotation import to_euler, to_matrix
from arva_hil.notice import Level, Notice
from arva_hil.search.mission import FOUND, Mission, Plan
from arva_hil.search.outcome import Kind, Outcome, Row
from arva_hil.search.receiver import Receiver
from arva_hil.search.strategy import Position
from arva_hil.watched import Watched
from firmware_proto import Frame, FrameDecoder

COMPONENT: Final = dialect.MAV_COMP_ID_ONBOARD_COMPUTER3  # the emulator is the first, a listener the second

_HEARTBEAT: Final = dialect.MAVLINK_MSG_ID_HEARTBEAT
_STEP_S: Final = 0.2
_OLD_S: Final = 1.0  # a pose older than this is none to fly by

INTERRUPTED: Final = "interrupted"
STAY: Final = (0.0, 0.0, 0.0)


class SearchClient:
    """Remembers how far one search is: waiting for vehicle and frames, flying, over. A task for the loop.

    The receiver's link may be lost and come back at any time, the autopilot's until it is `launched`. From then on it
    should raise when it is lost: who knows who had the vehicle meanwhile.
    `land`: at the end it lands, else it hovers. `timeout_s`: for a heartbeat and a frame, before anything is flown.
    `log` gets five rows a second. `outcome` is None until all is over, the vehicle landed or left hovering.
    """

    def __init__(
        self,
        plan: Plan,
        session: Session,
        autopilot: Link,
        receiver: Link,
        decoder: FrameDecoder,
        *,
        start: float,
        land: bool = True,
        timeout_s: float = 30.0,
        arm_timeout_s: float = 60.0,
        say: Callable[[Notice], None] = lambda _: None,
        log: Callable[[Row], None] = lambda _: None,
    ) -> None:
        self.outcome: Outcome | None = None
        self.mission: Mission | None = None
        self.origin: LocalFrame | None = None  # the take-off point
        self._plan = plan
        self._session = session
        self._autopilot = autopilot
        self._watched = Watched(autopilot)
        self._receiver = Receiver(receiver, decoder)
        self._commander = Commander(session, take_off_m=plan.take_off, arm_timeout_s=arm_timeout_s)
        self._land = land
        self._start = start
        self._waiting_since = start
        self._timeout_s = timeout_s
        self._say = say
        self._log = log
        self._next_step = start
        self._waits_for = ""
        self._new_frame: Frame | None = None  # since the last row of the log
        self._last_pose_s = start
        self._greeted = False  # a heartbeat came since the autopilot's link was opened
        self._reboots = 0
        self._stopping = False

    @property
    def links(self) -> Sequence[Link]:
        return [self._autopilot, *self._receiver.links]

    @property
    def launched(self) -> bool:
        """The vehicle was told to arm, or never will be."""
        return self._commander.phase is not Phase.IDLE

    def stop(self) -> None:
        """Break it off: what flies is left hovering."""
        if not self._stopping and self.launched:
            self._tell("info", "interrupted: what flies is left hovering")
        self._stopping = True

    def service(self, clock: Clock) -> float:
        """Take what came, fly on; the next time to call."""
        try:
            chunk = self._autopilot.read()
            now = clock.now()
            if not self.launched:
                self._watch_link(now)
            if chunk:
                self._hear(chunk, now)
            for frame in self._receiver.read(now):
                self._on_frame(frame, now)
            return self._act(now)
        except LinkError as error:  # the autopilot's
            self._cut_off(str(error))
            return math.inf

    def _hear(self, chunk: bytes, now: float) -> None:
        self._session.feed(chunk, now)
        self._greeted = self._greeted or any(packet.msgid == _HEARTBEAT for packet in self._session.own)
        self._commander.hear(now)

    def _act(self, now: float) -> float:
        self._pass_on()
        if now >= self._next_step:
            self._next_step = max(self._next_step + _STEP_S, now)
            self._step(now)
        if out := self._session.poll(now) + self._commander.poll(now):
            self._autopilot.write(out)
        self._pass_on()
        return self._next_step

    def _pass_on(self) -> None:
        for source in (self._session, self._commander, self._receiver, self.mission):
            for notice in source.take_notices() if source else ():
                self._say(notice)

    def _on_frame(self, frame: Frame, now: float) -> None:
        self._new_frame = frame
        if self.mission is not None and (state := self._state(now)) is not None:
            self.mission.hear(frame, now, _position(state), to_matrix(state.attitude))

    def _step(self, now: float) -> None:
        phase = self._commander.phase
        if self.outcome is not None:
            return
        if phase is Phase.IDLE:
            self._wait(now)
        elif self._session.navigation.reboots > self._reboots:
            self._cut_off("the autopilot has rebooted")
        elif self._session.lost:
            self._cut_off("the autopilot is not heard any more")
        elif phase is Phase.LOST:
            found = self.mission is not None and self.mission.found is not None
            self._finish("found" if found else "failed", self._commander.why)
        elif phase is Phase.ENDED:
            self._conclude()
        elif self._stopping:
            self._commander.hold(now)
        else:
            self._fly(phase, now)

    # -- on the ground -------------------------------------------------------------------------------------

    def _wait(self, now: float) -> None:
        """Nothing is armed before there are a vehicle with a pose and a receiver that sends."""
        session, waited = self._session, now - self._waiting_since
        if self._stopping:
            self._finish("failed", INTERRUPTED)
        elif self._autopilot.away:
            self._lack("the autopilot's link", "no link", lambda: self._autopilot.why, waited)
        elif session.vehicle is None or not self._greeted:
            self._lack("an autopilot", "no link", lambda: f"no autopilot: {session.heard()}", waited)
        elif session.vehicle.armed:
            self._finish("failed", "the vehicle is armed already: a search starts on the ground, disarmed")
        elif self._receiver.silent(now):
            self._lack("a frame from the receiver", "no link", lambda: self._receiver.why_silent(now), waited)
        elif not self._has_pose(now):
            self._lack("a pose", "failed", lambda: f"no pose: {session.why_no_pose()}", waited / 2)
        else:
            self._reboots = session.navigation.reboots
            try:
                self._commander.launch(now)
                self._tell("info", f"arming {session.vehicle}")
            except ValueError as error:
                self._finish("failed", str(error))

    def _watch_link(self, now: float) -> None:
        """A link that comes back is a new one, to a vehicle that may have rebooted."""
        link = self._watched
        if link.lost_again:
            self._session.interrupt(link.link.why)
            self._waiting_since = now
            self._greeted = False
        if link.renewed_again:
            self._session.resume(now)
        for notice in link.news(now):
            self._say(notice)

    def _lack(self, what: str, kind: Kind, why: Callable[[], str], waited: float) -> None:
        if what != self._waits_for:
            self._waits_for = what
            self._tell("info", f"waiting for {what}")
        if waited > self._timeout_s:
            self._finish(kind, why())

    def _has_pose(self, now: float) -> bool:
        place = self._session.track.last_position
        state = self._session.state_at(now, place.frame) if place else None
        return state is not None and state.age_s < _OLD_S and not self._session.lost

    # -- in the air ----------------------------------------------------------------------------------------

    def _fly(self, phase: Phase, now: float) -> None:
        if phase is Phase.ARMING:
            self._last_pose_s = now
            if self._receiver.silent(now):
                self._commander.land(now, self._receiver.why_silent(now))
            return
        if self.origin is None and (origin := self._commander.origin):
            self.origin = origin.frame
        state, velocity = self._state(now), STAY
        if state is None:
            self._fly_blind(now)
            return
        self._last_pose_s = now
        position = _position(state)
        if phase is Phase.FLYING:
            if self.mission is None:
                self.mission = Mission(self._plan, now, position)
                self._tell("info", f"{-position[2]:.1f} m high: the search begins")
            velocity = self.mission.fly(now, position)
            self._commander.steer(velocity)
            if self.mission.ended:
                self._over(self.mission, now)
        self._note(now, phase, state, velocity)

    def _fly_blind(self, now: float) -> None:
        """Without a pose that is new it hovers, then lands."""
        self._commander.steer(STAY)
        if now - self._last_pose_s > self._plan.patience_s:
            self._commander.land(now, f"no pose for {self._plan.patience_s:g} s: {self._session.why_no_pose()}")

    def _over(self, mission: Mission, now: float) -> None:
        """The search has ended; the flight has not."""
        self._tell("info", f"{mission.ended}; {'landing' if self._land else 'hovering'}")
        if self._land:
            self._commander.land(now)
        else:
            self._commander.hold(now)

    # -- the end -------------------------------------------------------------------------------------------

    def _conclude(self) -> None:
        mission = self.mission
        if self._stopping:
            self._finish("failed", INTERRUPTED)
        elif self._commander.why or mission is None:
            self._finish("failed", self._commander.why)
        elif mission.found is not None:
            self._finish("found", FOUND)
        else:
            self._finish("failed" if mission.broken else "not found", mission.ended)

    def _cut_off(self, why: str) -> None:
        if self._commander.phase is Phase.IDLE:
            self._finish("failed" if self._session.vehicle else "no link", why)
        else:
            self._finish("failed", f"{why}; the vehicle is left to its own failsafe")

    def _finish(self, kind: Kind, how: str) -> None:
        mission = self.mission
        self._commander.let_go()
        if self.outcome is not None:
            return
        if mission is None:
            self.outcome = Outcome(kind, how)
            return
        found, lat_lon = mission.found, None
        if found is not None and self.origin is not None:
            lat, lon, _ = self.origin.lla([found.north, found.east, found.down or 0.0])
            lat_lon = float(lat), float(lon)
        others = tuple(mission.others.items())
        self.outcome = Outcome(
            kind, how, mission.target, found, lat_lon, mission.searched_s, mission.path_m, mission.frames, others
        )

    def _state(self, now: float) -> VehicleState | None:
        """The pose to fly by, None when there is none that is new enough."""
        state = self._session.state_at(now, self.origin) if self.origin else None
        return state if state is not None and state.age_s < _OLD_S else None

    def _note(self, now: float, phase: Phase, state: VehicleState, velocity: Position) -> None:
        reading: tuple[int | None, ...] = (None, None, None)
        if self._new_frame is not None:
            reading = _reading(self._new_frame, self.mission.target if self.mission else None)
            self._new_frame = None
        heading = math.degrees(to_euler(to_matrix(state.attitude))[2])
        self._log(Row(now - self._start, phase.name.lower(), *_position(state), heading, *velocity, *reading))

    def _tell(self, level: Level, text: str) -> None:
        self._say(Notice(level, text))


def _reading(frame: Frame, target: int | None) -> tuple[int | None, int, int]:
    """Id, d and δ of the transmitter searched for, else of the first channel."""
    channel = next((c for c in frame.channels if c.valid and c.id == target), frame.channels[0])
    return channel.id, channel.d, channel.delta


def _position(state: VehicleState) -> Position:
    north, east, down = state.position.tolist()
    return north, east, down
