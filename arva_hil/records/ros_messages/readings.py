"""The messages of a run: readings, poses, transmitters and diagnostics; and all messages, with those of its search.

They are made from the events of a live run, or from the rows of a record. Both give the same messages.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from arva_hil.config import Lla, Scenario
from arva_hil.emulator.build import moving_transmitters
from arva_hil.emulator.setup import receivers_of
from arva_hil.events import DatumSet, Event, FrameMade, ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.events.searches import FromSearch, SearchEvent
from arva_hil.model.field import LocalFrame, MovingTransmitters, Transmitters, dipole_field
from arva_hil.model.field.arrays import Array
from arva_hil.model.receiver import ChannelReading, Pose
from arva_hil.records.ros_messages import geometry
from arva_hil.records.ros_messages import types as ros
from arva_hil.records.ros_messages.searches import TOPICS, SearchMessages
from arva_hil.safe_text import one_line

_EMPTY: Final = -1  # the id of an empty slot
_NOWHERE: Final = ros.Vector3(0.0, 0.0, 0.0)
_SHAPES_S: Final = 0.2  # shortest time between two drawings of the shapes
_STATUS_S: Final = 1.0
_FIX: Final = ros.NavSatStatus(0, 1)  # a fix, of GPS
_UNKNOWN: Final = np.zeros(9)


class RunMessages:
    """Makes the messages of one run. Remembers each vehicle's datum and transmitters, and the times of publications.

    `scenario`: None if it is not known; then no transmitter is known. `epoch_us`: microseconds since 1970 at the loop's
    time 0. `receivers`: (vehicle, receiver); default: the scenario's. Transmitters that follow a vehicle are not drawn,
    and have no field here.
    """

    def __init__(
        self, scenario: Scenario | None, epoch_us: int, receivers: Sequence[tuple[str, str]] | None = None
    ) -> None:
        self._scenario = scenario
        self._epoch_us = epoch_us
        of_scenario = receivers_of(scenario) if scenario else []
        self._names = ros.names_of(of_scenario if receivers is None else receivers)
        self._datums: dict[str, LocalFrame] = {}
        self._there: dict[str, MovingTransmitters] = {}
        self._shaped: dict[tuple[str, str], int] = {}  # time of the last drawing, ns
        self._arrows: dict[tuple[str, str], frozenset[int]] = {}  # the slots that have one
        self._next_status_ns = 0
        if scenario and isinstance(fixed := scenario.datum, Lla):
            for vehicle, _ in self._names:
                self._place(vehicle, LocalFrame(fixed.lat, fixed.lon, fixed.alt))

    def of_event(self, event: Event) -> list[ros.Publication]:
        """Return the messages of an event of a live run. Most events have none."""
        if isinstance(event, FrameMade):
            return self._of_frame(event)
        if isinstance(event, DatumSet):
            self._place(event.vehicle, LocalFrame(event.lat, event.lon, event.alt))
        if isinstance(event, StatusReport):
            return self._of_status(event)
        return []

    def _place(self, vehicle: str, own: LocalFrame) -> None:
        """Set the vehicle's datum."""
        self._datums[vehicle] = own
        if self._scenario:
            self._there[vehicle] = moving_transmitters(self._scenario, own)

    @property
    def world(self) -> LocalFrame | None:
        """The datum of the frame `map`: the one of the first vehicle with a datum."""
        return next(iter(self._datums.values()), None)

    def _of_frame(self, made: FrameMade) -> list[ros.Publication]:
        key, stamp = (made.vehicle, made.receiver), ros.stamp_of(self._epoch_us, made.time_s - made.late_s)
        if (names := self._names.get(key)) is None:
            return []
        moving, datum = self._there.get(made.vehicle), self._datums.get(made.vehicle)
        there = moving.at(made.instant_s) if moving else None
        directions = _directions(made.pose, there)
        own, world = ros.header(stamp, names.frame), ros.header(stamp, names.map)
        slots = [_slot(channel, directions) for channel in made.reading.channels]
        told = [ros.Publication(names.arva, stamp, ros.Arva(own, slots))]
        transforms = []
        if made.pose is not None:
            pose = geometry.pose(made.pose.position, made.pose.rotation)
            told.append(ros.Publication(f"{names.arva}/pose", stamp, ros.PoseStamped(world, pose)))
            transforms.append(ros.TransformStamped(world, names.frame, geometry.transform(pose)))
            if datum:
                lat, lon, alt = map(float, datum.lla(made.pose.position))
                told.append(
                    ros.Publication(f"{names.arva}/fix", stamp, ros.NavSatFix(own, _FIX, lat, lon, alt, _UNKNOWN, 0))
                )
        if made.reported_pose is not None and made.reported_pose is not made.pose:
            reported = geometry.pose(made.reported_pose.position, made.reported_pose.rotation)
            told.append(ros.Publication(f"{names.arva}/reported_pose", stamp, ros.PoseStamped(world, reported)))
        if abs(stamp - self._shaped.get(key, -(2**63))) >= _SHAPES_S * 1e9:
            self._shaped[key] = stamp
            if names.map != ros.MAP and self.world and datum:
                there_is = geometry.between(self.world, datum)
                transforms.append(ros.TransformStamped(ros.header(stamp, ros.MAP), names.map, there_is))
            shapes = self._arrows_of(key, own, slots)
            for id_, place, rotation in _placed(there):
                pose = geometry.pose(place, rotation)
                shapes += geometry.transmitter(world, id_, pose)
                transforms.append(ros.TransformStamped(world, f"{names.transmitter}{id_}", geometry.transform(pose)))
            told.append(ros.Publication(f"{names.arva}/visualization", stamp, ros.MarkerArray(shapes)))
        if transforms:
            told.insert(0, ros.Publication(ros.TF, stamp, ros.TFMessage(transforms)))
        return told

    @property
    def topics(self) -> dict[str, type[ros.Message]]:
        """All possible topics, with their message types."""
        topics: dict[str, type[ros.Message]] = {ros.TF: ros.TFMessage, ros.DIAGNOSTICS: ros.DiagnosticArray}
        for names in self._names.values():
            topics |= {names.arva: ros.Arva, f"{names.arva}/pose": ros.PoseStamped, f"{names.arva}/fix": ros.NavSatFix}
            topics[f"{names.arva}/reported_pose"] = ros.PoseStamped
            topics[f"{names.arva}/visualization"] = ros.MarkerArray
        return topics

    def _of_status(self, report: StatusReport) -> list[ros.Publication]:
        stamp = ros.stamp_of(self._epoch_us, report.time_s)
        if stamp < self._next_status_ns:
            return []
        self._next_status_ns = stamp + round(_STATUS_S * 1e9)
        status = []
        for vehicle in report.vehicles:
            status.append(_of_vehicle(vehicle))
            status += [_of_receiver(vehicle.name, receiver) for receiver in vehicle.receivers]
        return [ros.Publication(ros.DIAGNOSTICS, stamp, ros.DiagnosticArray(ros.header(stamp, ""), status))]

    def _arrows_of(self, key: tuple[str, str], own: ros.Header, slots: Sequence[ros.ArvaData]) -> list[ros.Marker]:
        """Return an arrow for each slot with a direction. Other arrows are removed."""
        shown = {n: slot for n, slot in enumerate(slots, 1) if geometry.is_direction(slot.direction)}
        gone = sorted(self._arrows.get(key, frozenset()) - shown.keys())
        self._arrows[key] = frozenset(shown)
        arrows = [geometry.field(own, n, slot.id, slot.direction) for n, slot in shown.items()]
        return arrows + geometry.removed(own, geometry.FIELD, gone)


def _placed(there: Transmitters | None) -> list[tuple[int, Array, Array]]:
    """Return id, place NED and rotation of each transmitter with a known place."""
    if there is None:
        return []
    every = zip(there.ids, there.positions, there.rotations, strict=True)
    return [one for one in every if one[0] not in there.unplaced]


def _directions(pose: Pose | None, there: Transmitters | None) -> dict[int, ros.Vector3]:
    """Return the field at the receiver by transmitter id, FLU."""
    if pose is None or there is None or not there.ids:
        return {}
    field = dipole_field(pose.position, there.positions, there.rotations, there.strengths) @ pose.rotation
    every = zip(there.ids, field.tolist(), strict=True)
    return {id_: geometry.body_vector(frd) for id_, frd in every if id_ not in there.unplaced}


def _slot(channel: ChannelReading, directions: dict[int, ros.Vector3]) -> ros.ArvaData:
    id_ = _EMPTY if channel.id is None else channel.id
    direction = directions.get(id_, _NOWHERE) if channel.zone else _NOWHERE  # a blank slot has no signal now
    return ros.ArvaData(id_, float(channel.d_cm), direction, channel.delta_deg, int(channel.zone))


_OK, _WARNING, _STALE = 0, 1, 3
_PROGRAM: Final = "arva-hil"


def _of_vehicle(vehicle: VehicleStatus) -> ros.DiagnosticStatus:
    level, message = (_OK, "received") if vehicle.label else (_WARNING, "no autopilot is received")
    values = [ros.KeyValue(f"{one_line(stream)} [Hz]", f"{rate:.1f}") for stream, rate in vehicle.rates.items()]
    values += [ros.KeyValue(one_line(name), str(count)) for name, count in vehicle.counters]
    return ros.DiagnosticStatus(
        level, one_line(f"{_PROGRAM}: {vehicle.name}"), message, one_line(vehicle.label), values
    )


def _of_receiver(vehicle: str, receiver: ReceiverStatus) -> ros.DiagnosticStatus:
    last = receiver.last
    values = {"frames": str(receiver.frames), "dropped": str(receiver.dropped)}
    level, message = (_OK, "frames are sent") if receiver.frames else (_STALE, "no frame yet")
    if last is not None:
        heard = sum(bool(channel.zone) for channel in last.reading.channels)
        level, message = _OK, f"{heard} heard"
        values["lateness [ms]"] = f"{1e3 * last.late_s:.3f}"
        if last.age_s is not None:
            values["age of the pose [ms]"] = f"{1e3 * last.age_s:.1f}"
        if last.faults:
            values["faults"] = one_line(" ".join(last.faults))
            level, message = _WARNING, f"{heard} received, a fault is active"
        if last.pose is None:
            level, message = _WARNING, "no pose"
    name = one_line(f"{_PROGRAM}: {vehicle}/{receiver.name}")
    return ros.DiagnosticStatus(level, name, message, "", [ros.KeyValue(*value) for value in values.items()])


class LiveMessages:
    """Makes the messages of all events. `scenario`: of the run; None for a search alone.

    `epoch_us`: microseconds since 1970 at the loop's time 0. `searches`: publish the one search that there is.
    `receivers`: (vehicle, receiver); default: the scenario's.
    """

    def __init__(
        self,
        scenario: Scenario | None,
        epoch_us: int,
        *,
        searches: bool,
        receivers: Sequence[tuple[str, str]] | None = None,
    ) -> None:
        self._searches = searches
        self._run = RunMessages(scenario, epoch_us, receivers) if scenario or receivers else None
        self._search = SearchMessages(epoch_us)

    @property
    def topics(self) -> Mapping[str, type[ros.Message]]:
        """All possible topics, with their message types."""
        return {**(self._run.topics if self._run else {}), **(TOPICS if self._searches else {})}

    def of_event(self, event: Event) -> list[ros.Publication]:
        """Return the messages of one event, in their order. Most events have none."""
        if isinstance(event, FromSearch):
            event = event.event
        if isinstance(event, SearchEvent):
            world = self._run.world if self._run else None
            return self._search.of_event(event, world) if self._searches else []
        return self._run.of_event(event) if self._run else []
