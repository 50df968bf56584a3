"""The messages of a search: frames received, poses, estimates, and the place found.

The frame `takeoff` is ENU with its origin at the take-off point.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from arva_hil.events import Event
from arva_hil.events.searches import BeliefChanged, FrameHeard, PlaceFound, TakeOffPoint
from arva_hil.model.field import LocalFrame, rotation
from arva_hil.records.ros_messages import geometry
from arva_hil.records.ros_messages import types as ros
from firmware_proto import MID, Channel

TAKE_OFF: Final = "takeoff"
RECEIVER: Final = "search_receiver"
ARVA: Final = "/search/arva"
POSE: Final = "/search/pose"
FIX: Final = "/search/fix"
FOUND: Final = "/search/found"
VISUALIZATION: Final = "/search/visualization"
TOPICS: Final[Mapping[str, type[ros.Message]]] = {
    ros.TF: ros.TFMessage,
    ARVA: ros.Arva,
    POSE: ros.PoseStamped,
    FIX: ros.NavSatFix,
    FOUND: ros.NavSatFix,
    VISUALIZATION: ros.MarkerArray,
}

_EMPTY, _NO_ID = -1, -2
_AGAIN_S: Final = 1.0  # the place found is published again, for later subscribers
_HEIGHT_VARIANCE: Final = 1e4  # m²: for an unknown height
_HYPOTHESIS_M: Final = 1.5  # the size of a hypothesis with a share of 1
_FOUND_M: Final = 0.6


class SearchMessages:
    """Makes the messages of a search's events. Remembers the take-off point, the shapes, and the place found.

    `epoch_us`: microseconds since 1970 at the loop's time 0.
    """

    def __init__(self, epoch_us: int) -> None:
        self._epoch_us = epoch_us
        self._origin: LocalFrame | None = None
        self._drawn = 0  # hypotheses
        self._found: PlaceFound | None = None
        self._told_s = -math.inf

    def of_event(self, event: Event, world: LocalFrame | None = None) -> list[ros.Publication]:
        """Return the messages of one event.

        Most events have none. `world`: the datum of the frame `map`, if there is one.
        """
        stamp = ros.stamp_of(self._epoch_us, event.time_s)
        if isinstance(event, TakeOffPoint):
            self._origin = LocalFrame(event.lat, event.lon, event.alt)
        elif isinstance(event, FrameHeard):
            told = self._heard(event, stamp, world)
            return told + (self._again(event.time_s, stamp) if self._found else [])
        elif isinstance(event, BeliefChanged):
            shapes = self._believed(event, ros.header(stamp, TAKE_OFF))
            return [ros.Publication(VISUALIZATION, stamp, ros.MarkerArray(shapes))]
        elif isinstance(event, PlaceFound):
            self._found, self._told_s = event, -math.inf  # at once
            return self._again(event.time_s, stamp)
        return []

    def _heard(self, event: FrameHeard, stamp: int, world: LocalFrame | None) -> list[ros.Publication]:
        own, ground = ros.header(stamp, RECEIVER), ros.header(stamp, TAKE_OFF)
        made = [ros.Publication(ARVA, stamp, ros.Arva(own, [_slot(channel) for channel in event.frame.channels]))]
        transforms = []
        if event.position is not None and event.heading_deg is not None:
            level = rotation.to_matrix(rotation.from_euler(0.0, 0.0, math.radians(event.heading_deg)))
            pose = geometry.pose(event.position, level)
            made.append(ros.Publication(POSE, stamp, ros.PoseStamped(ground, pose)))
            transforms.append(ros.TransformStamped(ground, RECEIVER, geometry.transform(pose)))
            if self._origin:
                made.append(ros.Publication(FIX, stamp, self._fix(own, event.position, None)))
        if world and self._origin:
            there = geometry.between(world, self._origin)
            transforms.append(ros.TransformStamped(ros.header(stamp, ros.MAP), TAKE_OFF, there))
        return [ros.Publication(ros.TF, stamp, ros.TFMessage(transforms)), *made] if transforms else made

    def _believed(self, event: BeliefChanged, ground: ros.Header) -> list[ros.Marker]:
        every = event.hypotheses
        shapes = [
            geometry.sphere(
                ground, "hypotheses", n, geometry.point((north, east, 0.0)), _HYPOTHESIS_M * share**0.5, 0.6
            )
            for n, (north, east, share) in enumerate(every)
        ]
        shapes += geometry.removed(ground, "hypotheses", range(len(every), self._drawn))
        self._drawn = len(every)
        if event.covariance is not None and every:
            north, east = (sum(one[axis] * one[2] for one in every) for axis in (0, 1))
            shapes.append(geometry.ellipse(ground, "95 %", geometry.point((north, east, 0.0)), event.covariance))
        if event.goal is not None:
            shapes.append(geometry.sphere(ground, "goal", 0, geometry.point((*event.goal, 0.0)), 0.3))
        return shapes

    def _again(self, now: float, stamp: int) -> list[ros.Publication]:
        """Return the place found, at most once a second."""
        found = self._found
        if found is None or now - self._told_s < _AGAIN_S:
            return []
        self._told_s = now
        down_m = found.down_m if found.down_m is not None and math.isfinite(found.down_m) else 0.0
        ground, place = ros.header(stamp, TAKE_OFF), (found.north_m, found.east_m, down_m)
        shapes = [geometry.sphere(ground, "found", 0, geometry.point(place), _FOUND_M)]
        if found.covariance is not None:
            shapes.append(geometry.ellipse(ground, "95 %", geometry.point(place), found.covariance))
        made = [ros.Publication(VISUALIZATION, stamp, ros.MarkerArray(shapes))]
        if self._origin:
            made.append(ros.Publication(FOUND, stamp, self._fix(ground, place, found.earth_covariance)))
        return made

    def _fix(
        self, of: ros.Header, place: tuple[float, float, float], covariance: tuple[float, float, float] | None
    ) -> ros.NavSatFix:
        assert self._origin is not None
        lat, lon, alt = map(float, self._origin.lla(place))
        nn, ne, ee = covariance or (0.0, 0.0, 0.0)
        known = np.array([ee, ne, 0.0, ne, nn, 0.0, 0.0, 0.0, _HEIGHT_VARIANCE if covariance else 0.0])
        return ros.NavSatFix(of, ros.NavSatStatus(0, 1), lat, lon, alt, known, 3 if covariance else 0)


def _slot(channel: Channel) -> ros.ArvaData:
    """Return a slot of a frame. Its direction is that of δ, with length 1."""
    id_ = _NO_ID if channel.id is None else channel.id
    id_ = id_ if channel.valid else _EMPTY
    delta = math.radians(channel.delta)
    known = channel.valid and channel.zone == MID
    direction = ros.Vector3(math.cos(delta), -math.sin(delta), 0.0) if known else ros.Vector3(0.0, 0.0, 0.0)
    return ros.ArvaData(id_, float(channel.d), direction, channel.delta, int(channel.zone))
