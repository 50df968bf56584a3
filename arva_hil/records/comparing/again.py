"""The pairs of frames of one flight: of two records, or of a record and an emulated receiver at the same instants."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.autopilot.following.session import Session
from arva_hil.config import Fault, Scenario
from arva_hil.emulator import build
from arva_hil.emulator.faults.plan import Faults
from arva_hil.emulator.ports import encoder
from arva_hil.emulator.receivers import EmulatedReceiver, Schedule
from arva_hil.emulator.setup import VehicleSetup, one_vehicle
from arva_hil.emulator.true_state import latency_s
from arva_hil.emulator.world import VehicleWorld
from arva_hil.errors import ArvaError
from arva_hil.events import FrameMade
from arva_hil.model.field import rotation
from arva_hil.records.reading import NO_ID, RecordedReceiver, Recording, RecordingError, logged
from arva_hil.records.writing.layout import TLOG
from firmware_proto import Frame

Floats = NDArray[np.float64]
Index = NDArray[np.intp]

_APART_S: Final = 0.6  # between two frames of one instant
_APART_M: Final = 2.0  # in the median: the same flight
_NEAR_M: Final = 1.0  # between two poses of one place
_NEAR_DEG: Final = 20.0
_FEW: Final = 10
_BLOCK: Final = 1 << 22  # pairs of poses compared at a time


class NotComparable(ArvaError):
    """Two records have too little in common."""


class Paired(NamedTuple):
    """Frames of two receivers that belong together.

    `how`: "time" or "place". `offset_s`: clock of the second record minus that of the first; None if it is not known.
    """

    first: Index
    second: Index
    how: str
    offset_s: float | None


def paired_frames(a: Recording, b: Recording) -> Paired:
    """Pair the frames of two records, both with poses. Raises NotComparable.

    Records of one flight have the same boot times of the autopilot, so that different clocks of the computers do not
    matter: their offset follows. Frames of two flights are paired if their poses are the same.
    """
    one, two = a.receivers[0], b.receivers[0]
    by_time = _by_time(one, two)
    if by_time is not None:
        first, second = by_time
        offset = None
        if a.log_start_s is not None and b.log_start_s is not None:
            boot_s = (one.boot_ms[first] - two.boot_ms[second]) / 1e3
            clocks = b.log_start_s + two.time_s[second] - a.log_start_s - one.time_s[first]
            offset = float(np.median(clocks + boot_s))
        return Paired(first, second, "time", offset)
    first, second = _by_place(one, two)
    if len(first) < _FEW:
        raise NotComparable(
            f"{a.folder} and {b.folder} are of two flights, and only {len(first)} frames are at common places "
            f"(within {_NEAR_M:g} m and {_NEAR_DEG:g}° of heading): compare each with --scenario"
        )
    return Paired(first, second, "place", None)


def _by_time(one: RecordedReceiver, two: RecordedReceiver) -> tuple[Index, Index] | None:
    there_1 = np.flatnonzero(np.isfinite(one.boot_ms) & np.isfinite(one.position).all(axis=1))
    there_2 = np.flatnonzero(np.isfinite(two.boot_ms) & np.isfinite(two.position).all(axis=1))
    if not len(there_1) or not len(there_2):
        return None
    boot_1, boot_2 = one.boot_ms[there_1] / 1e3, two.boot_ms[there_2] / 1e3
    after = np.clip(np.searchsorted(boot_2, boot_1), 1, max(len(boot_2) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(boot_2) - 1)
    nearest = np.where(np.abs(boot_2[after] - boot_1) < np.abs(boot_2[before] - boot_1), after, before)
    close = np.abs(boot_2[nearest] - boot_1) <= _APART_S
    first, second = there_1[close], there_2[nearest[close]]
    if len(first) < _FEW:
        return None
    apart = np.linalg.norm(one.position[first] - two.position[second], axis=1)
    return (first, second) if np.median(apart) <= _APART_M else None


def _by_place(one: RecordedReceiver, two: RecordedReceiver) -> tuple[Index, Index]:
    there_1 = np.flatnonzero(np.isfinite(one.position).all(axis=1))
    there_2 = np.flatnonzero(np.isfinite(two.position).all(axis=1))
    first, second = [], []
    step = max(1, _BLOCK // max(len(there_2), 1))
    for begin in range(0, len(there_1), step):
        some = there_1[begin : begin + step]
        apart = np.linalg.norm(one.position[some][:, None] - two.position[there_2][None], axis=2)
        turn = one.attitude_deg[some, 2][:, None] - two.attitude_deg[there_2, 2][None]
        apart[np.abs((turn + 180) % 360 - 180) > _NEAR_DEG] = np.inf
        nearest = apart.argmin(axis=1)
        close = apart[np.arange(len(some)), nearest] <= _NEAR_M
        first.append(some[close])
        second.append(there_2[nearest[close]])
    return np.concatenate(first), np.concatenate(second)


_LOOK_AHEAD_S = 1.0
_LONGEST_S = 1e5
_AT_ONCE_S = 1e9  # later than any delay
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
    """The readings, and the true range of each transmitter at each frame by its id [m], NaN without a pose.

    `pairs`: the recorded frames, and these. Frames that a fault withholds or damages are not in it.
    """

    receiver: RecordedReceiver
    ranges: Mapping[int, NDArray[np.float64]]
    pairs: Paired


def emulated_again(recording: Recording, receiver: RecordedReceiver, scenario: Scenario) -> Emulated:
    """Return the readings of the scenario's receiver at the instants of the recorded frames, with its faults.

    Its poses come from the packets of the record. A frame was made `delay_s` before it was recorded. Raises
    RecordingError.
    """
    setup = one_vehicle(scenario, Session(passive=True))
    world = VehicleWorld(setup, {}, start=0.0, max_age_s=2.0)
    model, faults = build.receiver(scenario), None
    if scenario.faults:
        faults = Faults(scenario, model)
        model = faults.receiver
    schedule = RecordedSchedule(_made_s(receiver.time_s, scenario.faults))
    emulated = EmulatedReceiver("", "", scenario, model, start=0.0, first=0.0, schedule=schedule)
    encode = encoder(scenario.output_format, setup.session)
    look_ahead_s = _LOOK_AHEAD_S + latency_s(scenario)
    made: list[FrameMade] = []
    ranges: list[Mapping[int, float]] = []

    def settle(now: float) -> None:
        while (t := emulated.next_due) <= now and (now - t >= look_ahead_s or world.is_known(t)):
            for event in emulated.advance(seen := world.at(t), t):
                if isinstance(event, FrameMade) and (faults is None or _arrives(event, faults, encode)):
                    made.append(event)
                    ranges.append(seen.transmitters.ranges(event.pose.position) if event.pose else {})

    feed(recording, setup, world, settle)
    settle(float(receiver.time_s[-1]) + 2 * look_ahead_s if len(receiver) else 0.0)
    ids = [transmitter.id for transmitter in scenario.transmitters]
    by_id = {id_: np.array([one.get(id_, math.nan) for one in ranges]) for id_ in ids}
    numbers = np.array([event.number for event in made], np.intp)
    return Emulated(_columns(receiver, made, numbers), by_id, Paired(numbers, np.arange(len(made)), "time", None))


def _made_s(recorded_s: NDArray[np.float64], faults: Sequence[Fault]) -> list[float]:
    """Return the instants at which frames were made that were recorded at these times: each is later than the last."""
    late_s = np.zeros(len(recorded_s))
    for fault in faults:
        if fault.name == "delay_s":
            late_s += [fault.value * (fault.since(round(t * 1e6)) is not None) for t in recorded_s]
    made_s = np.maximum.accumulate(np.maximum(recorded_s - late_s, 0.0))
    later: list[float] = (made_s + 1e-9 * np.arange(len(made_s))).tolist()
    return later


def _arrives(made: FrameMade, faults: Faults, encode: Callable[[Frame, int], bytes]) -> bool:
    """Return True if faults neither withhold nor damage this frame."""
    faults.begin(made.number, made.instant_s)
    _, copies = faults.send(made.frame, 0.0, 0, encode)
    queued = list(iter(lambda: faults.outbox.take(_AT_ONCE_S), None))
    return copies > 0 and all(one.whole for one in queued)


def feed(recording: Recording, setup: VehicleSetup, world: VehicleWorld, settle: Callable[[float], None]) -> float:
    """Feed the packets of a record to a vehicle's world. `settle(now)`: called before the packets of `now`.

    Times are from the start of the frames [s]. Returns that of the last packets. Raises RecordingError.
    """
    path = recording.folder / TLOG
    if not path.exists() or recording.log_start_s is None:
        raise RecordingError(recording.folder, f"there are no poses in it: {TLOG} is missing")
    before = -math.inf
    for time_us, raw in logged(path, continuous=True):
        now = max((time_us - recording.log_start_s * 1e6) / 1e6, before)
        if now > _LONGEST_S:
            raise RecordingError(path, "its packets came more than a day after the frames: the times cannot be right")
        if now > before:
            settle(now)
        before = now
        world.update(setup.session.feed(raw, now, whole=True), now)
    return before


def _columns(receiver: RecordedReceiver, made: Sequence[FrameMade], numbers: NDArray[np.intp]) -> RecordedReceiver:
    slots = [slot for event in made for slot in event.reading.channels]
    begins = np.cumsum([0, *(len(event.reading.channels) for event in made)])
    poses = [event.pose for event in made]
    position = np.array([_NO_ANGLE if pose is None else pose.position for pose in poses]).reshape(-1, 3)
    angles = [_NO_ANGLE if pose is None else np.degrees(rotation.to_euler(pose.rotation)) for pose in poses]
    ids = [NO_ID if slot.id is None else slot.id for slot in slots]
    ranges = [math.nan if slot.true_range_m is None else slot.true_range_m for slot in slots]
    return RecordedReceiver(
        "",
        "",
        np.array([event.frame.sequence for event in made], np.int64),
        receiver.time_s[numbers],
        receiver.boot_ms[numbers],
        position,
        np.array(angles).reshape(-1, 3),
        receiver.pose_age_ms[numbers],
        position,
        np.zeros(len(made)),
        begins,
        np.array(ids, np.int64),
        np.array([slot.zone for slot in slots], np.int64),
        np.array([slot.d_cm for slot in slots], np.int64),
        np.array([slot.delta_deg for slot in slots], np.int64),
        np.array(ranges, float),
        ((),),
        np.zeros(len(made), np.int64),
    )
