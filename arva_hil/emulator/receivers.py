"""One receiver on its vehicle: the times of its samples and frames, and the reading of each frame."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

import firmware_proto
from arva_hil.autopilot.following.navigation import VehicleState
from arva_hil.config import Scenario
from arva_hil.emulator.build import mount, sling, vehicle_noise
from arva_hil.emulator.world import Snapshot
from arva_hil.events import Event, FrameMade, PoseFound, PoseLost, PoseMissing
from arva_hil.model.field import Transmitters
from arva_hil.model.receiver import Answer, ChannelReading, Impairment, Look, Pose, Reading, ReceiverModel
from arva_hil.registry import FORMATS
from firmware_proto import Channel, Frame, LevelChannel, Measured, VectorChannel
from firmware_proto.commands import RESTART
from firmware_proto.measured import level_channel, vector_channel

_WORST_BACKLOG_S: Final = 1.0  # frames later than this are skipped, not sent in a burst
_BLIND_S: Final = 8.0  # with a vehicle but without a pose, emit an event after this time
_START_S: Final = math.nextafter(0.0, -1.0)  # no sample is earlier than the run


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
        """Advance to the next frame."""
        self.number += 1
        self.deadline = self._at(self.number)

    def bring_forward(self, t: float) -> None:
        """Set the deadline of the next frame to `t`, which is no later than its own."""
        self._start = t - self.number / self._rate
        self.deadline = t

    def _at(self, number: int) -> float:
        late = self._jitter * self._random.random() if self._jitter else 0.0
        return self._start + number / self._rate + late


class PoseWatch:
    """Remembers if a receiver has a pose, and emits events about it. `vehicle`, `receiver`: names for events."""

    def __init__(self, vehicle: str, receiver: str) -> None:
        self._about = vehicle, receiver
        self._had_pose = False
        self._blind_since: float | None = None  # with a vehicle
        self._reported = False  # that there is no pose, or that there was one

    def check(self, seen: Snapshot, now: float) -> list[Event]:
        """Return an event if the pose is lost, does not come, or is there again."""
        about, lacking = (now, *self._about), seen.lacking
        if (lacking is None) != self._had_pose:
            self._had_pose, self._reported = lacking is None, True
            return [PoseLost(*about, seen.age_s, lacking) if lacking else PoseFound(*about)]
        if lacking is None or self._reported or lacking.reason == "no vehicle":
            return []
        if self._blind_since is None:
            self._blind_since = now
        self._reported = now - self._blind_since > _BLIND_S
        return [PoseMissing(*about, lacking)] if self._reported else []


class Mounting:
    """The place of a receiver on its vehicle, or on a rope under it, and the noise of the motors there."""

    def __init__(self, scenario: Scenario) -> None:
        self._mount = mount(scenario)
        self._sling = sling(scenario)
        self.noise = vehicle_noise(scenario)  # None: the vehicle makes none
        x, y, z = scenario.receiver.mount.position
        self._place = x, y, z + (self._sling.length_m if self._sling else 0.0)  # at rest, body FRD

    def pose(self, state: VehicleState | None, time_s: float, *, swings: bool) -> Pose | None:
        """Return the receiver's pose on a vehicle in this state. `swings`: the load on the rope swings."""
        if state is None:
            return None
        position, rotation = self._mount.pose(state.position, state.attitude)
        if self._sling and swings:
            position, rotation = self._sling.hang(time_s, position, state.velocity, rotation)
        elif self._sling:
            position = position + np.array([0.0, 0.0, self._sling.length_m])
        return Pose(position, rotation)

    def impairment(self, load: float) -> Impairment:
        """Return the noise of motors with this load."""
        assert self.noise is not None
        return Impairment(noise_na_m=self.noise.sigma_na_m(self._place, load))


class Seen(NamedTuple):
    """The newest sample of a receiver."""

    time_s: float
    """From the start of the run."""
    t: float
    """On the driver's clock."""
    pose: Pose | None = None
    reported_pose: Pose | None = None
    age_s: float | None = None
    transmitters: Transmitters | None = None


class EmulatedReceiver:
    """One receiver: its model, its schedule and its newest sample. Times are seconds on the driver's clock.

    - `vehicle`, `name`: names for events.
    - `start`: of the run. `first`: the time of the first frame.
    - `schedule`: of the frames; None: those of the scenario.
    - `next_due`: the time of the next sample or frame.
    """

    def __init__(
        self,
        vehicle: str,
        name: str,
        scenario: Scenario,
        model: ReceiverModel,
        *,
        start: float,
        first: float,
        schedule: Schedule | None = None,
    ) -> None:
        settings = scenario.receiver
        self.schedule = schedule or Schedule(first, settings.rate_hz, settings.jitter_s, scenario.seed)
        self.seen = Seen(_START_S, start)
        self._about = vehicle, name
        self._model = model
        self._mounting = Mounting(scenario)
        self._pose_watch = PoseWatch(vehicle, name)
        self._measured: str = getattr(FORMATS[scenario.output_format], "measured", "")
        self._start = start
        self._first = 0  # the number of the first frame since the receiver was started
        self._plan()

    def advance(self, seen: Snapshot, now: float) -> list[Event]:
        """Take a sample, or make a frame, at the instant `next_due`. `seen`: the vehicle at that instant.

        Returns the events; the frame, if there is one, is the last of them. In a live run `now` is later than the
        instant: the frame is late, and those that are too late are skipped.
        """
        t, schedule = seen.t, self.schedule
        events: list[Event] = []
        if self._next_look <= t:
            events = self._pose_watch.check(seen, now)
            if self._look(seen):
                schedule.bring_forward(t)
        if t < schedule.deadline:
            self._plan()
            return events
        events.append(self._made(seen, now))
        schedule.advance()
        while now - schedule.deadline > _WORST_BACKLOG_S:
            schedule.advance()
        self._plan(now - _WORST_BACKLOG_S if now > t else -math.inf)
        return events

    def command(self, now: float, name: str, values: Sequence[float]) -> Answer:
        """Handle a command of the host. All that is due until `now` is done."""
        answer = self._model.command(now - self._start, name, values)
        if name == RESTART and answer is Answer.DONE:
            self._first = self.schedule.number
        return answer

    def _plan(self, not_before: float = -math.inf) -> None:
        """Set the time of the next sample. Samples before `not_before` are left out.

        Raises ValueError if the model gives a time in the past.
        """
        frame_s = self.schedule.deadline - self._start
        left_out_s = min(not_before - self._start, math.nextafter(frame_s, -math.inf))  # never those of the frame
        after_s = max(self.seen.time_s, left_out_s)
        self._next_look_s = self._model.next_look(after_s, frame_s)
        if not self._next_look_s > after_s:
            raise ValueError(
                f"the receiver's model takes a sample at {self._next_look_s:g} s, not later than {after_s:g} s"
            )
        deadline = self.schedule.deadline
        self._next_look = deadline if self._next_look_s == frame_s else self._start + self._next_look_s
        self.next_due = min(self._next_look, deadline)

    def _look(self, seen: Snapshot) -> bool:
        """Take a sample of the vehicle's surroundings. Returns True if the model wants a frame at once."""
        time_s = self._next_look_s
        pose = reported_pose = self._mounting.pose(seen.pose, time_s, swings=True)
        if seen.reported is not seen.pose:
            reported_pose = self._mounting.pose(seen.reported, time_s, swings=False)
        self.seen = Seen(time_s, seen.t, pose, reported_pose, seen.age_s, seen.transmitters)
        impairment = self._mounting.impairment(seen.load) if self._mounting.noise else None
        return bool(self._model.look(Look(time_s, pose, seen.transmitters, impairment=impairment)))

    def _made(self, seen: Snapshot, now: float) -> FrameMade:
        number, instant_s = self.schedule.number, seen.t - self._start
        reading = self._model.show(instant_s)
        _, looked, pose, reported_pose, age_s, _ = self.seen
        age_s = None if age_s is None else age_s + (seen.t - looked)
        frame = frame_of(reading, (number - self._first) % 256, instant_s, self._measured)
        return FrameMade(
            now,
            *self._about,
            number,
            instant_s,
            seen.boot_s,
            pose,
            age_s,
            reading,
            frame,
            True,
            now - seen.t,
            (),
            reported_pose,
        )


def frame_of(reading: Reading, sequence: int, time_s: float = 0.0, measured: str = "") -> Frame:
    """Return the frame for a reading. It is always marked as synthetic.

    `measured`: see `firmware_proto.Format`. `time_s`: of the frame, from the start of the run.
    """
    status = (
        firmware_proto.SYNTHETIC
        | reading.interference * firmware_proto.INTERFERENCE
        | reading.more_heard * firmware_proto.MORE_TRANSMITTERS
        | reading.failed * firmware_proto.SELF_TEST_FAULT
        | reading.overlapping * firmware_proto.OVERLAP
        | (not reading.searching) * firmware_proto.NOT_SEARCHING
    )
    channels = [Channel(id_, zone, d, delta, marked) for id_, zone, d, delta, _, marked, _ in reading.channels]
    frame = Frame(sequence, status, tuple(channels))
    return frame._replace(measured=_measured(reading, time_s, measured)) if measured else frame


def _measured(reading: Reading, time_s: float, kind: str) -> Measured:
    time_ms = round(1e3 * time_s) % 2**32
    if kind == "vector":
        return Measured(time_ms, tuple(_vector(c, time_s) for c in reading.channels))
    return Measured(time_ms, tuple(_level(c, time_s) for c in reading.channels))


def _vector(c: ChannelReading, time_s: float) -> VectorChannel:
    who = c.id, int(c.zone), c.marked
    if (pulse := c.pulse) is None:
        return VectorChannel(*who)
    return vector_channel(*who, pulse.signal_na_m, pulse.period_s, pulse.carrier_hz, time_s - pulse.time_s)


def _level(c: ChannelReading, time_s: float) -> LevelChannel:
    """Return the level, relative to 1 nA/m without a full scale of the receiver."""
    who = c.id, int(c.zone), c.marked
    if (pulse := c.pulse) is None:
        return LevelChannel(*who)
    level_db = pulse.level_dbfs
    if level_db is None:
        level_db = 20 * math.log10(max(math.hypot(*pulse.signal_na_m), 1e-12))
    return level_channel(*who, level_db, time_s - pulse.time_s)
