"""The messages of a run say what its events say, in ROS's frames; another reader understands them."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.config import DEFAULT, Follows, Lla, Scenario, Transmitter, load
from arva_hil.events import DatumSet, Event, FrameMade, PoseFound, ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.events.searches import BeliefChanged, FrameHeard, FromSearch, PlaceFound, TakeOffPoint
from arva_hil.model.field import LocalFrame, rotation
from arva_hil.model.receiver import ChannelReading, Pose, Zone
from arva_hil.records.reading import load as load_record
from arva_hil.records.ros_messages import geometry
from arva_hil.records.ros_messages.readings import LiveMessages, RunMessages
from arva_hil.records.ros_messages.recorded import messages_of
from arva_hil.records.ros_messages.types import Point, Publication, Quaternion, Vector3, encode, names_of
from firmware_proto import INNER, MID, Channel, Frame
from tests import made_records
from tests.every import every
from tests.files import rows as table
from tests.made_frames import frame_made

from .oracle import read

EPOCH_US = 1_700_000_000_000_000
HOME = (46.0, 7.0, 1650.0)
EMPTY = ChannelReading(None, Zone.OUTER, -1, -1, None)
NORTHWARDS = Pose(np.array([17.0, 5.0, -2.0]), rotation.to_matrix(rotation.from_euler(0, 0, 0)))


def made(pose: Pose | None = NORTHWARDS, *channels: ChannelReading, time_s: float = 1.5, **rest: Any) -> FrameMade:
    channels = channels or (ChannelReading(1, Zone.MID, 361, -12, 3.6), EMPTY)
    values = {"time_s": time_s, "reported_pose": pose} | rest
    return frame_made(0, *channels, instant_s=1.0, pose=pose, late_s=0.5, **values)


def messages(scenario: Scenario = DEFAULT) -> RunMessages:
    made = RunMessages(scenario, EPOCH_US)
    made.of_event(DatumSet(0.0, "vehicle", *HOME, ()))
    return made


def by_topic(publications: list[Publication]) -> dict[str, Any]:
    """What a reader makes of them."""
    return {p.topic: read(encode(p.message), p.message.__msgtype__) for p in publications}


def test_a_reading_has_all_slots_of_its_instant() -> None:
    arva = by_topic(messages().of_event(made()))["/arva"]
    assert arva["header"] == {"stamp": {"sec": 1_700_000_001, "nanosec": 0}, "frame_id": "arva_receiver"}
    first, second = arva["arva_signals"]
    assert (first["id"], first["distance"], first["delta"], first["zone"]) == (1, 361.0, -12, 1)
    assert second == {"id": -1, "distance": -1.0, "direction": {"x": 0, "y": 0, "z": 0}, "delta": -1, "zone": 0}


def test_the_direction_is_the_field_in_the_receivers_frame() -> None:
    """The default's dipole points north, 3 m ahead of the receiver and 2 m below it."""
    direction = by_topic(messages().of_event(made()))["/arva"]["arva_signals"][0]["direction"]
    n, axis = np.array([-3.0, 0.0, -2.0]) / math.sqrt(13), np.array([1.0, 0.0, 0.0])
    field = (3 * (n @ axis) * n - axis) / (4 * math.pi * 13**1.5)
    assert [direction["x"], -direction["y"], -direction["z"]] == pytest.approx(field.tolist(), rel=1e-12)


def test_the_pose_is_told_three_ways() -> None:
    told = by_topic(messages().of_event(made()))
    assert told["/arva/pose"]["header"]["frame_id"] == "map"
    assert told["/arva/pose"]["pose"]["position"] == {"x": 5, "y": 17, "z": 2}
    q = told["/arva/pose"]["pose"]["orientation"]
    assert [abs(q["z"]), abs(q["w"])] == pytest.approx([math.sqrt(0.5)] * 2)  # north is 90° from east
    (own,) = [t for t in told["/tf"]["transforms"] if t["child_frame_id"] == "arva_receiver"]
    assert own["transform"] == {"translation": {"x": 5, "y": 17, "z": 2}, "rotation": q}
    fix = told["/arva/fix"]
    assert fix["latitude"] == pytest.approx(46.0 + 17 / 111_145, abs=2e-7)
    assert fix["altitude"] == pytest.approx(1652.0, abs=1e-3)
    assert "/arva/reported_pose" not in told


def test_what_the_vehicle_reports_is_told_where_it_is_not_the_truth() -> None:
    told = by_topic(messages().of_event(made(reported_pose=Pose(np.array([18.0, 5.0, -2.0]), np.eye(3)))))
    assert told["/arva/reported_pose"]["pose"]["position"] == {"x": 5, "y": 18, "z": 2}
    assert told["/arva/pose"]["pose"]["position"]["y"] == 17


def test_transmitters_dipoles_and_field_are_drawn() -> None:
    shapes = by_topic(messages().of_event(made()))["/arva/visualization"]["markers"]
    assert [(s["ns"], s["id"], s["action"]) for s in shapes] == [
        ("field", 1, 0),
        ("transmitters", 1, 0),
        ("dipoles", 1, 0),
    ]
    assert shapes[1]["pose"]["position"] == {"x": 5, "y": 20, "z": 0}
    start, end = shapes[0]["points"]
    assert math.dist(list(start.values()), list(end.values())) == pytest.approx(1.0)


def test_the_arrow_of_a_slot_that_becomes_empty_is_removed() -> None:
    made_of = messages()
    made_of.of_event(made())
    shapes = by_topic(made_of.of_event(made(NORTHWARDS, EMPTY, EMPTY, time_s=2.5)))["/arva/visualization"]["markers"]
    assert [(s["id"], s["action"]) for s in shapes if s["ns"] == "field"] == [(1, 2)]


def test_shapes_are_drawn_five_times_a_second_and_readings_are_all_told() -> None:
    made_of = messages()
    topics = [p.topic for n in range(50) for p in made_of.of_event(made(time_s=0.5 + n * 0.02))]
    assert topics.count("/arva") == topics.count("/arva/pose") == 50
    assert topics.count("/arva/visualization") == 5


def test_without_a_pose_only_the_reading_and_the_transmitters_are_told() -> None:
    told = by_topic(messages().of_event(made(None, EMPTY)))
    assert sorted(told) == ["/arva", "/arva/visualization", "/tf"]
    assert {s["ns"] for s in told["/arva/visualization"]["markers"]} == {"transmitters", "dipoles"}


def test_without_a_datum_there_are_no_transmitters_and_no_coordinates() -> None:
    told = by_topic(RunMessages(DEFAULT, EPOCH_US).of_event(made()))
    assert "/arva/fix" not in told
    assert told["/arva"]["arva_signals"][0]["direction"] == {"x": 0, "y": 0, "z": 0}


def test_a_datum_that_the_scenario_gives_is_known_from_the_start() -> None:
    told = by_topic(RunMessages(replace(DEFAULT, datum=Lla(*HOME)), EPOCH_US).of_event(made()))
    assert told["/arva/fix"]["latitude"] == pytest.approx(46.0 + 17 / 111_145, abs=2e-7)
    assert {s["ns"] for s in told["/arva/visualization"]["markers"]} == {"field", "transmitters", "dipoles"}


def test_a_slot_that_hears_nothing_for_the_moment_has_its_id_and_no_direction() -> None:
    blank = ChannelReading(1, Zone.OUTER, -1, -1, 3.6)
    (slot,) = by_topic(messages().of_event(made(NORTHWARDS, blank)))["/arva"]["arva_signals"]
    assert slot == {"id": 1, "distance": -1.0, "direction": {"x": 0, "y": 0, "z": 0}, "delta": -1, "zone": 0}


def test_a_transmitter_that_follows_a_vehicle_is_not_drawn_where_it_is_not() -> None:
    follows = Transmitter(id=1, follows=Follows(2))
    told = by_topic(messages(replace(DEFAULT, transmitters=(follows,))).of_event(made()))
    assert told["/arva/visualization"]["markers"] == []
    assert told["/arva"]["arva_signals"][0]["direction"] == {"x": 0, "y": 0, "z": 0}


def test_a_pose_of_nothing_but_nan_breaks_nothing() -> None:
    told = by_topic(messages().of_event(made(Pose(np.full(3, np.nan), np.full((3, 3), np.nan)), EMPTY)))
    assert {s["ns"] for s in told["/arva/visualization"]["markers"]} == {"transmitters", "dipoles"}  # no arrow
    assert told["/arva/pose"]["pose"]["position"]["x"] == "NaN"


def test_a_log_from_before_1970_or_after_2038_has_the_time_0() -> None:
    for time_s in (-2e9, 2e9):
        assert by_topic(messages().of_event(made(time_s=time_s)))["/arva"]["header"]["stamp"]["sec"] == 0


def test_the_status_is_told_once_a_second_with_what_is_wrong() -> None:
    status = VehicleStatus(
        "vehicle", "", {"ATTITUDE": 49.96}, [ReceiverStatus("receiver", made(None), 7, 2)], (("bad_crc", 3),)
    )
    made_of = messages()
    every = [p for n in range(9) for p in made_of.of_event(StatusReport(n / 4, [status]))]
    assert [p.topic for p in every] == ["/diagnostics"] * 3
    vehicle, receiver = read(encode(every[0].message), "diagnostic_msgs/msg/DiagnosticArray")["status"]
    assert (vehicle["level"], vehicle["message"]) == (1, "no autopilot is received")
    assert vehicle["values"] == [{"key": "ATTITUDE [Hz]", "value": "50.0"}, {"key": "bad_crc", "value": "3"}]
    assert (receiver["level"], receiver["message"]) == (1, "no pose")
    assert {"key": "dropped", "value": "2"} in receiver["values"]


def test_names_that_a_message_cannot_hold_are_escaped() -> None:
    status = VehicleStatus("a\0b", "\udcff", {}, [ReceiverStatus("\udcfe", None, 0, 0)])
    (told,) = by_topic(messages().of_event(StatusReport(0.0, [status]))).values()
    assert [one["name"] for one in told["status"]] == ["arva-hil: a\\x00b", "arva-hil: a\\x00b/\\udcfe"]
    assert told["status"][0]["hardware_id"] == "\\udcff"


def test_other_events_and_receivers_of_other_runs_have_no_messages() -> None:
    assert messages().of_event(PoseFound(0.0, "vehicle", "receiver")) == []
    assert messages().of_event(made(vehicle="other", receiver="receiver")) == []


def test_each_of_several_vehicles_has_its_map_and_they_lie_together() -> None:
    made_of = RunMessages(load("configs/two_vehicles.yaml"), EPOCH_US)
    for vehicle, lat in (("alpha", 46.0), ("bravo", 46.001)):
        made_of.of_event(DatumSet(0.0, vehicle, lat, 7.0, 1650.0, ()))
    told = by_topic(made_of.of_event(made(vehicle="bravo", receiver="only")))
    assert told["/bravo/only/arva"]["header"]["frame_id"] == "bravo/only/arva_receiver"
    assert told["/bravo/only/arva/pose"]["header"]["frame_id"] == "bravo/map"
    (map_,) = [t for t in told["/tf"]["transforms"] if t["child_frame_id"] == "bravo/map"]
    assert map_["header"]["frame_id"] == "map"
    assert map_["transform"]["translation"]["y"] == pytest.approx(111.2, abs=0.1)
    told = by_topic(made_of.of_event(made(vehicle="alpha", receiver="front")))
    (map_,) = [t for t in told["/tf"]["transforms"] if t["child_frame_id"] == "alpha/map"]
    assert map_["transform"]["translation"] == pytest.approx({"x": 0, "y": 0, "z": 0}, abs=1e-6)


def test_names_that_ros_does_not_allow_are_changed_and_stay_different() -> None:
    every = names_of([("7-up", "a-b"), ("7-up", "a.b"), ("7_up", "a_b")]).values()
    assert [names.arva for names in every] == ["/_7_up/a_b/arva", "/_7_up/a_b_2/arva", "/_7_up_2/a_b/arva"]


# -- north, east, down and forward, right, down become ROS's frames: east, north, up and forward, left, up -----


NED_TO_ENU = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
FLU_TO_FRD = np.diag([1, -1, -1])
ANGLES = st.floats(-math.pi, math.pi)


def matrix(q: Quaternion) -> np.ndarray:
    return rotation.to_matrix([q.w, q.x, q.y, q.z])


def test_places_and_vectors() -> None:
    assert geometry.point([20.0, 5.0, -3.0]) == Point(5.0, 20.0, 3.0)
    assert geometry.body_vector([1.0, 2.0, 3.0]) == Vector3(1.0, -2.0, -3.0)


@every("heading, yaw", [(0, 90), (90, 0), (180, -90), (-90, 180), (30, 60)])
def test_a_level_vehicle_heading_north_has_the_yaw_90_of_ros(heading: float, yaw: float) -> None:
    turned = matrix(geometry.orientation(rotation.to_matrix(rotation.from_euler(0, 0, math.radians(heading)))))
    forward = [math.cos(math.radians(yaw)), math.sin(math.radians(yaw)), 0]
    assert turned @ [1, 0, 0] == pytest.approx(forward, abs=1e-12)
    assert turned @ [0, 0, 1] == pytest.approx([0, 0, 1], abs=1e-12)  # up is up


@given(ANGLES, st.floats(-math.pi / 2, math.pi / 2), ANGLES)
def test_an_orientation_turns_every_vector_as_before(roll: float, pitch: float, yaw: float) -> None:
    frd_to_ned = rotation.to_matrix(rotation.from_euler(roll, pitch, yaw))
    flu_to_enu = matrix(geometry.orientation(frd_to_ned))
    assert flu_to_enu == pytest.approx(NED_TO_ENU @ frd_to_ned @ FLU_TO_FRD, abs=1e-9)


def test_the_map_of_one_vehicle_lies_in_that_of_another_as_their_datums_do() -> None:
    world, own = LocalFrame(46.0, 7.0, 1650.0), LocalFrame(46.01, 7.02, 1700.0)
    there = geometry.between(world, own)
    place = [12.0, -7.0, -30.0]  # in the other's NED
    north, east, down = world.ned(*own.lla(place)).tolist()
    at = there.translation
    shown = matrix(there.rotation) @ (NED_TO_ENU @ place) + [at.x, at.y, at.z]
    assert shown == pytest.approx([east, north, -down], abs=1e-6)


# -- the messages of a search say what it hears and believes, ENU from the take-off point ----------------------


FRAME = Frame(7, 1, (Channel(4, MID, 2000, 10), Channel(None, MID, 2500, -40), Channel(9, INNER, 80, 0), Channel()))
HEARD = FrameHeard(2.0, FRAME, (3.0, -4.0, -5.0), 90.0)
FOUND = PlaceFound(9.0, 4, 20.0, 5.0, (0.04, 0.0, 0.01), True, earth_covariance=(0.04, 0.0, 0.01))


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


@every("bearing_deg", [0, 30, 90, 150])
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


@pytest.mark.parametrize(("down_m", "height_m"), [(1.5, -1.5), (None, 0.0), (math.inf, 0.0)])
def test_the_height_of_the_place_is_told_where_the_search_knows_it(down_m: float | None, height_m: float) -> None:
    said = told(TakeOffPoint(0.0, *HOME), replace(FOUND, down_m=down_m))
    assert said["/search/found"]["altitude"] == pytest.approx(HOME[2] + height_m, abs=1e-3)
    assert {s["pose"]["position"]["z"] for s in said["/search/visualization"]["markers"]} == {height_m}


def test_a_strategy_that_knows_no_covariance_has_no_ellipse() -> None:
    said = told(TakeOffPoint(0.0, *HOME), PlaceFound(9.0, 4, 20.0, 5.0, None, True))
    assert [s["ns"] for s in said["/search/visualization"]["markers"]] == ["found"]
    assert said["/search/found"]["position_covariance_type"] == 0


def test_searches_of_several_take_off_points_are_left_out() -> None:
    messages = LiveMessages(DEFAULT, EPOCH_US, searches=False)
    assert not [topic for topic in messages.topics if topic.startswith("/search")]
    for n, name in enumerate(("one", "two")):
        assert messages.of_event(FromSearch(1.0, TakeOffPoint(1.0, 46.0 + n, 7.0, 1650.0), name)) == []
    assert messages.of_event(FromSearch(9.0, FOUND, "one")) == []


# -- a record gives the messages that its run published --------------------------------------------------------


def numbers(value: Any) -> Any:
    """A message without its times, for pytest.approx: all its numbers and texts, in their order."""
    if isinstance(value, dict):
        return [one for name, part in value.items() if name != "stamp" for one in numbers(part)]
    if isinstance(value, list):
        return [one for part in value for one in numbers(part)]
    return [value]


def of(topic: str, publications: list[Publication]) -> list[Publication]:
    return [publication for publication in publications if publication.topic == topic]


def test_the_messages_are_those_of_the_live_run(tmp_path: Path) -> None:
    live = RunMessages(DEFAULT, made_records.EPOCH_US)
    live.of_event(DatumSet(made_records.START_S, "vehicle", *made_records.HOME, ()))
    published = [p for made in made_records.frames(DEFAULT, 30) for p in live.of_event(made)]
    replayed = list(messages_of(load_record(made_records.write(tmp_path / "run"))))
    for topic in ("/arva", "/arva/pose", "/arva/fix", "/arva/visualization"):
        before, after = of(topic, published), of(topic, replayed)
        assert len(before) == len(after) > 20
        for one, other in zip(before, after, strict=True):
            assert other.stamp_ns == pytest.approx(one.stamp_ns, abs=1_000_000)  # the table has milliseconds
            said, expected = numbers(list(by_topic([other]).values())), numbers(list(by_topic([one]).values()))
            assert [v for v in said if isinstance(v, str)] == [v for v in expected if isinstance(v, str)]
            floats = [[v for v in every if not isinstance(v, str)] for every in (said, expected)]
            assert floats[0] == pytest.approx(floats[1], rel=1e-9, abs=1e-9)


def test_the_messages_come_in_the_order_of_their_times_whatever_they_are_of(tmp_path: Path) -> None:
    every = list(messages_of(load_record(made_records.write(tmp_path / "run"))))
    stamps = [publication.stamp_ns for publication in every]
    assert stamps == sorted(stamps)
    assert {p.topic for p in every} >= {"/arva", "/diagnostics", "/search/arva", "/search/pose", "/search/found"}


def test_every_victim_of_a_search_is_there_from_its_time_on(tmp_path: Path) -> None:
    victims = [
        {"id": n, "north": n, "east": 0.0, "down": n / 2, "time_s": 4.0 - 1.5 * n} for n in (1, 2)
    ]  # of the take-off, after 1 s
    every = list(messages_of(load_record(made_records.write_search(tmp_path, victims=victims))))
    began_ns = min(publication.stamp_ns for publication in every)
    told = [
        (p.stamp_ns - began_ns, *by_topic([p])["/search/visualization"]["markers"]) for p in every if "vis" in p.topic
    ]
    shown = [(ns / 1e9, *(marker["pose"]["position"][axis] for axis in "yz")) for ns, marker in told]
    assert shown == [(2.0, 2.0, -1.0), (3.0, 2.0, -1.0), (3.5, 1.0, -0.5), (5.0, 1.0, -0.5)]


def test_several_receivers_have_their_topics(tmp_path: Path) -> None:
    scenario = load("configs/two_vehicles.yaml")
    names = [("alpha", "front"), ("alpha", "rear"), ("bravo", "only")]
    every = list(
        messages_of(load_record(made_records.write(tmp_path / "run", 9, scenario, receivers=names, search=False)))
    )
    for vehicle, receiver in names:
        readings = of(f"/{vehicle}/{receiver}/arva", every)
        assert len(readings) == 9


def test_what_the_vehicle_reported_is_there_where_it_differs(tmp_path: Path) -> None:
    folder = made_records.write(tmp_path / "run", search=False)
    path = folder / "readings.csv"
    rows = table(path)
    for row in rows:
        if row["reported_north_m"]:
            row["reported_north_m"] = repr(float(row["north_m"]) + 1.0)
    with path.open("w") as file:
        out = csv.DictWriter(file, rows[0])
        out.writeheader()
        out.writerows(rows)
    every = list(messages_of(load_record(folder)))
    poses, reported = of("/arva/pose", every), of("/arva/reported_pose", every)
    assert len(poses) == len(reported) == 27
    for true, other in zip(poses, reported, strict=True):
        (at,), (there,) = by_topic([true]).values(), by_topic([other]).values()
        assert there["pose"]["position"]["y"] == pytest.approx(at["pose"]["position"]["y"] + 1.0)


def test_a_run_without_a_frame_and_one_that_was_killed_and_a_search_alone_have_what_there_is(tmp_path: Path) -> None:
    assert of("/arva", list(messages_of(load_record(made_records.write(tmp_path / "none", 0, search=False))))) == []
    killed = made_records.write(tmp_path / "killed", 1, ended=False)
    assert len(of("/arva", list(messages_of(load_record(killed))))) == 1
    (tmp_path / "search").mkdir()
    alone = list(messages_of(load_record(made_records.write_search(tmp_path / "search"))))
    assert {p.topic for p in alone} == {"/tf", "/search/arva", "/search/pose", "/search/fix", "/search/found"} | {
        "/search/visualization"
    }
