"""One receiver of one vehicle: its looks and frames in the order of time, and the result of each frame."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, NamedTuple

from arva_hil import events as told
from arva_hil.config import Scenario
from arva_hil.emulator.build import receiver
from arva_hil.emulator.formats import encoder, frame_of, host_form
from arva_hil.emulator.host_commands import HostCommands
from arva_hil.emulator.virtual_receiver import Run, VirtualReceiver
from arva_hil.frozen import Frozen
from arva_hil.vehicle.session import Session

if TYPE_CHECKING:
    from arva_hil.emulator.emulated_vehicle import EmulatedVehicle
    from arva_hil.faults.plan import Faults
    from arva_hil.faults.sending import QueuedFrame
    from arva_hil.receiver import ReceiverModel

_SPREAD_S: Final = 0.1  # the first frames of several vehicles wait no longer than this
_LATE_S: Final = 0.05  # a frame that is made later than this is late
_OFTEN: Final = 10  # late frames more than others, until there is an event
_WORST_BACKLOG_S: Final = 1.0  # frames later than this are skipped, not sent in a burst


class Schedule:
    """Absolute deadlines: n / rate after `start`, each up to `jitter_s` late. Lateness never adds up.

    After a frame that was brought forward, the deadlines are counted from that frame.
    """

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

    def bring_forward(self, t: float) -> None:
        """The next frame is due at `t`, no later than its deadline."""
        self._start = t - self.number / self._rate
        self.deadline = t

    def _at(self, number: int) -> float:
        late = self._jitter * self._random.random() if self._jitter else 0.0
        return self._start + number / self._rate + late


@dataclass
class Counters:
    """The results of all frames: frames + duplicated = delivered + damaged + withheld + dropped + waiting."""

    frames: int = 0
    duplicated: int = 0  # copies that a fault added
    delivered: int = 0  # sent, undamaged
    damaged: int = 0  # sent, but changed by a fault
    withheld: int = 0  # not sent because of a fault
    dropped: int = 0  # the link did not accept it
    waiting: int = 0  # delayed by a fault, not sent yet
    no_pose: int = 0  # without a signal because the pose was unknown or too old
    skipped: int = 0  # not made because the loop was blocked for more than a second
    latest_s: float = 0.0  # the worst lateness


class Output(NamedTuple):
    """Bytes for the link `sink`, to be written at `due` [s] or later. Then the driver calls `Emulator.written`.

    `source`: of the frame or answer, None for messages to an autopilot. `whole`: the frame in it is undamaged. `made`:
    the frame that is sent when this is accepted. `answer`: it is this answer to a command, not a frame.
    """

    sink: str
    data: bytes
    due: float
    source: FrameSource | None = None
    whole: bool = True
    made: told.FrameMade | None = None
    answer: told.CommandAnswered | None = None


class ReceiverSetup(Frozen):
    """One receiver. `sink`: the link for its frames; for formats inside MAVLink, the autopilot's own."""

    name: str
    sink: str
    scenario: Scenario


class FrameSource:
    """Remembers one receiver, its schedule and the counters of all frames.

    `vehicle`, `session`: name and session of its vehicle. `phase`: of its frames, in periods, or tenths of a second,
    after the start of the run.
    """

    def __init__(self, vehicle: str, setup: ReceiverSetup, session: Session, run: Run, phase: float = 0.0) -> None:
        name, scenario, start = setup.name, setup.scenario, run.start
        self.name = name
        self.sink = setup.sink
        self.counters = Counters()
        rate_hz = scenario.receiver.rate_hz
        first = start + phase * min(1 / rate_hz, _SPREAD_S)
        self.schedule = Schedule(first, rate_hz, scenario.receiver.jitter_s, scenario.seed)
        self.last: told.FrameMade | None = None
        self.events = run.events
        self.outputs = run.outputs
        model = receiver(scenario)
        self.faults = _faults(scenario, model) if scenario.faults else None
        heard_by = self.faults.receiver if self.faults else model
        self.receiver = VirtualReceiver(vehicle, name, scenario, heard_by, run)
        self.receiver.plan(self.schedule.deadline)
        self.commands: HostCommands | None = None
        if host := host_form(scenario.output_format):
            self.commands = HostCommands(vehicle, name, scenario, host, heard_by.command, self._restart, start=start)
        self._first = 0  # the number of the first frame since the receiver was started
        self._vehicle = vehicle
        self._session = session
        self._encode = encoder(scenario.output_format, session)
        self._format = scenario.output_format
        self._start = start
        self._refused = False
        self._late = 0  # late frames minus those in time
        self._told_late = False

    @property
    def next_due(self) -> float:
        """The time at which there is something to do."""
        due = min(self.schedule.deadline, self.receiver.next_due)
        return min(due, self.faults.outbox.next_due) if self.faults else due

    def advance(self, now: float, vehicle: EmulatedVehicle, ready: Callable[[float], bool] | None = None) -> None:
        """Look and make frames at the instants until `now` that are `ready`, and send what faults have delayed.

        Without `ready` the run is live: a frame made after its instant is late, and skipped if it is too late.
        """
        schedule, receiver, live = self.schedule, self.receiver, ready is None
        while (t := min(receiver.next_due, schedule.deadline)) <= now and (ready is None or ready(t)):
            at = now if live else t
            if receiver.next_due <= t and receiver.look(at, vehicle):
                schedule.bring_forward(t)
            if t < schedule.deadline:
                receiver.plan(schedule.deadline)
                continue
            self._make(t, at, vehicle)
            schedule.advance()
            while live and now - schedule.deadline > _WORST_BACKLOG_S:
                self.counters.skipped += 1
                schedule.advance()
            receiver.plan(schedule.deadline, now - _WORST_BACKLOG_S if live else -math.inf)
        self._release(min(now, schedule.deadline))

    def obey(self, now: float) -> None:
        """Execute the commands that came, after all that is due until `now`; answer if no frame is due soon."""
        if self.commands and self.commands.heard:
            self.events += self.commands.advance(now)
            next_frame = min(self.schedule.deadline, self.faults.outbox.next_due if self.faults else math.inf)
            for data, answer in self.commands.answers(now, next_frame):
                self.outputs.append(Output(self.sink, data, now, self, answer=answer))

    def written(self, output: Output, taken: bool, now: float, *, lost: bool) -> None:
        """An output was written. `taken`: the link has accepted it. `lost`: the link is lost: it has its own event."""
        if output.answer is not None:
            assert self.commands is not None
            self.commands.counters.answers_dropped += not taken
            self.events.append(output.answer if taken else replace(output.answer, sent=False))
            return
        counters = self.counters
        counters.dropped += not taken
        counters.delivered += taken and output.whole
        counters.damaged += taken and not output.whole
        about = now, self._vehicle, self.name
        if self._refused == taken and (self._session.vehicle or taken) and not lost:
            self._refused = not taken
            self.events.append(told.FramesTaken(*about, counters.dropped) if taken else told.FramesRefused(*about))
        if taken:
            self.events.append(told.BytesSent(*about, output.data))
        if output.made is not None:
            self._tell(output.made if taken else replace(output.made, sent=False))

    def fault_counts(self) -> dict[str, dict[str, int]]:
        """For each fault by name: how many frames and how many bytes it changed."""
        return self.faults.counts() if self.faults else {}

    def status(self) -> told.ReceiverStatus:
        c = self.counters
        there = self.receiver.seen.transmitters
        return told.ReceiverStatus(self.name, self.last, c.delivered + c.damaged + c.dropped, c.dropped, there)

    def _make(self, t: float, now: float, vehicle: EmulatedVehicle) -> None:
        number, instant_s = self.schedule.number, t - self._start
        if self.faults:
            self.faults.begin(number, instant_s)
        boot = self._session.clock.boot(t)
        reading = self.receiver.show(t, now, vehicle)
        _, pose, reported, _, _ = self.receiver.seen
        age = self.receiver.age_s(t)
        frame = frame_of(reading, (number - self._first) % 256, instant_s, self._format)
        if self.commands:
            self.commands.channels = len(frame.channels)
        boot_ms = 0 if boot is None else max(0, round(boot * 1e3)) % 2**32
        counters = self.counters
        counters.frames += 1
        counters.no_pose += pose is None
        counters.latest_s = max(counters.latest_s, now - t)
        self._note_late(now, now - t)
        self._release(t)
        data, before = b"", len(self.outputs)
        met: tuple[str, ...] = ()
        if self.faults:
            frame, copies = self.faults.send(frame, t, boot_ms, self._encode)
            counters.withheld += not copies
            counters.duplicated += max(0, copies - 1)
            counters.waiting = len(self.faults.outbox)
            self._release(t)
            sent, met = copies > 0, self.faults.met
        else:
            data = self._encode(frame, boot_ms)
            sent = len(data) > 0
            counters.dropped += not sent
        about = now, self._vehicle, self.name
        made = told.FrameMade(*about, number, instant_s, boot, pose, age, reading, frame, sent, now - t, met, reported)
        if data:
            self.outputs.append(Output(self.sink, data, t, self, True, made))
        elif len(self.outputs) > before:
            self.outputs[-1] = self.outputs[-1]._replace(made=made)
        else:
            self._tell(made)

    def _note_late(self, now: float, late_s: float) -> None:
        """Make an event if most frames are late, and the next one only after as many were in time."""
        self._late = min(self._late + 1, _OFTEN) if late_s > _LATE_S else max(self._late - 1, 0)
        if self._late == _OFTEN and not self._told_late:
            self.events.append(told.FramesLate(now, self._vehicle, self.name, late_s))
        self._told_late = self._late == _OFTEN or (self._told_late and self._late > 0)

    def _restart(self) -> None:
        self._first = self.schedule.number

    def _tell(self, made: told.FrameMade) -> None:
        self.last = made
        self.events.append(made)

    def _release(self, until: float) -> None:
        """Send what faults have delayed until then."""
        if self.faults:
            outbox = self.faults.outbox
            while (due := outbox.next_due) <= until and (queued := outbox.take(until)):
                self.counters.waiting = len(outbox)
                self._put(queued, due)

    def _put(self, queued: QueuedFrame, due: float) -> None:
        """Make an output if it can be sent to somebody."""
        data = self._encode(queued.frame, queued.boot_ms) if queued.data is None else queued.data
        if data:
            self.outputs.append(Output(self.sink, data, due, self, queued.whole))
        else:
            self.counters.dropped += 1


def _faults(scenario: Scenario, model: ReceiverModel) -> Faults:
    from arva_hil.faults.plan import Faults  # most runs have none

    return Faults(scenario, model)
