"""The search as a program on an onboard computer: frames from one link, an autopilot on the other, one flight.

It has no scenario, only the bytes of its two links.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from arva_hil.autopilot.commanding.commander import Commander, Phase
from arva_hil.autopilot.commanding.vehicle_checks import quality_channel
from arva_hil.autopilot.following.session import Session
from arva_hil.clock import Clock
from arva_hil.events import Event, PacketsReceived
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.events.searches import Launched, OwnMarkHeard, SearchHeldUp, SearchInterrupted
from arva_hil.links import Link, LinkError, Sender
from arva_hil.mavlink.codec import dialect
from arva_hil.model.field.geodesy import LocalFrame
from arva_hil.search.flight.airborne import Flight, FlightSetup, FlownPose
from arva_hil.search.flight.dry_run import DryRun
from arva_hil.search.flight.links import AutopilotLink, OtherSearches, ReceiverLink
from arva_hil.search.flight.preflight import Permission, Preflight
from arva_hil.search.mission.ground import Ground
from arva_hil.search.mission.mission import Mission
from arva_hil.search.mission.outcome import Kind, Outcome, Refusal, SearchStep, conclusion, kind_of, outcome_of
from arva_hil.search.strategies.analysis import Worker
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.team.team import Teammate
from arva_hil.search.team.team_tunnel import TeamTunnel
from firmware_proto import FrameDecoder, HostForm

COMPONENT: Final = dialect.MAV_COMP_ID_ONBOARD_COMPUTER3  # the emulator is computer 1, a listener computer 2

_MARK: Final = dialect.MAVLINK_MSG_ID_ADSB_VEHICLE
_STEP_S: Final = 0.2


class EventQueue(list[Event]):
    """The events that `emit` has not got yet."""

    def __init__(self, emit: Callable[[Event], None]) -> None:
        super().__init__()
        self._emit = emit

    def pass_on(self) -> None:
        """Emit them."""
        events = self[:]
        self.clear()
        for event in events:
            self._emit(event)


class SearchClient:
    """One search: it waits for a vehicle and frames, flies, and ends. A task for the loop.

    The receiver's link may be lost and come back at any time, the autopilot's only until the vehicle is `launched`.
    After that a loss must raise an error, because another person may control the vehicle meanwhile.

    `permission`: to arm this vehicle; None if all vehicles are simulated. `emit` gets the events, `log` five rows a
    second. `team`: the other searches, if there are several; `tunnel`: to them, if they are other programs. `host`: the
    form of commands to the receiver, if it takes any. `worker`: computes; None: in this loop. `tell_packets`: emit the
    vehicle's packets too.
    `outcome`: None until the end, when the vehicle has landed or is left hovering.
    """

    def __init__(
        self,
        plan: SearchPlan,
        session: Session,
        autopilot: Link,
        receiver: Link,
        decoder: FrameDecoder,
        *,
        start: float,
        permission: Permission | None = None,
        emit: Callable[[Event], None] = lambda _: None,
        log: Callable[[SearchStep], None] | None = None,
        team: Teammate | None = None,
        tunnel: TeamTunnel | None = None,
        host: HostForm | None = None,
        worker: Worker | None = None,
        tell_packets: bool = False,
    ) -> None:
        self.outcome: Outcome | None = None
        self._session = session
        self._events = EventQueue(emit)
        emit_later = self._events.append
        others = OtherSearches(COMPONENT, team, tunnel)
        self._line = AutopilotLink(autopilot, others, start, on_bytes=self._on_bytes, on_gap=self._on_gap)
        self._receiver = ReceiverLink(receiver, decoder, emit_later, host)
        self._commander = Commander(session, emit_later, take_off_m=plan.take_off, arm_timeout_s=plan.arm_timeout_s)
        ground = Ground(session, plan, emit_later)
        needed = autopilot, self._receiver, self._commander, permission, ground
        self._preflight = Preflight(plan, session, *needed, start=start, emit=emit_later)
        setup = FlightSetup(plan, session, ground, start, emit_later, log, team, self._receiver.host, worker)
        self._flight = Flight(setup, self._commander)
        self._dry_run = DryRun(setup) if plan.dry_run else None
        self._next_step = start
        self._stopping = False
        self._tell_packets = tell_packets

    @property
    def links(self) -> Sequence[Link]:
        return [self._line.link, *self._receiver.links]

    @property
    def mission(self) -> Mission | None:
        """The mission, from the end of the take-off on."""
        return self._flight.mission

    @property
    def origin(self) -> LocalFrame | None:
        """The take-off point."""
        return self._flight.origin

    @property
    def launched(self) -> bool:
        """True if the vehicle was ordered to arm, or never will be."""
        return self._commander.phase is not Phase.IDLE

    def stop(self) -> None:
        """Stop: a flying vehicle is left hovering, a landing one goes on landing, one on the ground is disarmed."""
        if not self._stopping and self.launched:
            self._events.append(SearchInterrupted(self._line.empty_s, self._commander.phase.name.lower()))
            self._events.pass_on()
        self._stopping = True

    def service(self, clock: Clock) -> float:
        """Read both links and fly. Returns the next time to call."""
        try:
            self._line.take_in(clock)
            now = clock.now()
            if not self.launched:
                self._preflight.watch_link(now)
            frames, run = self._receiver.read(now), self._dry_run or self._flight
            pose = run.pose(now) if frames or now >= self._next_step else None
            for frame in frames:
                run.on_frame(frame, pose, now)
            if now >= self._next_step:
                self._next_step = max(self._next_step + _STEP_S, now)
                self._step(now, pose)
            return min(self._next_step, self._line.speak(clock, self._due, self._commander.sent))
        except LinkError as error:  # of the autopilot's link
            self._cut_off(because(Why.ERROR, text=str(error)))
            return math.inf
        finally:
            self._events.pass_on()

    def _on_bytes(self, sender: Sender, chunk: bytes, now: float, since: float) -> None:
        if not self.launched:
            self._preflight.watch_link(now)
        received = self._session.feed(chunk, now, sender)
        self._events += received.events
        if self._tell_packets:
            self._events.append(PacketsReceived(now, self._session.name, received.own))
        vehicle = self._session.vehicle
        for packet in (*received.others, *received.refused):
            if (packet.msgid, packet.component) == (_MARK, COMPONENT) and vehicle and packet.system == vehicle.system:
                self._events.append(OwnMarkHeard(now))
        self._line.others.on_packets(received, vehicle, now)
        if not self.launched:
            self._preflight.on_packets(received)
        self._commander.on_packets(received, now, since)
        self._flight.on_packets(received, now)
        senders = self._session.senders
        self._line.link.follow(senders.vehicle, senders.candidates)

    def _on_gap(self, now: float, gap_s: float) -> None:
        """Handle a gap without reading: all that is known is stale."""
        self._session.skip(now)
        self._commander.authority.doubt(now)
        self._flight.skip(now, gap_s)
        self._receiver.skip(now)
        if self.launched:
            self._events.append(SearchHeldUp(now, gap_s))
        else:
            self._preflight.restart()

    def _due(self, now: float) -> tuple[bytes, bytes]:
        """Return the bytes to send: those without and those with orders."""
        launched = self.launched
        claims = not self._dry_run and self.outcome is None and self._session.reachable
        told = self._line.others.poll(now, self._session.navigation.clock if claims else None, launched=launched)
        packed = b"".join(map(self._session.encoder.pack, told))
        requests, events = self._session.poll(now)
        self._events += events
        questions = b"" if launched else self._preflight.poll(now)
        return requests + questions + packed, self._commander.poll(now)

    def _step(self, now: float, pose: FlownPose | None) -> None:
        phase = self._commander.phase
        if self.outcome is not None:
            self._flight.report_place(now, searching=False)
            return
        if first := self._line.others.first:
            self._finish("failed", because(Why.OTHER_SEARCH, name=first.name, flies=self.launched))
        elif phase is Phase.IDLE:
            self._wait(now)
        elif self._session.usurped:
            self._cut_off(self._session.usurped)
        elif self._session.lost:
            self._cut_off(because(Why.AUTOPILOT_SILENT))
        elif phase is Phase.LOST:
            self._conclude_lost()
        elif phase is Phase.ENDED:
            self._conclude(now)
        elif self._stopping and phase not in (Phase.LANDING, Phase.HOLDING, Phase.YIELDING):
            self._commander.hold(now)
        elif phase is Phase.ARMING:
            no_frames = because(Why.NO_FRAMES_YET) if self._receiver.silent(now) else None
            lacking = no_frames or self._preflight.why_no_pose(now)
            self._commander.held_back = because(Why.UNDER_ANOTHER) if self._flight.wait(now) else lacking
            if self._receiver.silent(now, self._flight.plan.patience_s):
                self._commander.land(now, self._receiver.why_silent(now))
        else:
            self._flight.fly(now, pose)

    def _wait(self, now: float) -> None:
        if self._dry_run is None:
            self._flight.report_place(now, searching=True)
        if self._stopping:
            self._finish("failed", because(Why.INTERRUPTED))
            return
        verdict = self._preflight.check(now)
        if verdict is True and self._dry_run:
            verdict = self._dry_run.step(now, self._commander.authority.mode) or False
        if verdict is True and self._line.others.is_settled(now):
            self._launch(now)
        elif isinstance(verdict, Refusal):
            self._finish(verdict.kind, verdict.how)

    def _launch(self, now: float) -> None:
        try:
            (self._commander.take_over if self._flight.plan.take_over else self._commander.launch)(now)
        except ValueError as error:
            self._finish("failed", because(Why.ERROR, text=str(error)))
            return
        self._session.pin()
        self._line.pin()
        sticks, values = self._commander.sticks, self._preflight.failsafes.values
        sticks.throttle = int(values.get("RCMAP_THROTTLE", sticks.throttle))
        sticks.quality = quality_channel(values)
        sticks.lost_us = values.get("FS_THR_VALUE", sticks.lost_us) if values.get("FS_THR_ENABLE", 1) else 0.0
        self._events.append(Launched(now, str(self._session.vehicle), self._flight.plan.take_over))

    def _conclude(self, now: float) -> None:
        mission = self.mission
        if self._stopping:
            self._finish("failed", because(Why.INTERRUPTED))
        elif self._commander.why or mission is None:
            self._finish("failed", *self._commander.why)
        else:
            self._flight.confirm(now)
            self._finish(*conclusion(mission))

    def _conclude_lost(self) -> None:
        """End after a loss of control. If the pilot does not control the vehicle either, the search has failed."""
        commander = self._commander
        assert self._session.vehicle is not None
        if commander.handed_over:
            self._finish(kind_of(self.mission), *commander.why)
        elif not self._session.vehicle.armed:
            self._finish("failed", *commander.why)
        elif commander.lands_by_itself:
            self._finish("failed", because(Why.STILL_ARMED, because=commander.why))
        else:
            self._cut_off(*commander.why)

    def _cut_off(self, *why: Reason) -> None:
        if self._commander.phase is Phase.IDLE:
            self._finish("failed" if self._session.vehicle else "no link", *why)
        elif self._commander.lands_by_itself:
            self._finish("failed", *why, because(Why.GOES_ON_LANDING))
        else:
            failsafes, remote = self._preflight.failsafes, self._commander.sticks.remote
            alone = because(Why.LEFT_ALONE, parameters=dict(failsafes.values), px4=failsafes.px4, remote=remote)
            self._finish("failed", *why, alone)

    def _finish(self, kind: Kind, *how: Reason) -> None:
        mission, origin = self.mission, self.origin
        self._commander.let_go()
        if self.outcome is not None:
            return
        self._flight.report_place(self._line.empty_s, searching=False)
        self.outcome = outcome_of(mission, origin, kind, how) if mission and origin else Outcome(kind, how)
