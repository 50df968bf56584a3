"""A receiver on its vehicle: the times of its looks, its pose and the transmitters at each of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from arva_hil.config import Scenario
from arva_hil.emulator.build import mount, moving_transmitters, sling, vehicle_noise
from arva_hil.events import Event, PoseFound, PoseLost, PoseMissing, TooFar
from arva_hil.field import LocalFrame, MovingTransmitters, Transmitters
from arva_hil.receiver import Impairment, Look, Pose, Reading, ReceiverModel
from arva_hil.vehicle.pose_track import VehicleState

if TYPE_CHECKING:
    from arva_hil.emulator.emulated_vehicle import EmulatedVehicle
    from arva_hil.emulator.frame_source import Output

_BLIND_S: Final = 8.0  # with a vehicle but without a pose, until there is an event
_START_S: Final = math.nextafter(0.0, -1.0)  # no look is earlier than the run


class Seen(NamedTuple):
    """What was known at the newest look: the receiver's true pose, the one that its vehicle reports, their age, and
    the transmitters.
    """

    t: float
    pose: Pose | None
    reported_pose: Pose | None
    age_s: float | None
    transmitters: Transmitters | None = None


@dataclass(frozen=True)
class Run:
    """What the vehicles and receivers of an engine share. They add to `events` and `outputs`.

    `start`: of the run, on the driver's clock. `max_age_s`: an older pose is not used.
    """

    start: float
    max_age_s: float
    events: list[Event] = field(default_factory=list)
    outputs: list[Output] = field(default_factory=list)


class VirtualReceiver:
    """Remembers one receiver's model, the transmitters, its newest look and the time of the next one.

    `vehicle`, `name`: for its events.
    """

    def __init__(self, vehicle: str, name: str, scenario: Scenario, model: ReceiverModel, run: Run) -> None:
        self.next_due = math.inf  # of the looks, on the driver's clock, once `plan` was called
        self.seen = Seen(run.start, None, None, None)
        self._about = vehicle, name
        self._events = run.events
        self._model = model
        self._mount = mount(scenario)
        self._sling = sling(scenario)
        x, y, z = scenario.receiver.mount.position
        self._place = x, y, z + (self._sling.length_m if self._sling else 0.0)  # at rest, body FRD
        self._vehicle_noise = vehicle_noise(scenario)
        self._transmitters = moving_transmitters(scenario, LocalFrame(0.0, 0.0, 0.0))  # until the datum is known
        self._start = run.start
        self._max_age_s = run.max_age_s
        self._look_s = self._next_look_s = _START_S
        self._had_pose = False
        self._blind_since: float | None = None

    def place(self, transmitters: MovingTransmitters) -> None:
        """The datum has changed: these are the transmitters now."""
        self._transmitters = transmitters

    def plan(self, frame: float, not_before: float = -math.inf) -> None:
        """Set the time of the next look. `frame`: the time of the next frame. Looks before `not_before` are left out.

        Raises ValueError if the model gives a time in the past.
        """
        frame_s = frame - self._start
        left_out_s = min(not_before - self._start, math.nextafter(frame_s, -math.inf))  # never those of the frame
        after_s = max(self._look_s, left_out_s)
        self._next_look_s = self._model.next_look(after_s, frame_s)
        if not self._next_look_s > after_s:
            raise ValueError(f"the receiver's model looks at {self._next_look_s:g} s, not later than {after_s:g} s")
        self.next_due = frame if self._next_look_s == frame_s else self._start + self._next_look_s

    def look(self, now: float, vehicle: EmulatedVehicle) -> bool:
        """Look at the instant `next_due`. Returns whether a frame is wanted at once. Its events are of `now`."""
        t, self._look_s = self.next_due, self._next_look_s
        state, reported = vehicle.states(t)
        self._tell_pose(state, now, vehicle)
        pose = reported_pose = self._pose(state, swings=True)
        if reported is not state:
            reported_pose = self._pose(reported, swings=False)
        there = self._transmitters.at(self._look_s, lambda system: vehicle.pose_of(system, t))
        self.seen = Seen(t, pose, reported_pose, state.age_s if state else None, there)
        noise = self._vehicle_noise
        impairment = Impairment(noise_na_m=noise.sigma_na_m(self._place, vehicle.load())) if noise else None
        return bool(self._model.look(Look(self._look_s, pose, there, impairment=impairment)))

    def show(self, t: float, now: float, vehicle: EmulatedVehicle) -> Reading:
        """The reading at `t`."""
        reading = self._model.show(t - self._start)
        pose, datum = self.seen.pose, vehicle.datum
        if pose is not None and (far := datum.far(pose.position, reading)):
            self._events.append(TooFar(now, *self._about, *far, datum.fixed))
        return reading

    def age_s(self, t: float) -> float | None:
        """The age at `t` of the pose of the newest look."""
        return None if self.seen.age_s is None else self.seen.age_s + (t - self.seen.t)

    def _pose(self, state: VehicleState | None, *, swings: bool) -> Pose | None:
        """Its pose on a vehicle in this state, None if that is unknown or too old. `swings`: if it hangs on a rope."""
        if state is None or not self._is_fresh(state):
            return None
        position, rotation = self._mount.pose(state.position, state.attitude)
        if self._sling and swings:
            position, rotation = self._sling.hang(self._look_s, position, state.velocity, rotation)
        elif self._sling:
            position = position + np.array([0.0, 0.0, self._sling.length_m])
        return Pose(position, rotation)

    def _is_fresh(self, state: VehicleState | None) -> bool:
        return state is not None and state.age_s <= self._max_age_s

    def _tell_pose(self, state: VehicleState | None, now: float, vehicle: EmulatedVehicle) -> None:
        """Add an event if the pose is lost, does not come, or is there again."""
        about, fresh, told = (now, *self._about), self._is_fresh(state), self._events
        if fresh != self._had_pose:
            self._had_pose = fresh
            self._blind_since = math.inf
            age_s = state.age_s if state else None
            told.append(PoseFound(*about) if fresh else PoseLost(*about, age_s, vehicle.lacking()))
        elif not fresh and vehicle.known:
            if self._blind_since is None:
                self._blind_since = now
            elif now - self._blind_since > _BLIND_S:
                self._blind_since = math.inf
                told.append(PoseMissing(*about, vehicle.lacking()))
