"""The messages of a search say what it hears and believes, ENU from the take-off point."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from arva_hil.config import DEFAULT
from arva_hil.events import DatumSet, Event
from arva_hil.events.searches import BeliefChanged, FrameHeard, FromSearch, PlaceFound, TakeOffPoint
from arva_hil.records.ros_messages.live import LiveMessages
from firmware_proto import INNER, MID, Channel, Frame

from .test_readings import EPOCH_US, HOME, by_topic

FRAME = Frame(7, 1, (Channel(4, MID, 2000, 10), Channel(None, MID, 2500, -40), Channel(9, INNER, 80, 0), Channel()))
HEARD = FrameHeard(2.0, FRAME, (3.0, -4.0, -5.0), 90.0)
FOUND = PlaceFound(9.0, 4, 20.0, 5.0, (0.04, 0.0, 0.01), True)


def told(*events: Event) -> dict[str, Any]:
    """What the last event's messages say."""
    messages = LiveMessages(None, EPOCH_US, searches=True)
    for event in events[:-1]:
        messages.of_event(event)
    return by_topic(messages.of_event(events[-1]))


def test_each_channel_is_told_as_it_was_read() -> None:
    slots = told(HEARD)["/search/arva"]["arva_signals"]
    assert [(s["id"], s["distance"], s["delta"], s["zone"]) for s in slots] == [
        (4, 2000.0, 10, 1),
        (-2, 2500.0, -40, 1),  # the frames have no ids
        (9, 80.0, 0, 2),
        (-1, -1.0, -1, 0),
    ]
    ten = math.radians(10)
    assert slots[0]["direction"] == {"x": math.cos(ten), "y": -math.sin(ten), "z": 0}  # to the right is −y
    assert [s["direction"]["x"] for s in slots[2:]] == [0, 0]  # in the inner zone δ says nothing


def test_the_receivers_place_is_told_from_the_take_off_point_and_on_earth() -> None:
    said = told(TakeOffPoint(0.0, *HOME), HEARD)
    assert said["/search/pose"]["header"]["frame_id"] == "takeoff"
    assert said["/search/pose"]["pose"]["position"] == {"x": -4, "y": 3, "z": 5}
    assert abs(said["/search/pose"]["pose"]["orientation"]["w"]) == pytest.approx(1.0)  # heading east
    assert said["/search/fix"]["altitude"] == pytest.approx(1655.0, abs=1e-3)
    assert [t["child_frame_id"] for t in said["/tf"]["transforms"]] == ["search_receiver"]


def test_without_a_place_only_the_reading_is_told() -> None:
    assert list(told(FrameHeard(2.0, FRAME, None, None))) == ["/search/arva"]


def test_beside_an_emulator_the_take_off_point_lies_in_its_map() -> None:
    messages = LiveMessages(DEFAULT, EPOCH_US, searches=True)
    messages.of_event(DatumSet(0.0, "vehicle", *HOME, ()))
    messages.of_event(FromSearch(1.0, TakeOffPoint(1.0, 46.001, 7.0, 1650.0)))
    said = by_topic(messages.of_event(FromSearch(2.0, HEARD)))
    (there,) = [t for t in said["/tf"]["transforms"] if t["child_frame_id"] == "takeoff"]
    assert there["header"]["frame_id"] == "map"
    assert there["transform"]["translation"]["y"] == pytest.approx(111.2, abs=0.1)

    found = by_topic(messages.of_event(FromSearch(9.0, FOUND)))["/search/visualization"]["markers"][0]
    assert (found["ns"], found["pose"]["position"]) == ("found", {"x": 5, "y": 20, "z": 0})


def test_hypotheses_their_ellipse_and_the_goal_are_drawn_and_those_that_are_dropped_go() -> None:
    many = BeliefChanged(2.0, 4, [(20.0, 5.0, 0.75), (-20.0, -5.0, 0.25)], (9.0, 0.0, 1.0), (10.0, 0.0))
    shapes = told(many)["/search/visualization"]["markers"]
    assert [(s["ns"], s["id"], s["action"]) for s in shapes] == [
        ("hypotheses", 0, 0),
        ("hypotheses", 1, 0),
        ("95 %", 0, 0),
        ("goal", 0, 0),
    ]
    assert shapes[0]["pose"]["position"] == {"x": 5, "y": 20, "z": 0}
    assert shapes[2]["pose"]["position"] == {"x": 2.5, "y": 10, "z": 0}  # the average
    one = BeliefChanged(3.0, 4, [(20.0, 5.0, 1.0)], None, None)
    shapes = told(many, one)["/search/visualization"]["markers"]
    assert [(s["ns"], s["id"], s["action"]) for s in shapes] == [("hypotheses", 0, 0), ("hypotheses", 1, 2)]


@pytest.mark.parametrize("bearing_deg", [0, 30, 90, 150])
def test_the_ellipse_has_the_long_axis_of_the_covariance_and_95_percent(bearing_deg: float) -> None:
    along = np.array([math.cos(math.radians(bearing_deg)), math.sin(math.radians(bearing_deg))])  # north, east
    matrix = 9.0 * np.outer(along, along) + 1.0 * (np.eye(2) - np.outer(along, along))
    covariance = (float(matrix[0, 0]), float(matrix[0, 1]), float(matrix[1, 1]))
    belief = BeliefChanged(2.0, 4, [(0.0, 0.0, 1.0)], covariance, None)
    ellipse = told(belief)["/search/visualization"]["markers"][1]
    assert (ellipse["scale"]["x"], ellipse["scale"]["y"]) == pytest.approx((2 * 3 * 2.4477, 2 * 1 * 2.4477), rel=1e-4)
    q = ellipse["pose"]["orientation"]
    yaw = 2 * math.atan2(q["z"], q["w"])
    assert abs(math.cos(yaw) * along[1] + math.sin(yaw) * along[0]) == pytest.approx(1.0)


def test_the_place_found_is_told_on_earth_with_its_covariance_and_again_for_those_who_come_late() -> None:
    messages = LiveMessages(None, EPOCH_US, searches=True)
    messages.of_event(TakeOffPoint(0.0, *HOME))
    said = by_topic(messages.of_event(FOUND))
    assert said["/search/found"]["latitude"] == pytest.approx(46.0 + 20 / 111_145, abs=2e-7)
    assert said["/search/found"]["position_covariance"][:5] == [0.01, 0, 0, 0, 0.04]  # east first
    assert said["/search/visualization"]["markers"][0]["pose"]["position"] == {"x": 5, "y": 20, "z": 0}
    times = [n / 10 for n in range(91, 120)]
    later = [by_topic(messages.of_event(FrameHeard(t, FRAME, None, None))) for t in times]
    assert [t for t, one in zip(times, later, strict=True) if "/search/found" in one] == [10.0, 11.0]


def test_a_strategy_that_knows_no_covariance_has_no_ellipse() -> None:
    said = told(TakeOffPoint(0.0, *HOME), PlaceFound(9.0, 4, 20.0, 5.0, None, True))
    assert [s["ns"] for s in said["/search/visualization"]["markers"]] == ["found"]
    assert said["/search/found"]["position_covariance_type"] == 0
