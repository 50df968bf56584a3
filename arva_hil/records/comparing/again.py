"""The readings of the emulator's receiver on a recorded flight, at the instants of the recorded frames."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.autopilot.following.session import Session
from arva_hil.config import Scenario
from arva_hil.emulator import build
from arva_hil.emulator.receivers import EmulatedReceiver, Schedule
from arva_hil.emulator.setup import VehicleSetup, one_vehicle
from arva_hil.emulator.world import VehicleWorld
from arva_hil.events import FrameMade
from arva_hil.links import LinkError
from arva_hil.links.tlog import TlogReader
from arva_hil.links.tlog_timeline import Timeline
from arva_hil.model.field import rotation
from arva_hil.records.reading import RecordedReceiver, Recording, RecordingError
from arva_hil.records.reading.receivers import NO_ID
from arva_hil.records.writing.layout import TLOG

_LOOK_AHEAD_S = 1.0
_NO_ANGLE = np.full(3, np.nan)


class RecordedSchedule(Schedule):
    """Frames at recorded instants, seconds from the start of the record. A model cannot request earlier ones."""

    def __init__(self, times: Sequence[float]) -> None:
        self._times = times
        super().__init__(0.0, 1.0, 0.0, 0)

    def bring_forward(self, t: float) -> None:
        pass

    def _at(self, number: int) -> float:
        return self._times[number] if number < len(self._times) else math.inf


class Emulated(NamedTuple):
    """The readings, and the true range of each transmitter at each frame by its id [m], NaN without a pose."""

    receiver: RecordedReceiver
    ranges: Mapping[int, NDArray[np.float64]]


def emulated_again(recording: Recording, receiver: RecordedReceiver, scenario: Scenario) -> Emulated:
    """Return the readings of the scenario's receiver at the instants of the recorded frames.

    Its poses come from the packets of the record. Faults of the scenario are left out. Raises RecordingError.
    """
    setup = one_vehicle(scenario, Session(passive=True))
    world = VehicleWorld(setup, {}, start=0.0, max_age_s=2.0)
    schedule = RecordedSchedule(receiver.time_s.tolist())
    model = build.receiver(scenario)
    emulated = EmulatedReceiver("", "", scenario, model, start=0.0, first=0.0, schedule=schedule)
    made: list[FrameMade] = []
    ranges: list[Mapping[int, float]] = []

    def settle(now: float) -> None:
        while (t := emulated.next_due) <= now and (now - t >= _LOOK_AHEAD_S or world.is_known(t)):
            for event in emulated.advance(seen := world.at(t), t):
                if isinstance(event, FrameMade):
                    made.append(event)
                    ranges.append(seen.transmitters.ranges(event.pose.position) if event.pose else {})

    feed(recording, setup, world, settle)
    settle(float(receiver.time_s[-1]) + _LOOK_AHEAD_S if len(receiver) else 0.0)
    ids = [transmitter.id for transmitter in scenario.transmitters]
    by_id = {id_: np.array([one.get(id_, math.nan) for one in ranges]) for id_ in ids}
    return Emulated(_columns(receiver, made), by_id)


def packets(recording: Recording) -> Iterator[tuple[float, bytes]]:
    """Yield the packets of a record's log, each with its time from the start of the frames [s].

    Raises RecordingError.
    """
    path = recording.folder / TLOG
    if not path.exists() or recording.log_start_s is None:
        raise RecordingError(recording.folder, f"there are no poses in it: {TLOG} is missing")
    start_us = recording.log_start_s * 1e6
    try:
        with closing(TlogReader(path)) as log:
            for time_us, raw in Timeline(log, stamped=log.stamped):
                yield (time_us - start_us) / 1e6, raw
    except LinkError as error:
        raise RecordingError(path, str(error)) from None


def feed(recording: Recording, setup: VehicleSetup, world: VehicleWorld, settle: Callable[[float], None]) -> float:
    """Feed the packets of a record to a vehicle's world. `settle(now)`: called before the packets of `now`.

    Returns the time of the last ones. Raises RecordingError.
    """
    before = -math.inf
    for now, raw in packets(recording):
        now = max(now, before)
        if now > before:
            settle(now)
        before = now
        world.update(setup.session.feed(raw, now, whole=True), now)
    return before


def _columns(receiver: RecordedReceiver, made: Sequence[FrameMade]) -> RecordedReceiver:
    slots = [slot for event in made for slot in event.reading.channels]
    begins = np.cumsum([0, *(len(event.reading.channels) for event in made)])
    n = len(made)
    poses = [event.pose for event in made]
    position = np.array([_NO_ANGLE if pose is None else pose.position for pose in poses]).reshape(-1, 3)
    angles = [_NO_ANGLE if pose is None else np.degrees(rotation.to_euler(pose.rotation)) for pose in poses]
    nan = math.nan

    def whole(values: Sequence[int]) -> NDArray[np.int64]:
        return np.array(values, np.int64)

    return RecordedReceiver(
        "",
        "",
        whole([event.frame.sequence for event in made]),
        receiver.time_s[:n],
        receiver.boot_ms[:n],
        position,
        np.array(angles).reshape(-1, 3),
        receiver.pose_age_ms[:n],
        position,
        np.zeros(n),
        begins,
        whole([NO_ID if slot.id is None else slot.id for slot in slots]),
        whole([slot.zone for slot in slots]),
        whole([slot.d_cm for slot in slots]),
        whole([slot.delta_deg for slot in slots]),
        np.array([nan if slot.true_range_m is None else slot.true_range_m for slot in slots]),
        ((),),
        np.zeros(n, np.int64),
    )
