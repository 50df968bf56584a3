"""The messages of a record: the same that its run could have published, in the order of their times."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.events import DatumSet, Event, FrameMade
from arva_hil.events.searches import FrameHeard, PlaceFound, TakeOffPoint
from arva_hil.model.field import rotation
from arva_hil.model.receiver import ChannelReading, Pose, Reading
from arva_hil.records.reading import NO_ID, RecordedReceiver, RecordedSearch, Recording
from arva_hil.records.ros_messages.readings import LiveMessages
from arva_hil.records.ros_messages.types import Publication
from firmware_proto import Channel, Frame

_BATCH: Final = 4096  # frames that are converted at once


def messages_of(recording: Recording) -> Iterator[Publication]:
    """Yield the messages of all readings. Times are from 1970, or from 0 if the date is not known.

    A record has no reported attitude: a reported pose has the true one.
    """
    epoch_us = round((recording.start_utc_s or 0.0) * 1e6)
    names = [(receiver.vehicle, receiver.receiver) for receiver in recording.receivers]
    made = LiveMessages(recording.scenario, epoch_us, searches=True, receivers=names)
    parts: list[Iterator[Event]] = [_of_receiver(receiver) for receiver in recording.receivers]
    parts.append(iter(recording.status))
    if recording.search:
        parts += [_of_search(recording.search), _places(recording.search)]
    for event in heapq.merge(_datums(recording), *parts, key=lambda event: event.time_s):
        yield from made.of_event(event)


def _datums(recording: Recording) -> list[Event]:
    """Return the changes of all datums. The first of a vehicle is its datum from the start."""
    every = [
        DatumSet(datum.time_s if n else -math.inf, vehicle, datum.lat, datum.lon, datum.alt, ())
        for vehicle, datums in recording.datums.items()
        for n, datum in enumerate(datums)
    ]
    return sorted(every, key=lambda event: event.time_s)


def _of_receiver(receiver: RecordedReceiver) -> Iterator[Event]:
    """Yield the frames, with their instants, poses and slots alone."""
    for first in range(0, len(receiver), _BATCH):
        rows = slice(first, first + _BATCH)
        position, reported, attitude = receiver.position[rows], receiver.reported[rows], receiver.attitude_deg[rows]
        there = _whole(position) & _whole(attitude)
        matrices = rotation.to_matrix(rotation.from_euler(*np.radians(np.where(there[:, None], attitude, 0.0)).T))
        differs = there & _whole(reported) & (reported != position).any(axis=1)
        for n, time_s in enumerate(receiver.time_s[rows].tolist()):
            channels = tuple(
                ChannelReading(None if id_ == NO_ID else id_, zone, d_cm, delta_deg, None)
                for id_, zone, d_cm, delta_deg, _ in receiver.slots(first + n)
            )
            yield FrameMade(
                time_s,
                receiver.vehicle,
                receiver.receiver,
                first + n,
                time_s,
                None,
                Pose(position[n], matrices[n]) if there[n] else None,
                None,
                Reading(channels, False, False),
                Frame(0, 0, ()),
                True,
                0.0,
                (),
                Pose(reported[n], matrices[n]) if differs[n] else None,
            )


def _whole(rows: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the rows without missing values."""
    return np.asarray(np.isfinite(rows).all(axis=1))


def _of_search(search: RecordedSearch) -> Iterator[Event]:
    """Yield the steps with a frame."""
    times = (search.time_s + search.start_s).tolist()
    if search.origin:
        yield TakeOffPoint(times[0] if times else 0.0, *search.origin)
    readings = np.stack([search.d_cm, search.delta_deg, search.zone], axis=-1)
    fits = (np.abs(readings) < 1 << 31).all(axis=1) & (search.zone >= 0) & (search.zone < 256)  # their fields
    for n in np.flatnonzero(fits).tolist():
        d_cm, delta_deg, zone = (int(value) for value in readings[n])
        id_ = int(search.id[n]) if abs(search.id[n]) < 1 << 31 else None
        channel = Channel(id_, zone, d_cm, delta_deg)
        north, east, down, heading_deg = every = [*search.position[n].tolist(), float(search.heading_deg[n])]
        known = all(map(math.isfinite, every))
        place = (north, east, down) if known else None
        yield FrameHeard(times[n], Frame(0, 0, (channel,)), place, heading_deg if known else None)


def _places(search: RecordedSearch) -> Iterator[Event]:
    """Yield each place found at its time; one without a time at the last step."""
    times = search.time_s + search.start_s
    flown = times[search.flying]
    for found in search.places if len(times) else ():
        time_s = times[-1]
        if found.time_s is not None and len(flown):
            time_s = min(time_s, flown[0] + found.time_s)
        yield PlaceFound(
            float(time_s),
            found.id,
            found.north,
            found.east,
            found.covariance,
            found.sure,
            found.relative_covariance,
            found.earth_covariance,
            found.autopilot_sigma_m,
            found.down,
        )
