"""The search as a program on an onboard computer: frames from one link, an autopilot on the other, one flight.

It never sees a scenario: what it knows is what was read from its two links.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from arva_hil.autopilot.commander import Commander, Phase
from arva_hil.autopilot.mavlink import dialect
from arva_hil.autopilot.session import Session
from arva_hil.clock import Clock
from arva_hil.links import Link, LinkError, Sender
from arva_hil.model.geodesy import LocalFrame
from arva_hil.notice import Level, Notice
from arva_hil.search.flight import Flight
from arva_hil.search.ground import Ground
from arva_hil.search.mission import FOUND, NOT_SURE, Mission, Plan
from arva_hil.search.outcome import Kind, Outcome, Row
from arva_hil.search.permission import Permission
from arva_hil.search.preflight import INTERRUPTED, Preflight
from arva_hil.search.receiver import Receiver
from firmware_proto import FrameDecoder

COMPONENT: Final = dialect.MAV_COMP_ID_ONBOARD_COMPUTER3  # the emulator is the first, a listener the second

_STEP_S: Final = 0.2


class SearchClient:
    """Remembers how far one search is: waiting for vehicle and frames, flying, over. A task for the loop.

    The receiver's link may be lost and come back at any time, the autopilot's until it is `launched`. From then on it
    should raise when it is lost: who knows who had the vehicle meanwhile.
    `land`: at the end it lands, else it hovers. `timeout_s`: from `start` until there is all that a flight needs.
    `permission`: to arm this vehicle; None where any may be armed, because all there can be are simulated.
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
        timeout_s: float = 60.0,
        arm_timeout_s: float = 60.0,
        permission: Permission | None = None,
        say: Callable[[Notice], None] = lambda _: None,
        log: Callable[[Row], None] = lambda _: None,
    ) -> None:
        self.outcome: Outcome | None = None
        self._session = session
        self._autopilot = autopilot
        self._receiver = Receiver(receiver, decoder)
        self._commander = Commander(session, take_off_m=plan.take_off, arm_timeout_s=arm_timeout_s)
        self._preflight = Preflight(
            session, autopilot, self._receiver, start=start, timeout_s=timeout_s, permission=permission, say=say
        )
        self._ground = Ground(session)
        self._flight = Flight(plan, session, self._commander, self._ground, start=start, land=land, say=say, log=log)
        self._say = say
        self._next_step = start
        self._reboots = 0
        self._stopping = False

    @property
    def links(self) -> Sequence[Link]:
        return [self._autopilot, *self._receiver.links]

    @property
    def mission(self) -> Mission | None:
        """What is flown, from the end of the take-off on."""
        return self._flight.mission

    @property
    def origin(self) -> LocalFrame | None:
        """The take-off point."""
        return self._flight.origin

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
            came = self._autopilot.receive()
            now = clock.now()
            if not self.launched:
                self._preflight.watch_link(now)
            for sender, chunk in came:
                self._hear(chunk, now, sender)
            senders = self._session.senders
            self._autopilot.follow(senders.vehicle, senders.candidates)
            for frame in self._receiver.read(now):
                self._flight.hear(frame, now)
            return self._act(now)
        except LinkError as error:  # the autopilot's
            self._cut_off(str(error))
            return math.inf

    def _hear(self, chunk: bytes, now: float, sender: Sender) -> None:
        self._session.feed(chunk, now, sender)
        self._preflight.hear(self._session.own)
        self._commander.hear(now)
        self._ground.hear(now)

    def _act(self, now: float) -> float:
        self._pass_on()
        if now >= self._next_step:
            self._next_step = max(self._next_step + _STEP_S, now)
            self._step(now)
        if out := self._session.poll(now) + self._preflight.poll(now) + self._commander.poll(now):
            self._autopilot.write(out)
        self._pass_on()
        return self._next_step

    def _pass_on(self) -> None:
        for source in (self._session, self._commander, self._ground, self._receiver, self.mission):
            for notice in source.take_notices() if source else ():
                self._say(notice)

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
            found = self.mission is not None and self.mission.found is not None and self.mission.sure
            self._finish("found" if found else "failed", self._commander.why)
        elif phase is Phase.ENDED:
            self._conclude()
        elif self._stopping:
            self._commander.hold(now)
        elif phase is Phase.ARMING:
            self._flight.wait(now)
            if self._receiver.silent(now):
                self._commander.land(now, self._receiver.why_silent(now))
        else:
            self._flight.fly(now)

    def _wait(self, now: float) -> None:
        if self._stopping:
            self._finish("failed", INTERRUPTED)
            return
        verdict = self._preflight.look(now)
        if verdict is True:
            self._launch(now)
        elif verdict:
            self._finish(*verdict)

    def _launch(self, now: float) -> None:
        self._reboots = self._session.navigation.reboots
        try:
            self._commander.launch(now)
            self._tell("info", f"arming {self._session.vehicle}")
        except ValueError as error:
            self._finish("failed", str(error))

    # -- the end -------------------------------------------------------------------------------------------

    def _conclude(self) -> None:
        mission = self.mission
        if self._stopping:
            self._finish("failed", INTERRUPTED)
        elif self._commander.why or mission is None:
            self._finish("failed", self._commander.why)
        elif mission.found is not None:
            self._finish("found" if mission.sure else "not sure", FOUND if mission.sure else NOT_SURE)
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

    def _tell(self, level: Level, text: str) -> None:
        self._say(Notice(level, text))
