"""The messages of a record: the same that its run could have published, in the order of their times."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.events import ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.events.searches import FrameHeard, PlaceFound, TakeOffPoint
from arva_hil.model.field import rotation
from arva_hil.model.receiver import Pose
from arva_hil.model.receiver.reading import ChannelReading
from arva_hil.records.reading import RecordedReceiver, RecordedSearch, Recording
from arva_hil.records.reading.lines import mapping, number, text
from arva_hil.records.reading.recording import NO_ID
from arva_hil.records.ros_messages.readings import RunMessages, Taken
from arva_hil.records.ros_messages.searches import SearchMessages
from arva_hil.records.ros_messages.types import Publication, stamp_of
from firmware_proto import Channel, Frame

_BATCH: Final = 4096  # frames that are converted at once


def messages_of(recording: Recording) -> Iterator[Publication]:
    """Yield the messages of all readings. Times are from 1970, or from 0 if the date is not known.

    A record has no reported attitude: a reported pose has the true one.
    """
    epoch_us = round((recording.start_utc_s or 0.0) * 1e6)
    scenario = recording.run.scenario if recording.run else None
    run = RunMessages(scenario, epoch_us, [(r.vehicle, r.receiver) for r in recording.receivers])
    parts = [_of_receiver(recording, receiver, run, epoch_us) for receiver in recording.receivers]
    parts.append(_of_status(recording, run))
    if recording.search:
        parts.append(_of_search(recording.search, run, epoch_us))
    return heapq.merge(*parts, key=lambda publication: publication.stamp_ns)


def _of_receiver(
    recording: Recording, receiver: RecordedReceiver, run: RunMessages, epoch_us: int
) -> Iterator[Publication]:
    names, placed = (receiver.vehicle, receiver.receiver), None
    for first in range(0, len(receiver), _BATCH):
        for time_s, pose, reported, channels in _readings(receiver, slice(first, first + _BATCH)):
            datum = recording.datum_at(receiver.vehicle, time_s)
            if datum is not None and datum is not placed:
                run.place(receiver.vehicle, (datum.lat, datum.lon, datum.alt))
                placed = datum
            stamp = stamp_of(epoch_us, time_s)
            yield from run.of_reading(Taken(*names, stamp, time_s, pose, reported, channels))


def _readings(
    receiver: RecordedReceiver, rows: slice
) -> Iterator[tuple[float, Pose | None, Pose | None, Sequence[ChannelReading]]]:
    """Yield time, pose, reported pose and slots of some rows."""
    position, reported, attitude = receiver.position[rows], receiver.reported[rows], receiver.attitude_deg[rows]
    there = _whole(position) & _whole(attitude)
    matrices = rotation.to_matrix(rotation.from_euler(*np.radians(np.where(there[:, None], attitude, 0.0)).T))
    differs = there & _whole(reported) & ~_same(reported, position)
    columns = (receiver.id, receiver.zone, receiver.d_cm, receiver.delta_deg)
    every = zip(receiver.time_s[rows].tolist(), there.tolist(), differs.tolist(), strict=True)
    for n, (time_s, known, apart) in enumerate(every):
        of_frame = receiver.rows(rows.start + n)
        pose = Pose(position[n], matrices[n]) if known else None
        other = Pose(reported[n], matrices[n]) if apart else None
        channels = [
            ChannelReading(None if id_ == NO_ID else id_, zone, d_cm, delta_deg, None)
            for id_, zone, d_cm, delta_deg in zip(*(column[of_frame].tolist() for column in columns), strict=True)
        ]
        yield time_s, pose, other, channels


def _whole(rows: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the rows without missing values."""
    return np.asarray(np.isfinite(rows).all(axis=1))


def _same(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the rows that are equal."""
    return np.asarray(np.equal(a, b).all(axis=1))


def _of_status(recording: Recording, run: RunMessages) -> Iterator[Publication]:
    for said in recording.status:
        yield from run.of_event(StatusReport(said["time_s"], [_vehicle(one) for one in _list(said, "vehicles")]))


def _vehicle(said: Mapping[str, Any]) -> VehicleStatus:
    rates = {name: rate for name, value in mapping(said.get("rates")).items() if (rate := number(value)) is not None}
    receivers = [
        ReceiverStatus(text(one.get("name")), None, _count(one, "frames"), _count(one, "dropped"))
        for one in _list(said, "receivers")
    ]
    return VehicleStatus(text(said.get("name")), text(said.get("label")), rates, receivers)


def _of_search(search: RecordedSearch, run: RunMessages, epoch_us: int) -> Iterator[Publication]:
    """Yield messages of the steps with a frame, and of the place found at the last step."""
    made, times = SearchMessages(epoch_us), (search.time_s + search.start_s).tolist()
    if search.origin:
        made.of_event(TakeOffPoint(times[0] if times else 0.0, *search.origin))
    readings = np.stack([search.d_cm, search.delta_deg, search.zone], axis=-1)
    known = np.isfinite(readings).all(axis=1)
    for n in np.flatnonzero(known).tolist():
        d_cm, delta_deg, zone = (int(value) for value in readings[n])
        channel = Channel(None if math.isnan(search.id[n]) else int(search.id[n]), zone, d_cm, delta_deg)
        north, east, down = search.position[n].tolist()
        place = (north, east, down) if np.isfinite(search.position[n]).all() else None
        heard = FrameHeard(times[n], Frame(0, 0, (channel,)), place, float(search.heading_deg[n]) if place else None)
        yield from made.of_event(heard, run.world)
    if (found := search.found) is not None and times:
        spread = found.covariance, True, found.relative_covariance, found.earth_covariance
        place_found = PlaceFound(times[-1], search.target, found.north, found.east, *spread)
        yield from made.of_event(place_found, run.world)


def _list(said: Mapping[str, Any], name: str) -> list[Mapping[str, Any]]:
    every = said.get(name)
    return [mapping(one) for one in every] if isinstance(every, list) else []


def _count(said: Mapping[str, Any], name: str) -> int:
    return int(number(said.get(name)) or 0)
