"""The messages of a run say what its events say, in ROS's frames; another reader understands them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from arva_hil.config import DEFAULT, Follows, Lla, Scenario, Transmitter, load
from arva_hil.emulator.receivers import frame_of
from arva_hil.events import DatumSet, FrameMade, PoseFound, ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.model.field import rotation
from arva_hil.model.receiver import ChannelReading, Pose, Reading, Zone
from arva_hil.records.ros_messages.readings import RunMessages
from arva_hil.records.ros_messages.types import Publication, encode, names_of

from .oracle import read

EPOCH_US = 1_700_000_000_000_000
HOME = (46.0, 7.0, 1650.0)
EMPTY = ChannelReading(None, Zone.OUTER, -1, -1, None)
NORTHWARDS = Pose(np.array([17.0, 5.0, -2.0]), rotation.to_matrix(rotation.from_euler(0, 0, 0)))


def made(pose: Pose | None = NORTHWARDS, *channels: ChannelReading, time_s: float = 1.5, **rest: Any) -> FrameMade:
    reading = Reading(channels or (ChannelReading(1, Zone.MID, 361, -12, 3.6), EMPTY), False, False)
    values = {"reported_pose": pose} | rest
    return FrameMade(
        time_s, "vehicle", "receiver", 0, 1.0, None, pose, None, reading, frame_of(reading, 0), True, 0.5, **values
    )


def messages(scenario: Scenario = DEFAULT) -> RunMessages:
    made = RunMessages(scenario, EPOCH_US)
    made.place("vehicle", HOME)
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
    r = np.array([-3.0, 0.0, -2.0])
    n, axis = r / math.sqrt(13), np.array([1.0, 0.0, 0.0])
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
    reported = Pose(np.array([18.0, 5.0, -2.0]), np.eye(3))
    told = by_topic(messages().of_event(made(reported_pose=reported)))
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
    nothing = Pose(np.full(3, np.nan), np.full((3, 3), np.nan))
    told = by_topic(messages().of_event(made(nothing, EMPTY)))
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


def named(event: FrameMade, vehicle: str, receiver: str) -> FrameMade:
    values = {name: getattr(event, name) for name in FrameMade.__dataclass_fields__}
    return FrameMade(**values | {"vehicle": vehicle, "receiver": receiver})


def test_other_events_and_receivers_of_other_runs_have_no_messages() -> None:
    assert messages().of_event(PoseFound(0.0, "vehicle", "receiver")) == []
    assert messages().of_event(named(made(), "other", "receiver")) == []


def test_each_of_several_vehicles_has_its_map_and_they_lie_together() -> None:
    made_of = RunMessages(load("configs/two_vehicles.yaml"), EPOCH_US)
    for vehicle, lat in (("alpha", 46.0), ("bravo", 46.001)):
        made_of.of_event(DatumSet(0.0, vehicle, lat, 7.0, 1650.0, ()))
    told = by_topic(made_of.of_event(named(made(), "bravo", "only")))
    assert told["/bravo/only/arva"]["header"]["frame_id"] == "bravo/only/arva_receiver"
    assert told["/bravo/only/arva/pose"]["header"]["frame_id"] == "bravo/map"
    (map_,) = [t for t in told["/tf"]["transforms"] if t["child_frame_id"] == "bravo/map"]
    assert map_["header"]["frame_id"] == "map"
    assert map_["transform"]["translation"]["y"] == pytest.approx(111.2, abs=0.1)
    told = by_topic(made_of.of_event(named(made(), "alpha", "front")))
    (map_,) = [t for t in told["/tf"]["transforms"] if t["child_frame_id"] == "alpha/map"]
    assert map_["transform"]["translation"] == pytest.approx({"x": 0, "y": 0, "z": 0}, abs=1e-6)


def test_names_that_ros_does_not_allow_are_changed_and_stay_different() -> None:
    every = names_of([("7-up", "a-b"), ("7-up", "a.b"), ("7_up", "a_b")]).values()
    assert [names.arva for names in every] == ["/_7_up/a_b/arva", "/_7_up/a_b_2/arva", "/_7_up_2/a_b/arva"]
