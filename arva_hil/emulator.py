"""The one loop that owns time: state at t, reading, frame, port."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from arva_hil.autopilot.pose import VehicleState
from arva_hil.autopilot.session import Session
from arva_hil.clock import Clock
from arva_hil.datum import Datum
from arva_hil.faults.plan import Faults
from arva_hil.faults.sending import Letter
from arva_hil.links import Link, Sender
from arva_hil.model import LocalFrame, Reading
from arva_hil.notice import Level, Notice
from arva_hil.observer import Observer, Pose, Snapshot, Status
from arva_hil.output import Port, frame_of
from arva_hil.scenario import Scenario
from arva_hil.scene import receiver, transmitters
from firmware_proto import Frame

_STATUS_S: Final = 0.25
_LOOK_AHEAD_S: Final = 1.0  # how far a log is read past a frame's instant, to interpolate
_BLIND_S: Final = 8.0  # with a vehicle but without a pose, before that is worth a line
_WORST_BACKLOG_S: Final = 1.0  # behind by more than this, frames are skipped instead of sent in a burst


class NoHeartbeatError(Exception):
    """No autopilot was heard in time; `str()` says what was heard instead."""


class Schedule:
    """Absolute deadlines: n / rate after `start`, each up to `jitter` late. Lateness never adds up."""

    def __init__(self, start: float, rate_hz: float, jitter_s: float, seed: int) -> None:
        self.number = 0
        self._start = start
        self._rate = rate_hz
        self._jitter = jitter_s
        self._random = random.Random(seed)
        self.deadline = self._at(0)

    def advance(self) -> None:
        self.number += 1
        self.deadline = self._at(self.number)

    def _at(self, number: int) -> float:
        late = self._jitter * self._random.random() if self._jitter else 0.0
        return self._start + number / self._rate + late


@dataclass
class Counters:
    """What became of every frame: frames + duplicated = delivered + damaged + withheld + dropped + waiting."""

    frames: int = 0
    duplicated: int = 0  # copies that a fault added
    delivered: int = 0  # gone, whole
    damaged: int = 0  # gone, but not as it was made
    withheld: int = 0  # kept from going by a fault
    dropped: int = 0  # nobody took it
    waiting: int = 0  # held up by a fault, not gone yet
    no_pose: int = 0  # said no signal because the pose was unknown or too old
    skipped: int = 0  # not made because the loop was held up for more than a second
    latest_s: float = 0.0  # the worst lateness


class Emulator:
    """A receiver on one vehicle: remembers its schedule, its datum, and what it has said to whom.

    It does no waiting. `service` does what is due and returns when it wants to be called again; any number of
    emulators can be serviced by one `run`. Times are seconds of the caller's clock.
    """

    def __init__(
        self,
        scenario: Scenario,
        session: Session,
        link: Link | None,
        port: Port,
        *,
        start: float,
        timeout_s: float = math.inf,
        max_age_s: float = 2.0,
        observers: Sequence[Observer] = (),
    ) -> None:
        self.session = session
        self.datum = Datum(scenario, start)
        self.counters = Counters()
        self.schedule = Schedule(start, scenario.receiver.rate_hz, scenario.receiver.jitter_s, scenario.seed)
        self.links: Sequence[Link] = [link] if link else []
        self._link = link
        self._port = port
        self._scenario = scenario
        self._faults = Faults(scenario) if scenario.faults else None
        self._receiver = self._faults.receiver if self._faults else receiver(scenario)
        self._observers = observers
        self._packet_observers = [o for o in observers if type(o).packets is not Observer.packets]
        self._wire_observers = [o for o in observers if type(o).wire is not Observer.wire]
        self._start = start
        self._timeout_s = timeout_s
        self._max_age_s = max_age_s
        self._next_status = start
        self._last: Snapshot | None = None
        self._had_pose = False
        self._blind_since: float | None = None
        self._dropping = False
        if self.datum.frame:
            self._place(self.datum.frame)

    def service(self, clock: Clock) -> float:
        """Send the frames that are due, take what came, send what the session wants; the next time to call.

        The time of what came is read after it: a stamp too late makes a pose older, one too early makes it one
        from the future.
        """
        while (now := clock.now()) >= self.schedule.deadline:
            self.emit(self.schedule.deadline, now)
        self.release(now)
        if self._link:
            if came := self._link.receive():
                now = clock.now()
            for sender, chunk in came:
                self.hear(chunk, now, sender)
            senders = self.session.senders
            self._link.follow(senders.vehicle, senders.candidates)
        self.tend(now)
        if self.session.vehicle is None and now - self._start > self._timeout_s:
            raise NoHeartbeatError(self.session.heard())
        return min(self.schedule.deadline, self.next_release, self.session.next_due, self._next_status)

    def hear(self, chunk: bytes, now: float, sender: Sender = None, *, whole: bool = False) -> None:
        """Bytes of the autopilot, received at `now`. `sender`: see `Link.receive`. `whole`: no packet goes on later."""
        packets = self.session.feed(chunk, now, sender, whole=whole)
        for observer in self._packet_observers:
            observer.packets(now, packets)
        if self.datum.update(self.session, now):
            assert self.datum.frame is not None
            self._place(self.datum.frame)
            self._say("info", f"datum: {self.datum.changes[-1]}")

    def tend(self, now: float) -> None:
        """Answer the autopilot, and tell those who watch."""
        if (out := self.session.poll(now)) and self._link:
            self._link.write(out)
        for notice in self.session.take_notices():
            self._say(*notice)
        if now >= self._next_status:
            self._next_status = now + _STATUS_S
            self._report(now)

    def emit(self, t: float, now: float) -> None:
        """Make the frame whose instant is `t` and send it; `now` is when that is done."""
        number, time_s = self.schedule.number, t - self._start
        if self._faults:
            self._faults.begin(number, time_s)
        boot = self.session.clock.boot(t)
        pose, age, reading = self._read(t, now)
        made = frame_of(reading, self.counters.frames % 256)
        boot_ms = 0 if boot is None else max(0, round(boot * 1e3)) % 2**32
        self._count(pose is not None, now - t)
        if self._faults:
            made, sent = self._send_by(self._faults, made, t, boot_ms)
        else:
            sent = self._send(Letter(made, boot_ms))
        met = self._faults.met if self._faults else ()
        self._last = Snapshot(number, time_s, boot, pose, age, reading, made, sent, now - t, met)
        for observer in self._observers:
            observer.frame(self._last)
        self.schedule.advance()
        while now - self.schedule.deadline > _WORST_BACKLOG_S:
            self.counters.skipped += 1
            self.schedule.advance()

    def _read(self, t: float, now: float) -> tuple[Pose | None, float | None, Reading]:
        """The receiver's pose at `t`, None when it is unknown or too old; its age [s]; what is read there."""
        frame = self.datum.frame
        state = self.session.state_at(t, frame) if frame else None
        fresh = state is not None and state.age_s <= self._max_age_s
        self._say_pose(fresh, state, now)
        if state is None or not fresh:
            return None, state.age_s if state else None, self._receiver.nothing()
        pose = Pose(*self._receiver.pose(state.position, state.attitude))
        reading = self._receiver.read(pose.position, pose.rotation)
        if far := self.datum.far(pose.position, reading):
            self._say("warning", far)
        return pose, state.age_s, reading

    @property
    def next_release(self) -> float:
        """When something is due that a fault holds up."""
        return self._faults.outbox.next_due if self._faults else math.inf

    def release(self, now: float) -> None:
        """Send what faults have held up until `now`; all frames of earlier instants have to be made."""
        if self._faults:
            outbox = self._faults.outbox
            while letter := outbox.take(now):
                self.counters.waiting = len(outbox)
                self._send(letter)

    def fault_counts(self) -> dict[str, dict[str, int]]:
        """How many frames met each fault, by its name, and how many bytes it hit."""
        return self._faults.counts() if self._faults else {}

    def _send_by(self, faults: Faults, made: Frame, t: float, boot_ms: int) -> tuple[Frame, bool]:
        """As the faults have it: what the frame says then, and whether it was sent or will be."""
        self.release(t)
        dropped = self.counters.dropped
        said, copies = faults.send(made, t, boot_ms, self._port.encode)
        self.counters.withheld += not copies
        self.counters.duplicated += max(0, copies - 1)
        self.counters.waiting = len(faults.outbox)
        self.release(t)
        return said, copies > 0 and self.counters.dropped == dropped

    def _send(self, letter: Letter) -> bool:
        """Whether it was taken."""
        data = self._port.encode(letter.frame, letter.boot_ms) if letter.data is None else letter.data
        sent = False
        try:
            sent = bool(data) and self._port.write(data)
        finally:  # a link that is lost takes nothing
            self.counters.dropped += not sent
        self.counters.delivered += sent and letter.whole
        self.counters.damaged += sent and not letter.whole
        self._say_dropping(sent)
        if sent:
            for observer in self._wire_observers:
                observer.wire(data)
        return sent

    def ready_for(self, t: float, heard: float) -> bool:
        """In a replay, read up to `heard`: whether the frame of instant `t` can be made."""
        if heard - t >= _LOOK_AHEAD_S:
            return True
        boot, newest = self.session.clock.boot(t), self.session.track.newest
        return heard >= t and (boot is None or newest is None or newest >= boot)

    def _place(self, frame: LocalFrame) -> None:
        self._receiver.transmitters = transmitters(self._scenario, frame)

    def _count(self, posed: bool, late: float) -> None:
        counters = self.counters
        counters.frames += 1
        counters.no_pose += not posed
        counters.latest_s = max(counters.latest_s, late)

    def _say_dropping(self, sent: bool) -> None:
        """One line when nobody takes the frames any more, one when somebody does; none about a lost link."""
        if self._dropping == sent and (self.session.vehicle or sent) and not self._port.away:
            self._dropping = not sent
            if self._dropping:
                self._say("warning", "nobody takes the frames: they are dropped until somebody does")
            else:
                self._say("info", f"frames are taken; {self.counters.dropped} were dropped so far")

    def _say_pose(self, fresh: bool, state: VehicleState | None, now: float) -> None:
        """One line when the pose is lost or does not come, one when it is there."""
        if fresh != self._had_pose:
            self._had_pose = fresh
            self._blind_since = math.inf
            if fresh:
                self._say("info", "there is a pose: readings are real from here on")
            else:
                why = f"the newest is {state.age_s:.1f} s old" if state else self._why_no_pose()
                self._say("warning", f"no pose: frames say no signal until there is one ({why})")
        elif not fresh and self.session.vehicle:
            if self._blind_since is None:
                self._blind_since = now
            elif now - self._blind_since > _BLIND_S:
                self._blind_since = math.inf
                self._say("warning", f"still no pose, frames say no signal: {self._why_no_pose()}")

    def _why_no_pose(self) -> str:
        waiting = self.datum.frame is None and self.session.track.newest is not None
        return "waiting for HOME_POSITION" if waiting else self.session.why_no_pose()

    def _say(self, level: Level, text: str) -> None:
        for observer in self._observers:
            observer.notice(Notice(level, text))

    def _report(self, now: float) -> None:
        vehicle, counters = self.session.vehicle, self.counters
        status = Status(
            now - self._start,
            vehicle.short if vehicle else "",
            self.session.rates(now),
            self._last,
            counters.delivered + counters.damaged + counters.dropped,
            counters.dropped,
        )
        for observer in self._observers:
            observer.status(status)
